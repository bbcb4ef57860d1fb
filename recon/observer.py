"""Watching a computation without taking part in it."""

from __future__ import annotations

from collections.abc import Callable

__all__ = ["Observer", "all_of", "ignore"]

Observer = Callable[[str, object], None]
"""Called as `observe(stage, result)`; the stage is a slash-separated path such as
"disparity/left". A dictionary's `__setitem__` is an observer."""


def ignore(stage: str, result: object) -> None:
    """Do nothing with a result."""


def all_of(*observers: Observer) -> Observer:
    """Return an observer that passes every result to each of `observers`, in order."""

    def observe(stage: str, result: object) -> None:
        for observer in observers:
            observer(stage, result)

    return observe
