"""Which preset a machine can run in reasonable time."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import NamedTuple

__all__ = ["AUTO", "ENLARGED_PX", "Choice", "choose_preset"]

AUTO = "auto"


class Pace(NamedTuple):
    """What matching costs one core.

    Attributes:
        search: seconds for 10^8 comparisons of two pixels.
        enlargement: seconds for the second search of 10^6 pixels; see `recon.enlargement`.
    """

    search: float
    enlargement: float = 0.0


CORE_SECONDS = {"context": Pace(119.0, 151.0), "best": Pace(73.0, 23.0), "fast": Pace(23.0)}
"""Most accurate first: `benchmarks/speed.py --presets context best fast` at 0.35 MP x 75, times its
2 threads, on a slow processor without instructions for bfloat16; one that has them is quicker."""
COMPARISONS, PIXELS = 1e8, 1e6
ENLARGED_PX = 1_000_000
"""Views of more pixels are not searched again."""
PATIENCE_S = 60.0
UNKNOWN_RANGE = 0.25
"""Share of the width that is searched at most when nobody says what to search."""


@dataclass(frozen=True)
class Choice:
    """A preset, and why.

    Attributes:
        preset: its name.
        reason: one sentence for people.
    """

    preset: str
    reason: str


def choose_preset(
    size: tuple[int, int],
    disparities: range | None,
    *,
    device: str = "cpu",
    cores: int | None = None,
) -> Choice:
    """Return the most accurate preset that takes less than a minute, or else the quickest.

    Args:
        size: (width, height) of the pair that is matched.
        disparities: candidates to search; None if they are still to be estimated.
        device: where to compute; on a GPU it is the most accurate one, which was not timed there.
        cores: of the processor; those of this machine if not given.
    """
    most_accurate = next(iter(CORE_SECONDS))
    if device != "cpu":
        return Choice(most_accurate, f"{most_accurate}, the most accurate, for there is a GPU")
    width, height = size
    count = len(disparities) if disparities is not None else int(UNKNOWN_RANGE * width)
    cores = cores or os.cpu_count() or 1
    comparisons = width * height * count / COMPARISONS
    enlarged = width * height / PIXELS if width * height <= ENLARGED_PX else 0.0
    seconds = {
        name: (pace.search * comparisons + pace.enlargement * enlarged) / cores
        for name, pace in CORE_SECONDS.items()
    }
    quick_enough = [name for name, needed in seconds.items() if needed <= PATIENCE_S]
    name = (quick_enough or [*seconds][-1:])[0]
    searched = f"{width} x {height} pixels x {count} disparities on {cores} cores"
    return Choice(name, f"{name}, about {max(1, round(seconds[name]))} s for {searched}")
