"""Which disparities the other view confirms."""

from __future__ import annotations

import torch
from torch import Tensor

from recon.kernels.segments import segment_sizes
from recon.types import DisparityMap, PixelStatus

__all__ = ["left_right_check", "reject_small_segments"]

PIXELS_AT_ONCE = 1 << 14
"""Pixels for which all candidates are looked at together."""

SEGMENT_STEP_PX = 1.0
"""Neighbours whose disparities differ by more belong to different surfaces."""


def left_right_check(
    of_left: DisparityMap[Tensor],
    of_right: DisparityMap[Tensor],
    *,
    tolerance_px: float,
    disparities: range,
) -> DisparityMap[Tensor]:
    """Keep the disparities of the left view that the right view confirms; say why others are not.

    A pixel x stays MATCHED if |d_L(x) - d_R(x - d_L(x))| <= tolerance. Otherwise it is MISMATCHED
    if |d - d_R(x - d)| <= tolerance for some candidate d, for then the right view sees a point
    that would project onto it; and OCCLUDED if there is none.

    Source: Hirschmueller, Stereo Processing by Semiglobal Matching and Mutual Information, PAMI
    30(2) 2008, section 2.6; Zbontar & LeCun, JMLR 17 2016, section 4.2.

    Args:
        of_left: (H, W), every pixel MATCHED or OUTSIDE.
        of_right: (H, W), indexed by the pixels of the right view.
        tolerance_px: larger keeps more, and more that is wrong.
        disparities: the candidates that were searched.

    Returns:
        (H, W); NaN and without confidence where rejected.
    """
    rows, columns = of_left.valid.nonzero(as_tuple=True)
    found = of_left.values[rows, columns]
    confirmed = _sees(of_right, rows, columns, found, tolerance_px)
    rows, columns = rows[~confirmed], columns[~confirmed]
    candidates = torch.arange(disparities.start, disparities.stop, device=rows.device)
    explained = torch.zeros_like(rows, dtype=torch.bool)
    for start in range(0, len(rows), PIXELS_AT_ONCE):
        some = slice(start, start + PIXELS_AT_ONCE)
        seen = _sees(of_right, rows[some, None], columns[some, None], candidates, tolerance_px)
        explained[some] = seen.any(1)

    status = of_left.status.clone()
    status[rows, columns] = torch.where(
        explained, int(PixelStatus.MISMATCHED), int(PixelStatus.OCCLUDED)
    ).to(status.dtype)
    return _keep_matched(of_left, status)


def _sees(
    of_right: DisparityMap[Tensor],
    rows: Tensor,
    columns: Tensor,
    disparities: Tensor,
    tolerance_px: float,
) -> Tensor:
    """Return whether the right view, where a disparity leads, has that disparity too.

    Args:
        of_right: (H, W).
        rows: of pixels of the left view.
        columns: of the same pixels.
        disparities: of these pixels, or candidates; all three broadcast.
        tolerance_px: largest difference.
    """
    width = of_right.values.shape[1]
    partner = (columns - disparities).round().long()
    seen = of_right.values[rows, partner.clamp(0, width - 1)]
    return (partner >= 0) & (partner < width) & ((disparities - seen).abs() <= tolerance_px)


def reject_small_segments(
    disparity: DisparityMap[Tensor], *, min_segment_px: int
) -> DisparityMap[Tensor]:
    """Reject islands of matched pixels: small pieces are rarely surfaces.

    Neighbours belong to one piece if their disparities differ by at most 1 px.

    Source: Hirschmueller, Stereo Processing by Semiglobal Matching and Mutual Information, PAMI
    30(2) 2008, section 2.5.1 (removal of peaks).

    Args:
        disparity: (H, W).
        min_segment_px: pieces with fewer pixels become MISMATCHED; 0 and 1 keep all.
    """
    if min_segment_px <= 1:
        return disparity
    matched = disparity.status == int(PixelStatus.MATCHED)
    values = torch.where(matched, disparity.values, float("nan"))
    small = matched & (segment_sizes(values, largest_step=SEGMENT_STEP_PX) < min_segment_px)
    status = disparity.status.masked_fill(small, int(PixelStatus.MISMATCHED))
    return _keep_matched(disparity, status)


def _keep_matched(disparity: DisparityMap[Tensor], status: Tensor) -> DisparityMap[Tensor]:
    """Return `disparity` with a new status and nothing where that is not MATCHED."""
    rejected = status != int(PixelStatus.MATCHED)
    return DisparityMap(
        disparity.values.masked_fill(rejected, float("nan")),
        status,
        disparity.confidence.masked_fill(rejected, 0.0),
    )
