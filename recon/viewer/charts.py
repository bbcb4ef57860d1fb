"""Bar charts: the costs of one pixel, and how values are distributed."""

from __future__ import annotations

import numpy as np
import rerun as rr

from recon.types import Array
from recon.viewer.probing import Curve

__all__ = ["BARS", "cost_bars", "histogram", "result_bar"]

BARS = 60
COST_LOOK = {
    "matching_cost": ((232, 176, 84), 1.0),
    "aggregation": ((38, 110, 190), 0.45),
}
"""Colour and width of the bars of each stage, so that the earlier is seen behind the later."""

RESULT_COLOUR, RESULT_WIDTH = (214, 40, 57), 0.4
PLAIN = (90, 110, 140)


def cost_bars(curve: Curve, stage: str) -> rr.BarChart | None:
    """Return the costs of a pixel over its candidates, None if it has none.

    Args:
        curve: of the pixel.
        stage: which made it; later stages have narrower bars.
    """
    finite = np.isfinite(curve.costs)
    if not finite.any():
        return None
    colour, width = COST_LOOK.get(stage, (PLAIN, 1.0))
    count = int(finite.sum())
    return rr.BarChart(
        curve.costs[finite].astype(np.float64),
        abscissa=curve.disparities[finite].astype(np.float64),
        color=colour,
        widths=np.full(count, width),
    )


def result_bar(disparity_px: float, height: float) -> rr.BarChart:
    """Return one thin bar at the disparity that a pixel got.

    Args:
        disparity_px: where.
        height: of the bar, in costs.
    """
    return rr.BarChart(
        np.array([height]), abscissa=np.array([disparity_px]), color=RESULT_COLOUR,
        widths=np.array([RESULT_WIDTH]),
    )  # fmt: skip


def histogram(values: Array) -> rr.BarChart | None:
    """Return how often values occur, None if none is finite.

    The outermost half per cent on either side is counted in the outermost bars, so that a few
    outliers do not squeeze the rest.

    Args:
        values: any shape; NaN and infinite values are not counted.
    """
    finite = values[np.isfinite(values)].astype(np.float64)
    if not finite.size:
        return None
    lowest, highest = np.percentile(finite, (0.5, 99.5))
    if highest - lowest < 1e-9:
        lowest, highest = lowest - 0.5, highest + 0.5
    counts, edges = np.histogram(finite.clip(lowest, highest), BARS, (lowest, highest))
    return rr.BarChart(
        counts, abscissa=(edges[:-1] + edges[1:]) / 2, color=PLAIN, widths=np.diff(edges)
    )
