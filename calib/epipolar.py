"""Points that two views show both, and how far from each other's row they lie."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from calib.pair import Image

__all__ = [
    "LEAST_MATCHES",
    "Matches",
    "VerticalResidual",
    "looks_mirrored",
    "match_views",
    "vertical_residual",
]

Array = npt.NDArray[np.float64]
Descriptors = npt.NDArray[np.float32]

LEAST_MATCHES = 20
"""With fewer, nothing can be said of a pair."""

MOST_PIXELS = 750_000  # that points are looked for in
MOST_POINTS = 3000  # in each view, the most distinct
LEAST_CONTRAST = 0.02
RATIO = 0.8  # of the distances to the nearest and the second descriptor
EPIPOLAR_TOLERANCE_PX = 1.0  # at the size that is searched
EPIPOLAR_TRIES = 2000
WINDOW_RADIUS_PX = 7  # that a point is placed by, at the size that was searched
WIDEST_RADIUS_PX = 15  # at full size
SURROUNDINGS = 0.7  # of this radius: whose mean and contrast are taken out before
LEAST_DEVIATION = 2.0  # grey levels; less is noise
FARTHEST_PX = 1.5  # that a point moves, at the size that was searched
INFINITY_TOLERANCE_PX = 2.0
MIRROR_GAIN = 3


@dataclass(frozen=True, eq=False)
class Matches:
    """Points of a scene and where both views show them.

    Attributes:
        left: (N, 2) float64, (x, y) in pixels of the left view.
        right: (N, 2) float64, of the same points in the right view.
    """

    left: Array
    right: Array

    def __post_init__(self) -> None:
        if self.left.shape != self.right.shape or self.left.shape[1:] != (2,):
            raise ValueError(
                f"matches must be two arrays (N, 2), got {self.left.shape} and {self.right.shape}"
            )

    def __len__(self) -> int:
        return len(self.left)

    @property
    def disparities(self) -> Array:
        """(N,), x_left - x_right in pixels."""
        difference: Array = self.left[:, 0] - self.right[:, 0]
        return difference

    @property
    def offsets(self) -> Array:
        """(N,), y_left - y_right in pixels; 0 where the rows agree."""
        difference: Array = self.left[:, 1] - self.right[:, 1]
        return difference


def match_views(left: Image, right: Image) -> Matches:
    """Find points that both views show, wherever in the other view they are.

    SIFT keypoints, of which each is the other's nearest by the Hellinger distance of their
    descriptors; those that agree with one epipolar geometry (MAGSAC), whichever it is, so a camera
    that was turned is no obstacle. They are looked for in images of at most `MOST_PIXELS` and then
    placed at full size, by the method of Lucas and Kanade on images of even contrast: that has a
    fifth of the noise of the keypoints. Twice the same images give twice the same matches.

    Source: Lowe, IJCV 2004; Arandjelovic & Zisserman, CVPR 2012; Barath et al., CVPR 2020.

    Args:
        left: (H, W, 3) uint8 RGB.
        right: (H, W, 3) uint8 RGB, of the same size.

    Returns:
        As many as there are, perhaps none.
    """
    grey_left, grey_right = _grey(left), _grey(right)
    scale = min(1.0, (MOST_PIXELS / grey_left.size) ** 0.5)
    points_left, descriptors_left = _keypoints(grey_left, scale)
    points_right, descriptors_right = _keypoints(grey_right, scale)
    of_left, of_right = _nearest_both_ways(descriptors_left, descriptors_right)
    matches = Matches(points_left[of_left], points_right[of_right])
    return _placed(grey_left, grey_right, _of_one_geometry(matches, scale), scale)


@dataclass(frozen=True)
class VerticalResidual:
    """How far the rows of a rectified pair are from agreeing.

    Attributes:
        count: of the matches it was measured on; with fewer than `LEAST_MATCHES` the figures mean
            nothing.
        median_px: of y_left - y_right; its sign says which view is shifted.
        mean_absolute_px: of |y_left - y_right|.
        p95_px: 95th percentile of |y_left - y_right|.
        behind_infinity: share of the matches, in [0, 1], whose disparity is less than that of
            infinity, which no point in front of the cameras has.
        swapped_behind_infinity: the same share if left were right and right left.
        upside_down: whether what is above in one view is below in the other.
    """

    count: int
    median_px: float
    mean_absolute_px: float
    p95_px: float
    behind_infinity: float
    swapped_behind_infinity: float
    upside_down: bool

    @property
    def reliable(self) -> bool:
        """Whether there were enough matches."""
        return self.count >= LEAST_MATCHES

    @property
    def swapped_fits_better(self) -> bool:
        """Whether left and right seem to be swapped."""
        return self.behind_infinity > 2 * self.swapped_behind_infinity


def vertical_residual(matches: Matches, *, disparity_at_infinity: float = 0.0) -> VerticalResidual:
    """Measure how far the rows of a rectified pair are from agreeing.

    Args:
        matches: of the rectified views.
        disparity_at_infinity: of the pair's geometry, pixels.
    """
    if not len(matches):
        return VerticalResidual(0, 0.0, 0.0, 0.0, 0.0, 0.0, upside_down=False)
    far = np.abs(matches.offsets)
    behind, swapped = (
        float((d < disparity_at_infinity - INFINITY_TOLERANCE_PX).mean())
        for d in (matches.disparities, -matches.disparities)
    )
    rows = [view[:, 1] - view[:, 1].mean() for view in (matches.left, matches.right)]
    return VerticalResidual(
        count=len(matches),
        median_px=float(np.median(matches.offsets)),
        mean_absolute_px=float(far.mean()),
        p95_px=float(np.percentile(far, 95)),
        behind_infinity=behind,
        swapped_behind_infinity=swapped,
        upside_down=bool((rows[0] * rows[1]).sum() < 0),
    )


def looks_mirrored(left: Image, right: Image, count: int) -> bool:
    """Return whether far more points match when one view is mirrored.

    Args:
        left: (H, W, 3) uint8 RGB.
        right: (H, W, 3) uint8 RGB, of the same size.
        count: of the matches as they are.
    """
    mirrored = len(match_views(left, np.ascontiguousarray(right[:, ::-1])))
    return mirrored >= max(LEAST_MATCHES, MIRROR_GAIN * count)


def _grey(image: Image) -> Image:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def _keypoints(grey: Image, scale: float) -> tuple[Array, Descriptors]:
    """Return (N, 2) points in pixels of `grey` and (N, 128) square roots of their descriptors."""
    height, width = grey.shape
    size = max(1, round(width * scale)), max(1, round(height * scale))
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA) if scale < 1 else grey
    stretched = cv2.normalize(small, np.zeros_like(small), 0, 255, cv2.NORM_MINMAX)
    sift = cv2.SIFT.create(nfeatures=MOST_POINTS, contrastThreshold=LEAST_CONTRAST)
    found, descriptors = sift.detectAndCompute(stretched, None)
    if not found:
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    points = np.array([keypoint.pt for keypoint in found], dtype=np.float64)
    shares = descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-9)
    return (points + 0.5) * (width / size[0], height / size[1]) - 0.5, np.sqrt(shares)


def _nearest_both_ways(
    left: Descriptors, right: Descriptors
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the rows of `left` and of `right` that are each other's clear nearest.

    The descriptors have length 1, so that their squared distance is 2 - 2 times the product.
    """
    if len(left) < 2 or len(right) < 2:
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    product = left @ right.T  # (N_left, N_right)
    nearest, nearest_of_right = product.argmax(axis=1), product.argmax(axis=0)
    second, first = np.partition(product, -2, axis=1)[:, -2:].T
    clear = 1 - first < RATIO**2 * (1 - second)
    mutual = nearest_of_right[nearest] == np.arange(len(left))
    chosen = np.flatnonzero(clear & mutual)
    return chosen, nearest[chosen]


def _of_one_geometry(matches: Matches, scale: float) -> Matches:
    """Return the matches that one fundamental matrix explains, none if there is no such matrix."""
    if len(matches) < LEAST_MATCHES:
        return Matches(np.zeros((0, 2)), np.zeros((0, 2)))
    tolerance = EPIPOLAR_TOLERANCE_PX / scale
    settings = tolerance, 0.999, EPIPOLAR_TRIES
    try:
        _, agrees = cv2.findFundamentalMat(matches.left, matches.right, cv2.USAC_MAGSAC, *settings)
    except cv2.error:  # an assertion of OpenCV 5, met where all points shift alike: a flat wall
        _, agrees = cv2.findFundamentalMat(matches.left, matches.right, cv2.FM_RANSAC, *settings)
    kept = np.zeros(len(matches), bool) if agrees is None else agrees.ravel() > 0
    return Matches(matches.left[kept], matches.right[kept])


def _placed(left: Image, right: Image, matches: Matches, scale: float) -> Matches:
    """Move the points of the right view onto what the left one shows, to a part of a pixel."""
    if not len(matches):
        return matches
    start = matches.right.astype(np.float32)
    radius = min(round(WINDOW_RADIUS_PX / scale), WIDEST_RADIUS_PX)
    moved, found, _ = cv2.calcOpticalFlowPyrLK(
        _even(left, SURROUNDINGS * radius),
        _even(right, SURROUNDINGS * radius),
        matches.left.astype(np.float32),
        start.copy(),
        winSize=(2 * radius + 1, 2 * radius + 1),
        maxLevel=0,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 0.01),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    near = np.abs(moved - start).max(axis=1) < FARTHEST_PX / scale
    kept = near & (found.ravel() > 0)
    return Matches(matches.left[kept], moved[kept].astype(np.float64))


def _even(grey: Image, radius: float) -> Image:
    """Return the image with the mean and the contrast of every point's surroundings made equal."""
    values = grey.astype(np.float32)
    values -= cv2.GaussianBlur(values, (0, 0), radius)
    deviation = np.sqrt(cv2.GaussianBlur(values * values, (0, 0), radius))
    even = 128 + 50 * values / (deviation + LEAST_DEVIATION)
    return np.clip(even, 0, 255).astype(np.uint8)
