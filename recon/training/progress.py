"""What a training says while it goes on: values for observers, and lines for people."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Drawn", "Lines", "Saved", "Scores", "Step", "Stopped"]


@dataclass(frozen=True)
class Drawn:
    """A pair was added to the pool."""

    done: int
    total: int

    def __str__(self) -> str:
        return f"drew pair {self.done} of {self.total}"


@dataclass(frozen=True)
class Step:
    """Some updates were made.

    Attributes:
        step: how many in all.
        steps: how many there will be.
        loss: of the last one.
        within_1px: share of its visible pixels whose best candidate is within 1 px of the truth.
        pairs_per_second: since the last value like this.
    """

    step: int
    steps: int
    loss: float
    within_1px: float
    pairs_per_second: float

    def __str__(self) -> str:
        return (
            f"step {self.step} of {self.steps}: loss {self.loss:.4f}, within 1 px "
            f"{self.within_1px:.1%}, {self.pairs_per_second:.1f} pairs/s"
        )


@dataclass(frozen=True)
class Scores:
    """How good the network is on pairs that it never trained on.

    Attributes:
        step: after how many updates.
        plain: share of the visible pixels whose best candidate is within 1 px of the truth.
        augmented: the same, with what the augmentation does to two cameras.
    """

    step: int
    plain: float
    augmented: float

    def __str__(self) -> str:
        return (
            f"step {self.step}: kept pairs within 1 px {self.plain:.2%}, "
            f"augmented {self.augmented:.2%}"
        )


@dataclass(frozen=True)
class Saved:
    """A file was written."""

    path: Path

    def __str__(self) -> str:
        return f"wrote {self.path}"


@dataclass(frozen=True)
class Stopped:
    """The time was up; the same command goes on from here."""

    step: int
    steps: int
    minutes: float

    def __str__(self) -> str:
        return (
            f"stopped at step {self.step} of {self.steps} after {self.minutes:.1f} minutes; "
            "the same command goes on"
        )


class Lines:
    """An observer that says everything in lines, but counts no more often than it is asked to.

    Args:
        say: takes a line.
        every_seconds: between two lines that only count.
    """

    def __init__(self, say: Callable[[str], object], *, every_seconds: float = 10.0) -> None:
        self._say = say
        self._every = every_seconds
        self._last = -every_seconds

    def __call__(self, stage: str, result: object) -> None:  # noqa: ARG002  an observer
        """Say one result, unless it only counts and the last count was just now."""
        if isinstance(result, Drawn | Step):
            now = time.monotonic()
            if now - self._last < self._every:
                return
            self._last = now
        self._say(str(result))
