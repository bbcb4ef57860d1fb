"""What is known about a stereo rig: as it was built, and as it is after rectification."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from calib.camera import Camera
from calib.pose import Pose

__all__ = ["RectifiedGeometry", "StereoCalibration"]

Array = npt.NDArray[np.float64]

CENTRE_TOLERANCE_PX = 1e-3
FOCAL_TOLERANCE = 1e-3  # relative; files round, and some cameras give fx and fy apart


@dataclass(frozen=True, eq=False)
class StereoCalibration:
    """Two cameras and where they stand, before rectification.

    Attributes:
        left: the reference camera.
        right: the other camera, with the same image size.
        right_from_left: maps points of the left camera frame into the right one, in metres.

    Raises:
        ValueError: if the sizes differ or the cameras stand in the same place.
    """

    left: Camera
    right: Camera
    right_from_left: Pose

    def __post_init__(self) -> None:
        if self.left.size != self.right.size:
            raise ValueError(
                f"left camera has {self.left.size} pixels, right camera {self.right.size} "
                "(width, height); both must have the same size"
            )
        if not self.baseline_m > 0:
            raise ValueError("baseline must be positive, got 0 m; is the translation missing?")

    @property
    def baseline_m(self) -> float:
        """Distance between the two centres of projection."""
        return float(math.sqrt(sum(float(t) ** 2 for t in self.right_from_left.t)))

    def resized(self, size: tuple[int, int]) -> StereoCalibration:
        """Return the calibration of the same rig after resizing its images to `size`.

        Args:
            size: new (width, height).
        """
        return replace(self, left=self.left.resized(size), right=self.right.resized(size))


@dataclass(frozen=True)
class RectifiedGeometry:
    """A rig whose rows agree: all that is needed to turn a disparity into metres.

    Z = f B / (d - d_inf), with d_inf = cx_left - cx_right the disparity of a point at infinity.

    Attributes:
        size: (width, height) of both images in pixels.
        focal_px: focal length f of both views.
        centre_left: principal point (cx, cy) of the left view; (0, 0) is the centre of a pixel.
        centre_right: the same for the right view, with the same cy.
        baseline_m: distance B from the left to the right centre of projection.

    Raises:
        ValueError: if a value cannot be; the message says which and why.
    """

    size: tuple[int, int]
    focal_px: float
    centre_left: tuple[float, float]
    centre_right: tuple[float, float]
    baseline_m: float

    def __post_init__(self) -> None:
        if min(self.size) < 1:
            raise ValueError(f"image size must be positive, got {self.size} (width, height)")
        if not (math.isfinite(self.focal_px) and self.focal_px > 0):
            raise ValueError(f"focal length must be positive, got {self.focal_px} px")
        if not (math.isfinite(self.baseline_m) and self.baseline_m > 0):
            raise ValueError(
                f"baseline must be positive, got {self.baseline_m:g} m; "
                "are the left and right cameras swapped?"
            )
        if abs(self.centre_left[1] - self.centre_right[1]) > CENTRE_TOLERANCE_PX:
            raise ValueError(
                f"principal points lie in rows {self.centre_left[1]:g} and "
                f"{self.centre_right[1]:g} px, but rows of a rectified pair agree; "
                "is this the calibration of the raw images?"
            )

    @classmethod
    def from_projections(
        cls, left: Array, right: Array, size: tuple[int, int]
    ) -> RectifiedGeometry:
        """Return the geometry that a pair of projection matrices describes.

        P = K [I | t], so the camera stands at x = -P[0, 3] / f and B = (P_l[0, 3] - P_r[0, 3]) / f.

        Args:
            left: (3, 4), with lengths in metres.
            right: (3, 4), with the same focal length.
            size: (width, height) of both images.

        Raises:
            ValueError: if the matrices are not those of a rectified pair side by side.
        """
        if left.shape != (3, 4) or right.shape != (3, 4):
            raise ValueError(f"projections must be (3, 4), got {left.shape} and {right.shape}")
        focal = float(left[0, 0])
        others = np.array([left[1, 1], right[0, 0], right[1, 1]])
        if not np.abs(others - focal).max() <= FOCAL_TOLERANCE * abs(focal):
            raise ValueError(
                f"focal lengths of a rectified pair agree, got {focal:g}, {others[0]:g}, "
                f"{others[1]:g}, {others[2]:g} px (left x, y, right x, y); "
                "is this the calibration of the raw images?"
            )
        along = left[:2, 3] - right[:2, 3]
        if abs(along[1]) > abs(along[0]):
            raise ValueError(
                "cameras stand one above the other; only pairs side by side can be matched: "
                "turn the images and the calibration by 90 degrees"
            )
        return cls(
            size=size,
            focal_px=focal,
            centre_left=(float(left[0, 2]), float(left[1, 2])),
            centre_right=(float(right[0, 2]), float(right[1, 2])),
            baseline_m=float(along[0]) / focal,
        )

    @property
    def disparity_at_infinity(self) -> float:
        """Disparity d_inf = cx_left - cx_right in pixels (Middlebury's doffs, negated)."""
        return self.centre_left[0] - self.centre_right[0]

    def resized(self, size: tuple[int, int]) -> RectifiedGeometry:
        """Return the geometry of the same pair after resizing the images to `size`.

        Pixel centres are whole numbers, so c' = (c + 0.5) s - 0.5.

        Args:
            size: new (width, height), of nearly the same proportions.

        Raises:
            ValueError: if width and height are scaled differently by more than a pixel.
        """
        scale_x, scale_y = size[0] / self.size[0], size[1] / self.size[1]
        if abs(self.size[1] * scale_x - size[1]) > 1:
            raise ValueError(
                f"cannot resize {self.size} to {size} (width, height): proportions differ"
            )

        def moved(centre: tuple[float, float]) -> tuple[float, float]:
            return (centre[0] + 0.5) * scale_x - 0.5, (centre[1] + 0.5) * scale_y - 0.5

        return replace(
            self,
            size=size,
            focal_px=self.focal_px * scale_x,
            centre_left=moved(self.centre_left),
            centre_right=moved(self.centre_right),
        )

    def cropped(self, corner: tuple[int, int], size: tuple[int, int]) -> RectifiedGeometry:
        """Return the geometry of the same window cut out of both images.

        Args:
            corner: (x, y) of the window's top-left pixel.
            size: (width, height) of the window.

        Raises:
            ValueError: if the window leaves the image.
        """
        ends = corner[0] + size[0], corner[1] + size[1]
        if min(corner) < 0 or ends[0] > self.size[0] or ends[1] > self.size[1]:
            raise ValueError(
                f"window of {size} (width, height) at {corner} (x, y) leaves the image, "
                f"which has {self.size} pixels"
            )
        (left_x, left_y), (right_x, right_y) = self.centre_left, self.centre_right
        return replace(
            self,
            size=size,
            centre_left=(left_x - corner[0], left_y - corner[1]),
            centre_right=(right_x - corner[0], right_y - corner[1]),
        )
