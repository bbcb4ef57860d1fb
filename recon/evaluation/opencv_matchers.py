"""OpenCV's block matching and semi-global matching, to compare with.

What they find is checked and filled as `recon.matcher.Matcher` does it, so that a difference in the
figures is one of matching (and of the refinements of a preset, which are left out).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import cv2
import numpy as np
import torch
from torch import Tensor

from calib.pair import Image, RectifiedPair
from recon.consistency import left_right_check, reject_small_segments
from recon.filling import Filling, SurfaceFilling
from recon.types import Array, DisparityMap, PixelStatus

__all__ = ["OPENCV_MATCHERS", "OpenCvMatcher"]

ALGORITHMS = ("bm", "sgbm")
MODES = {
    "sgbm": cv2.STEREO_SGBM_MODE_SGBM,
    "hh": cv2.STEREO_SGBM_MODE_HH,
    "3way": cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    "hh4": cv2.STEREO_SGBM_MODE_HH4,
}
FILLS = ("ours", "row")

STEPS_PER_PX = 16
"""OpenCV returns whole sixteenths of a pixel, in 16 bits."""
COUNT_DIVISOR = 16
"""The number of candidates must be a multiple of this."""
FARTHEST_PX = 2**15 // STEPS_PER_PX - 1
"""Largest disparity, of either sign, that 16 bits hold."""
SMALLEST_BM_BLOCK_PX = 5

CHANNELS = 3
BM_TRUNCATION = 31
SGBM_TRUNCATION = 63
OWN_CHECK_PX = 1


@dataclass(frozen=True)
class OpenCvMatcher:
    """Match with OpenCV; check and fill as `Matcher` does, or the short way.

    Fill "ours": the right view is matched too, as the mirror image of the swapped and mirrored
    pair, and what both runs found goes through the left-right check, the rejection of small
    segments and the filling that the presets use. OpenCV has a check of its own, within one run,
    which it cannot be kept from (a negative disp12MaxDiff changes nothing). A pixel that it
    rejects counts as one that the right view does not confirm, so the left-right check says
    whether it is occluded or mismatched.

    Fill "row": one run, OpenCV's own check, and the smaller of the nearest disparities to the
    left and right in the row for what it rejects.

    Matched pixels get confidence 1, since OpenCV says nothing about it, filled ones the share
    that `filling` gives them: it tells measured from filled and ranks nothing else. Rounding up
    the number of candidates may give disparities beyond the range asked for.

    Source: StereoBM and StereoSGBM of OpenCV; the latter after Hirschmueller, PAMI 30(2) 2008,
    with the matching cost of Birchfield & Tomasi, PAMI 20(4) 1998.

    Attributes:
        algorithm: "bm" or "sgbm".
        mode: directions along which "sgbm" aggregates: "sgbm" 5, "hh" 8, "3way" 3, "hh4" 4;
            empty for "bm".
        block_px: side of the block that is compared, odd; larger is smoother.
        fill: "ours" or "row".
        left_right_tolerance_px: larger keeps more of what the right view does not confirm.
        min_segment_px: matched islands with fewer pixels are rejected; 0 keeps all.
        filling: for rejected pixels, with fill "ours"; its confidence also with "row".

    Raises:
        ValueError: if a setting is out of range or has no such name.
    """

    algorithm: str = "sgbm"
    mode: str = "hh"
    block_px: int = 3
    fill: str = "ours"
    left_right_tolerance_px: float = 1.0
    min_segment_px: int = 100
    filling: Filling = field(default_factory=SurfaceFilling)

    def __post_init__(self) -> None:
        _check_name("algorithm", self.algorithm, ALGORITHMS)
        _check_name("fill", self.fill, FILLS)
        if self.algorithm == "sgbm":
            _check_name("mode", self.mode, tuple(MODES))
        elif self.mode:
            raise ValueError(f"{self.algorithm} has no modes, got {self.mode!r}; leave it empty")
        smallest = SMALLEST_BM_BLOCK_PX if self.algorithm == "bm" else 1
        if self.block_px < smallest or self.block_px % 2 == 0:
            raise ValueError(
                f"block_px of {self.algorithm} must be odd and at least {smallest}, "
                f"got {self.block_px} px"
            )
        for name in ("left_right_tolerance_px", "min_segment_px"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")

    def __call__(self, pair: RectifiedPair, disparities: range) -> DisparityMap[Array]:
        """Match a pair.

        Args:
            pair: of any size of at least one block.
            disparities: candidates d = x_left - x_right in pixels.

        Returns:
            (H, W), of the left view, with a disparity everywhere unless nothing was matched.

        Raises:
            ValueError: if `disparities` is empty, leaves candidates out or does not fit into 16
                bits, or the images are smaller than a block.
        """
        self._check_size(pair)
        padded = _whole_sixteens(disparities)
        of_left = self._disparities(pair.left, pair.right, padded)
        if self.fill == "row":
            return rows_filled(of_left, self.filling.confidence)
        of_right = _mirrored(self._disparities(_mirrored(pair.right), _mirrored(pair.left), padded))
        disparity = checked(
            of_left, of_right, disparities, tolerance_px=self.left_right_tolerance_px
        )
        disparity = reject_small_segments(disparity, min_segment_px=self.min_segment_px)
        guide = torch.from_numpy(np.divide(pair.left, np.float32(255)))
        disparity = self.filling(disparity, of_right=_measured(of_right), guide=guide)
        return DisparityMap(
            *(a.numpy() for a in (disparity.values, disparity.status, disparity.confidence))
        )

    def _check_size(self, pair: RectifiedPair) -> None:
        """Raise ValueError unless a block fits into the images."""
        height, width = pair.left.shape[:2]
        if min(height, width) < self.block_px:
            raise ValueError(
                f"images are {width} x {height} (width x height) but a block is "
                f"{self.block_px} x {self.block_px} px; give larger images or a smaller block_px"
            )

    def _disparities(self, left: Image, right: Image, disparities: range) -> Array:
        """Run OpenCV once.

        Columns whose candidates leave the right image would have no result, so both images are
        continued by repeating their border.

        Returns:
            (H, W) float32, NaN where OpenCV rejects.
        """
        before, after = max(0, disparities.stop), max(0, -disparities.start)
        margin = self.block_px // 2 if self.algorithm == "bm" else 0
        borders = (margin, margin, before, after + margin)
        views = (
            cv2.copyMakeBorder(self._read(image), *borders, cv2.BORDER_REPLICATE)
            for image in (left, right)
        )
        steps = np.asarray(self._matcher(disparities).compute(*views))
        height, width = left.shape[:2]
        steps = steps[margin : margin + height, before : before + width]
        found = steps >= disparities.start * STEPS_PER_PX
        values = np.where(found, steps.astype(np.float32) / STEPS_PER_PX, np.float32(np.nan))
        return np.asarray(values, dtype=np.float32)

    def _read(self, image: Image) -> Array:
        """Return an image in the colours that the algorithm expects."""
        colours = cv2.COLOR_RGB2GRAY if self.algorithm == "bm" else cv2.COLOR_RGB2BGR
        return np.asarray(cv2.cvtColor(np.ascontiguousarray(image), colours))

    def _matcher(self, disparities: range) -> cv2.StereoMatcher:
        """Return OpenCV's object, with all rejections switched off that can be."""
        if self.algorithm == "bm":
            matcher = cv2.StereoBM.create(len(disparities), self.block_px)
            matcher.setMinDisparity(disparities.start)
            matcher.setPreFilterType(cv2.STEREO_BM_PREFILTER_XSOBEL)
            matcher.setPreFilterCap(BM_TRUNCATION)
            matcher.setTextureThreshold(0)
            matcher.setUniquenessRatio(0)
            matcher.setDisp12MaxDiff(OWN_CHECK_PX)
            return matcher
        return cv2.StereoSGBM.create(
            minDisparity=disparities.start,
            numDisparities=len(disparities),
            blockSize=self.block_px,
            P1=8 * CHANNELS * self.block_px**2,
            P2=32 * CHANNELS * self.block_px**2,
            disp12MaxDiff=OWN_CHECK_PX,
            preFilterCap=SGBM_TRUNCATION,
            uniquenessRatio=0,
            speckleWindowSize=0,
            speckleRange=0,
            mode=MODES[self.mode],
        )


def _check_name(kind: str, name: str, known: tuple[str, ...]) -> None:
    """Raise ValueError unless a setting has one of its names."""
    if name not in known:
        raise ValueError(f"unknown {kind} {name!r}; there are {', '.join(known)}")


OPENCV_MATCHERS: Mapping[str, OpenCvMatcher] = MappingProxyType(
    {
        "opencv-bm": OpenCvMatcher("bm", mode="", block_px=15),
        "opencv-sgbm": OpenCvMatcher("sgbm", mode="hh", block_px=3),
        "opencv-sgbm-3way": OpenCvMatcher("sgbm", mode="3way", block_px=3),
        "opencv-sgbm-rows": OpenCvMatcher("sgbm", mode="hh", block_px=3, fill="row"),
    }
)
"""Baselines by the names that the command line and the tables give them."""


def _whole_sixteens(disparities: range) -> range:
    """Return a range with the same start and a number of candidates that OpenCV takes.

    Raises:
        ValueError: if `disparities` is empty, leaves candidates out or does not fit into 16 bits.
    """
    if len(disparities) == 0 or disparities.step != 1:
        raise ValueError(f"disparities must be consecutive, at least one, got {disparities}")
    count = -(-len(disparities) // COUNT_DIVISOR) * COUNT_DIVISOR
    padded = range(disparities.start, disparities.start + count)
    if padded.start < -FARTHEST_PX or padded.stop > FARTHEST_PX:
        raise ValueError(
            f"OpenCV holds disparities between {-FARTHEST_PX} and {FARTHEST_PX} px, got "
            f"{disparities.start} to {disparities.stop - 1} ({count} candidates, a multiple of "
            f"{COUNT_DIVISOR}, are searched); match the pair at a smaller size"
        )
    return padded


def _mirrored(image: Array) -> Array:
    """Exchange left and right."""
    return np.ascontiguousarray(image[:, ::-1])


def _measured(values: Array) -> DisparityMap[Tensor]:
    """Return (H, W) disparities as a map that is OUTSIDE where they are NaN."""
    found = torch.from_numpy(values)
    present = ~found.isnan()
    status = torch.where(present, int(PixelStatus.MATCHED), int(PixelStatus.OUTSIDE))
    return DisparityMap(found, status.to(torch.uint8), present.float())


def checked(
    of_left: Array, of_right: Array, disparities: range, *, tolerance_px: float
) -> DisparityMap[Tensor]:
    """Apply the left-right check, and give also what OpenCV rejected a reason.

    `left_right_check` looks for the reason of what the right view does not confirm. A disparity
    of the width of the image leads out of the right view from every pixel, so nothing confirms
    it: rejected pixels of the left view get this one for the check.

    Args:
        of_left: (H, W), NaN where rejected.
        of_right: (H, W), likewise, of the pixels of the right view.
        disparities: the candidates that may explain a rejected pixel.
        tolerance_px: of the check.

    Returns:
        (H, W), every pixel MATCHED, MISMATCHED or OCCLUDED.
    """
    beyond = np.float32(of_left.shape[1])
    return left_right_check(
        _measured(np.where(np.isnan(of_left), beyond, of_left)),
        _measured(of_right),
        tolerance_px=tolerance_px,
        disparities=disparities,
    )


def rows_filled(values: Array, confidence: float) -> DisparityMap[Array]:
    """Return (H, W) disparities with the smaller of the neighbours in the row where NaN.

    Rows without any are those of the nearest row that has some.

    Args:
        values: of the left view.
        confidence: of filled pixels.

    Returns:
        Without any disparity if `values` has none.
    """
    found = ~np.isnan(values)
    known_rows = np.flatnonzero(found.any(axis=1))
    if not len(known_rows):
        status = np.full(values.shape, PixelStatus.MISMATCHED, np.uint8)
        return DisparityMap(values, status, np.zeros_like(values))
    filled = np.fmin(_last_known(values), _mirrored(_last_known(_mirrored(values))))
    rows = np.arange(len(values))
    nearest = known_rows[np.abs(known_rows - rows[:, None]).argmin(axis=1)]
    return DisparityMap(
        filled[nearest],
        np.where(found, PixelStatus.MATCHED, PixelStatus.FILLED_OCCLUSION).astype(np.uint8),
        np.where(found, np.float32(1), np.float32(confidence)),
    )


def _last_known(values: Array) -> Array:
    """Return for every pixel the last of (H, W) values in its row, up to itself, that is known.

    Returns:
        (H, W), NaN where there is none yet.
    """
    columns = np.where(np.isnan(values), 0, np.arange(values.shape[1]))
    return np.take_along_axis(values, np.maximum.accumulate(columns, axis=1), axis=1)
