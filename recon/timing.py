"""How long each stage took, measured from outside."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import torch
from numba.core import event

from recon.observer import Observer, ignore

__all__ = ["Stopwatch", "compilation_watched"]


@contextmanager
def compilation_watched() -> Iterator[Callable[[], float]]:
    """Give a function that returns the seconds spent compiling loops since the block began.

    Compiled loops are kept on disk, so only the first run on a machine takes this time; it is
    part of the stages during which it happens.
    """
    with event.install_timer("numba:compile", lambda _: None) as listener:
        yield lambda: listener.duration if listener.done else 0.0


class Stopwatch:
    """An observer that measures the time between results, and passes them on.

    Time that the next observer takes is counted as `observing`, not as part of a stage.

    Attributes:
        seconds: seconds of every stage, in the order of the stages; those that report more than
            once, as strip by strip, add up.
    """

    def __init__(self, then: Observer = ignore) -> None:
        self.seconds: dict[str, float] = {}
        self._then = then
        self._since = time.perf_counter()

    def __call__(self, stage: str, result: object) -> None:
        """Note the time since the last result as that of `stage`, then pass the result on."""
        if torch.cuda.is_available():
            torch.cuda.synchronize()
        self._note(stage)
        self._then(stage, result)
        self._note("observing")

    def _note(self, stage: str) -> None:
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._since
        self._since = now
