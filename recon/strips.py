"""Parts of an image, and what around them their result depends on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

__all__ = ["GRID_PX", "Reach", "Strip"]

GRID_PX = 16
"""Parts start at multiples of this, so that networks which halve the image see one grid."""


class Reach(NamedTuple):
    """How far each stage looks beyond a pixel, in pixels.

    Attributes:
        matching_cost: what the costs of a pixel depend on.
        aggregation: whose costs speak for a pixel.
        optimisation: on whose costs the choice for a pixel depends, or nearly so.
    """

    matching_cost: int
    aggregation: int
    optimisation: int


@dataclass(frozen=True)
class Strip:
    """Some rows or columns of an image, and those around them on which their result depends.

    Attributes:
        seen: of the image, what the matching cost sees.
        costs: what has costs, counted from the first that is seen.
        chosen: for what a candidate is chosen, counted from the first that has costs.
        result: whose choice is kept, counted from the first of these.
    """

    seen: slice
    costs: slice
    chosen: slice
    result: slice

    @property
    def first_cost(self) -> int:
        """Which row or column of the image is the first that has costs."""
        first: int = self.seen.start + self.costs.start
        return first

    @property
    def first_result(self) -> int:
        """Which row or column of the image is the first whose choice is kept."""
        first: int = self.first_cost + self.chosen.start + self.result.start
        return first

    @classmethod
    def around(cls, wanted: slice, size: int, reach: Reach) -> Strip:
        """Return the strip whose result is `wanted`.

        Args:
            wanted: of the image.
            size: rows or columns of the image.
            reach: of the stages.
        """
        chosen = grown(wanted, reach.optimisation, size)
        costs = grown(chosen, reach.aggregation, size)
        seen = grown(costs, reach.matching_cost, size)
        seen = slice(seen.start // GRID_PX * GRID_PX, seen.stop)
        return cls(seen, moved(costs, -seen.start), moved(chosen, -costs.start),
                   moved(wanted, -chosen.start))  # fmt: skip


def grown(part: slice, margin: int, size: int) -> slice:
    """Return a part with `margin` more on either side, as far as the image goes."""
    return slice(max(0, part.start - margin), min(size, part.stop + margin))


def moved(part: slice, step: int) -> slice:
    """Return a part `step` further on."""
    return slice(part.start + step, part.stop + step)
