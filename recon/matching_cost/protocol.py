"""What a matching cost is."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from torch import Tensor

from recon.types import CostVolume

__all__ = ["ALL_ROWS", "MatchingCost", "VectorCost"]

ALL_ROWS = slice(None)


class MatchingCost(Protocol):
    """How badly a pixel of the left view fits a pixel of the right view."""

    @property
    def margin_px(self) -> int:
        """How many rows above and below a pixel its costs depend on."""
        ...

    def __call__(
        self, left: Tensor, right: Tensor, disparities: range, *, rows: slice = ALL_ROWS
    ) -> CostVolume:
        """Compare every pixel of the left view with its candidates in the right view.

        Args:
            left: (H, W, 3) float32 RGB in [0, 1].
            right: (H, W, 3), likewise.
            disparities: candidates d = x_left - x_right, consecutive.
            rows: the rows that are wanted; the others are context, of which `margin_px` matter.

        Returns:
            (rows, W, D); +inf where x_left - d is not a column of the right view.
        """
        ...


@runtime_checkable
class VectorCost(MatchingCost, Protocol):
    """A matching cost that describes pixels by vectors.

    One minus their scalar product is the cost, or what the cost is without a simpler one beside it.
    """

    def vectors(self, image: Tensor, *, rows: slice = ALL_ROWS) -> Tensor:
        """Describe pixels.

        Args:
            image: (H, W, 3) float32 RGB in [0, 1].
            rows: the rows that are wanted; see `MatchingCost`.

        Returns:
            (rows, W, C) float32, each of length 1 at most.
        """
        ...
