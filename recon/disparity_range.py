"""Which disparities to search when nobody says."""

from __future__ import annotations

import math

import numpy as np

from calib.pair import RectifiedPair
from recon.aggregation import BoxAggregation
from recon.matcher import Matcher
from recon.matching_cost import Census
from recon.types import PixelStatus

__all__ = ["check_range", "estimate_range"]

COARSE_WIDTH = 256
WIDEST = 0.45  # of the width, from infinity or from zero, whichever is larger
OUTLIERS = 0.005  # share of the matches beyond either end
MARGIN_SHARE = 0.15
LEAST_CONFIDENCE = 0.1  # surfaces without texture and chance matches have less
LEAST_MATCHED = 0.02


def check_range(disparities: range, width: int) -> range:
    """Return the range, or say what is wrong with it.

    Args:
        disparities: candidates in pixels.
        width: of the images in pixels.

    Raises:
        ValueError: if the range is empty, or no pixel has a partner at some of it.
    """
    if len(disparities) == 0:
        raise ValueError(
            f"disparity range is empty: from {disparities.start} to {disparities.stop - 1} px; "
            "the maximum must lie above the minimum"
        )
    if disparities[-1] >= width or disparities[0] <= -width:
        raise ValueError(
            f"disparities {disparities[0]} to {disparities[-1]} px do not fit images that are "
            f"{width} px wide; were they given for another size?"
        )
    return disparities


def estimate_range(pair: RectifiedPair) -> range:
    """Match the pair small, over all disparities that a rig can show, and see where matches lie.

    The range covers all but the outermost half percent of the pixels on which both views agree in
    larger islands, widened by 15 %. Nothing lies behind infinity, so the range ends there.

    Raises:
        ValueError: if almost nothing matches, as in a pair without texture.
    """
    width = pair.left.shape[1]
    factor = min(1.0, COARSE_WIDTH / width)
    size = max(1, round(width * factor)), max(1, round(pair.left.shape[0] * factor))
    coarse = pair.resized(size)
    matcher = Matcher(Census(), BoxAggregation(radius_px=3), min_segment_px=40, filling=None)
    found = matcher(coarse, _possible(coarse))
    trusted = (found.status == PixelStatus.MATCHED) & (found.confidence > LEAST_CONFIDENCE)
    if trusted.mean() < LEAST_MATCHED:
        raise ValueError(
            "cannot estimate the disparity range: the views hardly match; give it with "
            "--min-disparity and --max-disparity, and check that the pair is rectified"
        )
    matched = found.values[trusted]
    near, far = np.quantile(matched, [1 - OUTLIERS, OUTLIERS]) / factor
    margin = MARGIN_SHARE * (near - far) + 2 / factor
    low = max(math.floor(far - margin), _last_behind_infinity(pair), 1 - width)
    return range(low, min(math.ceil(near + margin) + 1, width))


def _last_behind_infinity(pair: RectifiedPair) -> int:
    """Return the largest whole disparity that nothing has: that of infinity or just below."""
    return math.floor(pair.geometry.disparity_at_infinity)


def _possible(pair: RectifiedPair) -> range:
    """Return all disparities that a rig can show."""
    width = pair.left.shape[1]
    infinity = _last_behind_infinity(pair)
    first = max(infinity - 1, 1 - width)
    last = min(max(0, infinity) + int(WIDEST * width), width)
    return range(first, max(last, first + 1))
