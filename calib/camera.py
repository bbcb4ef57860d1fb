"""One camera: which ray a pixel sees, and which pixel sees a point."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt

__all__ = ["LENSES", "Camera", "CameraModel", "LensName"]

Array = npt.NDArray[np.float64]
CameraModel = Literal["pinhole", "fisheye"]
LensName = Literal["pinhole", "rational", "fisheye"]

COEFFICIENTS: dict[CameraModel, tuple[int, ...]] = {
    "pinhole": (0, 4, 5, 8, 12, 14),
    "fisheye": (4,),
}
ALL_COEFFICIENTS = 14
LENSES: dict[LensName, tuple[CameraModel, int]] = {
    "pinhole": ("pinhole", 5),
    "rational": ("pinhole", 8),
    "fisheye": ("fisheye", 4),
}
"""The lenses that people choose between: their model and how many coefficients they have."""
WIDEST_TANGENT = 100.0  # of the angle to the axis; 89.4 degrees
NEWTON_STEPS = 15
NEWTON_STEP_SIZE = 1e-6  # of the numerical derivative, on the plane z = 1
CONVERGED_PX = 1e-10
UNPROJECT_TOLERANCE_PX = 1e-4


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera with its lens, in OpenCV's models.

    Attributes:
        size: (width, height) in pixels.
        K: (3, 3) float64, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels; (0, 0) is the centre of
            a pixel.
        distortion: (n,) float64 in OpenCV's order: for a pinhole 0, 4 (k1 k2 p1 p2), 5 (k3), 8
            (rational, k4 k5 k6), 12 (thin prism, s1 s2 s3 s4) or 14 (tilt, tx ty) coefficients,
            for a fisheye 4.
        model: "pinhole", or "fisheye" (equidistant with a polynomial in the angle).

    Raises:
        ValueError: if a value cannot be; the message says which and why.
    """

    size: tuple[int, int]
    K: Array
    distortion: Array
    model: CameraModel = "pinhole"

    def __post_init__(self) -> None:
        object.__setattr__(self, "K", np.array(self.K, dtype=np.float64))
        object.__setattr__(self, "distortion", np.array(self.distortion, dtype=np.float64))
        if min(self.size) < 1:
            raise ValueError(f"image size must be positive, got {self.size} (width, height)")
        _check_matrix(self.K)
        _check_distortion(self.distortion, self.model)

    def project(self, points: Array) -> Array:
        """Return the pixels that see points.

        Args:
            points: (N, 3) in the frame of the camera, metres.

        Returns:
            (N, 2) pixels (x, y), also outside the image; NaN for points that the lens cannot see.
        """
        depth = np.where(self.can_see(points), points[:, 2], np.nan)
        return self._project_plane(points[:, :2] / depth[:, None])

    def can_see(self, points: Array) -> npt.NDArray[np.bool_]:
        """Return which points the lens can see, in the image or beside it.

        The polynomials are fitted to what is inside the image. Further out they may turn back and
        would mirror the outside into the image.

        Args:
            points: (..., 3) in the frame of the camera.

        Returns:
            (...) bool, True for points in front, up to the angle at which the lens turns back.
        """
        x, y, z = np.moveaxis(points, -1, 0)
        visible: npt.NDArray[np.bool_] = (z > 0) & (np.hypot(x, y) <= self._widest * z)
        return visible

    def unproject(self, pixels: Array) -> Array:
        """Return the rays that pixels see, the inverse of `project`.

        OpenCV's fixed-point iteration gives the start; Newton's steps with a numerical Jacobian J
        of the projection p, x <- x - J^-1 (p(x) - pixel), make it exact.

        Args:
            pixels: (N, 2), (x, y).

        Returns:
            (N, 3) points of the rays at z = 1; NaN where the lens has no such ray.
        """
        plane = self._first_guess(pixels)  # (N, 2) on z = 1
        error = np.full(len(plane), np.inf)
        wrong = np.arange(len(plane))
        for _ in range(NEWTON_STEPS):
            residual = self._project_plane(plane[wrong]) - pixels[wrong]
            error[wrong] = np.hypot(*residual.T)
            far = error[wrong] > CONVERGED_PX
            wrong = wrong[far]
            if not len(wrong):
                break
            plane[wrong] -= self._newton_step(plane[wrong], residual[far])
        lost = ~(error < UNPROJECT_TOLERANCE_PX) | (np.hypot(*plane.T) > self._widest)
        plane[lost] = np.nan
        return np.column_stack([plane, np.where(lost, np.nan, 1.0)])

    def resized(self, size: tuple[int, int]) -> Camera:
        """Return the same camera after resizing its images to `size`.

        Pixel centres are whole numbers, so c' = (c + 0.5) s - 0.5.

        Args:
            size: new (width, height).
        """
        scale = np.array(size) / np.array(self.size)
        K = self.K.copy()
        K[0, 0], K[1, 1] = self.K[[0, 1], [0, 1]] * scale
        K[:2, 2] = (self.K[:2, 2] + 0.5) * scale - 0.5
        return replace(self, size=size, K=K)

    @cached_property
    def _widest(self) -> float:
        """Distance from the axis, on z = 1, at which the radial polynomial turns back."""
        distance = np.tan(np.linspace(0, np.arctan(WIDEST_TANGENT), 2000))
        radial = self.distortion.copy()
        if self.model == "pinhole":
            radial[2:4] = 0  # p1, p2
            radial[8:] = 0  # thin prism and tilt
        lens = replace(self, distortion=radial)
        bent = lens._distorted(np.column_stack([distance, np.zeros_like(distance)]))[:, 0]
        back = np.flatnonzero(np.diff(bent) <= 0)
        return float(distance[back[0]]) if len(back) else WIDEST_TANGENT

    def _project_plane(self, plane: Array) -> Array:
        """Return the pixels of points (N, 2) of the plane z = 1."""
        pixels: Array = self._distorted(plane) * self.K[[0, 1], [0, 1]] + self.K[:2, 2]
        return pixels

    def _distorted(self, plane: Array) -> Array:
        if self.model == "fisheye":
            return _fisheye(plane, self.distortion)
        return _pinhole(plane, self.distortion) if self.distortion.size else plane

    def _first_guess(self, pixels: Array) -> Array:
        if len(pixels) == 0:
            return np.zeros((0, 2))
        source = np.array(pixels, dtype=np.float64).reshape(-1, 1, 2)
        if self.model == "fisheye":
            plane = cv2.fisheye.undistortPoints(source, self.K, self.distortion[:, None])
        else:
            plane = cv2.undistortPoints(source, self.K, self.distortion)
        return np.asarray(plane, dtype=np.float64).reshape(-1, 2)

    def _newton_step(self, plane: Array, residual: Array) -> Array:
        """Return (N, 2), what to subtract from points of the plane z = 1."""
        h = NEWTON_STEP_SIZE
        columns = [
            (self._project_plane(plane + shift) - self._project_plane(plane - shift)) / (2 * h)
            for shift in ((h, 0.0), (0.0, h))
        ]
        (a, b), (c, d) = np.moveaxis(np.stack(columns, axis=-1), 0, -1)  # J, each (N,)
        x, y = residual.T
        with np.errstate(all="ignore"):  # NaN where the lens turns back
            step: Array = np.stack([d * x - b * y, a * y - c * x], axis=-1)
            step /= (a * d - b * c)[:, None]
        return step


def _pinhole(plane: Array, distortion: Array) -> Array:
    """Bend points (N, 2) of the plane z = 1 as the lens of a pinhole camera does.

    With r the distance from the axis, x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 +
    k5 r^4 + k6 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2) + s1 r^2 + s2 r^4, and y' likewise; then the
    sensor is tilted by the angles tx and ty.

    Source: OpenCV documentation, Camera Calibration and 3D Reconstruction.
    """
    k = np.zeros(ALL_COEFFICIENTS)
    k[: len(distortion)] = distortion
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, *tilt = k
    x, y = plane.T
    with np.errstate(all="ignore"):  # far outside the image, in vain steps of Newton
        r2 = x * x + y * y
        radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        bent_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (s1 + r2 * s2)
        bent_y = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + r2 * (s3 + r2 * s4)
    bent = np.column_stack([bent_x, bent_y])
    return _tilted(bent, *tilt) if any(tilt) else bent


def _tilted(plane: Array, about_x: float, about_y: float) -> Array:
    """Return points (N, 2) as a sensor turned by two angles (radians) sees them."""
    (sx, sy), (cx, cy) = np.sin([about_x, about_y]), np.cos([about_x, about_y])
    R = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]]) @ [[1, 0, 0], [0, cx, sx], [0, -sx, cx]]
    onto_sensor = np.array([[R[2, 2], 0, -R[0, 2]], [0, R[2, 2], -R[1, 2]], [0, 0, 1]]) @ R
    seen = plane @ onto_sensor[:, :2].T + onto_sensor[:, 2]
    bent: Array = seen[:, :2] / seen[:, 2:]
    return bent


def _fisheye(plane: Array, distortion: Array) -> Array:
    """Bend points (N, 2) of the plane z = 1 as a fisheye does.

    With a = atan(r) the angle to the axis, r' = a (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8).

    Source: Kannala & Brandt, IEEE TPAMI 2006, equation 6.
    """
    k1, k2, k3, k4 = distortion
    r = np.hypot(*plane.T)
    angle = np.arctan(r)
    a2 = angle * angle
    with np.errstate(all="ignore"):  # on the axis, and far out in vain steps
        scale = angle * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4)))) / r
        bent: Array = plane * np.where(r > 0, scale, 1.0)[:, None]
    bent[np.isnan(r)] = np.nan
    return bent


def _check_matrix(K: Array) -> None:
    if K.shape != (3, 3):
        raise ValueError(f"camera matrix must be (3, 3), got {K.shape}")
    if not np.isfinite(K).all():
        raise ValueError(f"camera matrix must be finite, got {K.tolist()}")
    if not (K[0, 0] > 0 and K[1, 1] > 0):
        raise ValueError(f"focal lengths must be positive, got {K[0, 0]:g} and {K[1, 1]:g} px")
    rest = K * [[0, 1, 0], [1, 0, 0], [1, 1, 1]] - [[0, 0, 0], [0, 0, 0], [0, 0, 1]]
    if np.abs(rest).max() > 0:
        raise ValueError(
            "camera matrix must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], "
            f"got {K.tolist()}; is it transposed, or does it have skew?"
        )


def _check_distortion(distortion: Array, model: CameraModel) -> None:
    if model not in COEFFICIENTS:
        raise ValueError(f"camera model must be one of {', '.join(COEFFICIENTS)}; got {model!r}")
    counts = COEFFICIENTS[model]
    if distortion.ndim != 1 or len(distortion) not in counts:
        raise ValueError(
            f"distortion of a {model} camera must have {', '.join(map(str, counts))} coefficients, "
            f"got shape {distortion.shape}"
        )
    if not np.isfinite(distortion).all():
        raise ValueError(f"distortion must be finite, got {distortion.tolist()}")
