"""Turn and undistort both views so that their rows agree."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt

from calib.camera import Camera
from calib.pair import Image, RectifiedPair, StereoPair
from calib.rig import RectifiedGeometry, StereoCalibration

__all__ = ["Rectifier", "rectifying_rotations"]

Array = npt.NDArray[np.float64]
Map = npt.NDArray[np.float32]

BORDER_SAMPLES = 201  # along each side of a raw image
SMALLEST_SHARE = 0.02  # of the raw width and height, that alpha = 0 may blow up to the whole
BORDER_TOLERANCE_PX = 1e-2  # of the maps, which are single precision
OUTSIDE_PX = np.float32(-2)  # a raw coordinate that remap shows black


@dataclass(frozen=True, eq=False)
class Rectifier:
    """Rectification of the pairs of one rig; called with a raw pair it returns the rectified one.

    Both views are turned onto a plane parallel to the baseline, half of the relative rotation
    each, so that the two lines of sight to a point lie in the same row. The rotations are
    OpenCV's. The part of the plane to show is measured on the borders of both raw images, so that
    one rule serves every lens model and alpha = 0 leaves no black border.

    Source: Bouguet, Camera Calibration Toolbox for Matlab, 2004 (the rotations).

    Attributes:
        calibration: of the raw pairs.
        alpha: which part of the raw images to show: 0 only what both fill, 1 every raw pixel with
            black around, None the middle at the focal length of the raw images. Raising it widens
            the view and lowers the resolution.
        scale: size of the rectified images over that of the raw ones; below 0.5 they alias, so
            rather shrink them afterwards. Not together with `size`.
        size: (width, height) of the rectified images, for other proportions than the raw ones.
        common_centre: whether both views get the same principal point, so that infinity has
            disparity 0. Without it each view is centred on its own image: cameras that look
            towards each other keep more of it.

    Raises:
        ValueError: if a setting cannot be, the cameras stand one above the other or are swapped,
            or the views have nothing in common to show.
    """

    calibration: StereoCalibration
    alpha: float | None = 0.0
    scale: float = 1.0
    size: tuple[int, int] | None = None
    common_centre: bool = True

    def __post_init__(self) -> None:
        if self.alpha is not None and not 0 <= self.alpha <= 1:
            raise ValueError(f"alpha must be None or from 0 to 1, got {self.alpha:g}")
        if not 0 < self.scale < float("inf"):
            raise ValueError(f"scale must be positive, got {self.scale:g}")
        if self.size is not None and self.scale != 1:
            raise ValueError(f"give size or scale, not both: got {self.size} and {self.scale:g}")
        _ = self.geometry  # raises here, not at the first pair, if the rig cannot be rectified

    def __call__(self, pair: StereoPair) -> RectifiedPair:
        """Return the rectified photographs; black where a raw image has no pixel.

        Args:
            pair: raw photographs; their own calibration is not looked at but for the size.

        Raises:
            ValueError: if the pair has another size than the calibration of this rectifier.
        """
        size, came = self.calibration.left.size, pair.calibration.left.size
        if came != size:
            raise ValueError(
                f"pair is {came[0]} x {came[1]} but the rectifier is for "
                f"{size[0]} x {size[1]} (width x height); was the pair resized or cropped?"
            )
        left, right = self._maps
        return RectifiedPair(_warped(pair.left, left), _warped(pair.right, right), self.geometry)

    @cached_property
    def rotations(self) -> tuple[Array, Array]:
        """The (3, 3) rotations of left and right, to the rectified frame from the raw one."""
        return rectifying_rotations(self.calibration)

    @cached_property
    def geometry(self) -> RectifiedGeometry:
        """The geometry of the rectified pairs."""
        baseline_m = self._baseline_m()
        left, right = (
            _Extent.of(camera, R) for camera, R in zip(self._cameras, self.rotations, strict=True)
        )
        if self.common_centre:
            left, right = (left.joined(right, axes=(0, 1)),) * 2
        else:
            left, right = left.joined(right, axes=(1,)), right.joined(left, axes=(1,))
        focal_px = self._focal_px(left, right)
        centre_left, centre_right = (self._centre(extent, focal_px) for extent in (left, right))
        return RectifiedGeometry(
            size=self._output_size,
            focal_px=focal_px,
            centre_left=centre_left,
            centre_right=centre_right,
            baseline_m=baseline_m,
        )

    def points(self, pixels: Array, view: Literal["left", "right"]) -> Array:
        """Return where pixels of a raw view lie in the rectified one.

        Args:
            pixels: (N, 2), (x, y) in the raw view.
            view: which camera saw them.

        Returns:
            (N, 2) pixels, also outside the image; NaN for what the rectified view cannot see.
        """
        side = ("left", "right").index(view)
        rays = self._cameras[side].unproject(pixels) @ self.rotations[side].T
        return self._rectified_camera(side).project(rays)

    @property
    def _cameras(self) -> tuple[Camera, Camera]:
        return self.calibration.left, self.calibration.right

    @property
    def _output_size(self) -> tuple[int, int]:
        width, height = self.calibration.left.size
        return self.size or (max(1, round(width * self.scale)), max(1, round(height * self.scale)))

    def _baseline_m(self) -> float:
        """Return the baseline; raise ValueError unless the right camera is at the right."""
        t = self.rotations[1] @ self.calibration.right_from_left.t  # along one axis by now
        P_left, P_right = np.eye(3, 4), np.column_stack([np.eye(3), t])
        unit = RectifiedGeometry.from_projections(P_left, P_right, self.calibration.left.size)
        return unit.baseline_m

    def _focal_px(self, left: _Extent, right: _Extent) -> float:
        size = np.array(self._output_size)
        scale = (size / self.calibration.left.size).min()
        raw_px = float(np.mean([camera.K[[0, 1], [0, 1]] for camera in self._cameras]) * scale)
        if self.alpha is None:
            return raw_px
        inner = np.minimum(left.inner[1] - left.inner[0], right.inner[1] - right.inner[0])
        outer = np.maximum(left.outer[1] - left.outer[0], right.outer[1] - right.outer[0])
        if not (inner * raw_px > SMALLEST_SHARE * size).all():
            raise ValueError(
                "the rectified views have hardly a rectangle in common that both images fill; "
                "are the cameras turned far apart, or is the calibration of another rig? "
                "Otherwise try common_centre=False or alpha=None"
            )
        filled, whole = (size / inner).max(), (size / outer).min()
        return float((1 - self.alpha) * filled + self.alpha * whole)

    def _centre(self, extent: _Extent, focal_px: float) -> tuple[float, float]:
        """Return the principal point that puts the middle of `extent` into that of the image."""
        alpha = self.alpha or 0.0
        middle = (1 - alpha) * extent.inner.mean(axis=0) + alpha * extent.outer.mean(axis=0)
        x, y = (np.array(self._output_size) - 1) / 2 - focal_px * middle
        return float(x), float(y)

    def _rectified_camera(self, side: int) -> Camera:
        f = self.geometry.focal_px
        cx, cy = (self.geometry.centre_left, self.geometry.centre_right)[side]
        K = np.array([[f, 0, cx], [0, f, cy], [0, 0, 1]])
        return Camera(self.geometry.size, K, np.zeros(0))

    @cached_property
    def _maps(self) -> tuple[Map, Map]:
        """Where each pixel of the left and right rectified view lies in the raw one."""
        left, right = (
            _raw_pixels(self._cameras[side], self.rotations[side], self._rectified_camera(side))
            for side in (0, 1)
        )
        return left, right


def rectifying_rotations(rig: StereoCalibration) -> tuple[Array, Array]:
    """Return the (3, 3) rotations of left and right, to the rectified frame from the raw one."""
    no_lens = np.zeros(5)  # the rotations depend on the poses alone
    R_left, R_right, *_ = cv2.stereoRectify(
        rig.left.K,
        no_lens,
        rig.right.K,
        no_lens,
        rig.left.size,
        rig.right_from_left.R,
        rig.right_from_left.t.reshape(3, 1),  # OpenCV 5 does not take (3,)
    )
    return np.asarray(R_left, dtype=np.float64), np.asarray(R_right, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class _Extent:
    """What a raw image covers of the rectified plane z = 1.

    Attributes:
        inner: (2, 2), lowest and highest (x, y) of a rectangle that the image fills.
        outer: (2, 2), lowest and highest (x, y) of the whole image.
    """

    inner: Array
    outer: Array

    @classmethod
    def of(cls, camera: Camera, R: Array) -> _Extent:
        """Return the extent of the image of a camera turned by `R`, outer edges of its pixels."""
        width, height = camera.size
        x, y = (np.linspace(-0.5, pixels - 0.5, BORDER_SAMPLES) for pixels in (width, height))
        at_start, at_right, at_bottom = (
            np.full_like(x, edge) for edge in (-0.5, width - 0.5, height - 0.5)
        )
        left, top, right, bottom = (
            _rectified_plane(camera, R, np.column_stack(side))
            for side in ((at_start, y), (x, at_start), (at_right, y), (x, at_bottom))
        )
        inner = [
            [np.nanmax(left[:, 0]), np.nanmax(top[:, 1])],
            [np.nanmin(right[:, 0]), np.nanmin(bottom[:, 1])],
        ]
        border = np.concatenate([left, top, right, bottom])
        outer = [np.nanmin(border, axis=0), np.nanmax(border, axis=0)]
        return cls(np.array(inner), np.array(outer))

    def joined(self, other: _Extent, *, axes: tuple[int, ...]) -> _Extent:
        """Return what both fill and what either covers, along `axes` (0 is x, 1 is y)."""
        inner, outer = self.inner.copy(), self.outer.copy()
        for axis in axes:
            inner[0, axis] = max(self.inner[0, axis], other.inner[0, axis])
            inner[1, axis] = min(self.inner[1, axis], other.inner[1, axis])
            outer[0, axis] = min(self.outer[0, axis], other.outer[0, axis])
            outer[1, axis] = max(self.outer[1, axis], other.outer[1, axis])
        return _Extent(inner, outer)


def _rectified_plane(camera: Camera, R: Array, pixels: Array) -> Array:
    """Return (N, 2) on the rectified plane z = 1; NaN for what it cannot show."""
    rays = camera.unproject(pixels) @ R.T
    forward = np.where(rays[:, 2] > 0, rays[:, 2], np.nan)
    plane: Array = rays[:, :2] / forward[:, None]
    if not np.isfinite(plane).any():
        raise ValueError(
            "the rectified view does not see a border of the raw image; are the cameras turned far "
            "apart, or is the lens distortion that of another camera or model?"
        )
    return plane


def _raw_pixels(camera: Camera, R: Array, rectified: Camera) -> Map:
    """Return (2, H, W) float32: the raw x and the raw y of each pixel of the rectified view."""
    if camera.model == "fisheye":
        x, y = cv2.fisheye.initUndistortRectifyMap(
            camera.K, camera.distortion[:, None], R, rectified.K, rectified.size, cv2.CV_32FC1
        )
    else:
        x, y = cv2.initUndistortRectifyMap(
            camera.K, camera.distortion, R, rectified.K, rectified.size, cv2.CV_32FC1
        )
    raw = np.stack([x, y]).astype(np.float32)
    # The outer half of a border pixel belongs to the image: remap would blend it with black.
    last = np.array(camera.size, dtype=np.float32)[:, None, None] - 1
    inside = np.clip(raw, 0, last)
    raw = np.where(np.abs(raw - inside) <= 0.5 + BORDER_TOLERANCE_PX, inside, raw)
    return np.where(camera.can_see(_rays(rectified) @ R), raw, OUTSIDE_PX)


def _rays(camera: Camera) -> Array:
    """Return (H, W, 3), the rays of all pixels of a camera without lens distortion."""
    (width, height), K = camera.size, camera.K
    x = (np.arange(width) - K[0, 2]) / K[0, 0]
    y = (np.arange(height) - K[1, 2]) / K[1, 1]
    return np.stack(np.broadcast_arrays(x[None, :], y[:, None], 1.0), axis=-1)


def _warped(image: Image, raw: Map) -> Image:
    x, y = raw
    warped = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    return np.asarray(warped, dtype=np.uint8)
