"""Two photographs taken together, before and after rectification."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from calib.rig import RectifiedGeometry, StereoCalibration

__all__ = ["Image", "RectifiedPair", "StereoPair"]

Image = npt.NDArray[np.uint8]


def _check_image(image: Image, name: str, size: tuple[int, int], source: str) -> None:
    """Raise ValueError unless `image` is (H, W, 3) uint8 of `size` (width, height)."""
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
        raise ValueError(
            f"{name} image must be (H, W, 3) uint8 RGB, got {image.shape} {image.dtype}"
        )
    came = (image.shape[1], image.shape[0])
    if came != size:
        raise ValueError(
            f"{name} image is {came[0]} x {came[1]} but the {source} is for "
            f"{size[0]} x {size[1]} (width x height); was the pair resized or cropped?"
        )


@dataclass(frozen=True, eq=False)
class StereoPair:
    """Raw photographs and the calibration of the rig that took them.

    Attributes:
        left: (H, W, 3) uint8 RGB.
        right: (H, W, 3) uint8 RGB, of the same size.
        calibration: of the cameras, for this image size.
    """

    left: Image
    right: Image
    calibration: StereoCalibration

    def __post_init__(self) -> None:
        _check_image(self.left, "left", self.calibration.left.size, "calibration")
        _check_image(self.right, "right", self.calibration.right.size, "calibration")


@dataclass(frozen=True, eq=False)
class RectifiedPair:
    """Photographs whose rows agree, with their geometry.

    Attributes:
        left: (H, W, 3) uint8 RGB.
        right: (H, W, 3) uint8 RGB, of the same size.
        geometry: of this image size.
    """

    left: Image
    right: Image
    geometry: RectifiedGeometry

    def __post_init__(self) -> None:
        _check_image(self.left, "left", self.geometry.size, "calibration")
        _check_image(self.right, "right", self.geometry.size, "calibration")

    def resized(self, size: tuple[int, int]) -> RectifiedPair:
        """Return both images at another size, and their geometry with them.

        Args:
            size: (width, height) in pixels, of nearly the same proportions.

        Raises:
            ValueError: if the proportions differ by more than a pixel.
        """
        geometry = self.geometry.resized(size)
        how = cv2.INTER_AREA if size[0] <= self.geometry.size[0] else cv2.INTER_CUBIC
        left, right = (
            np.asarray(cv2.resize(image, size, interpolation=how), dtype=np.uint8)
            for image in (self.left, self.right)
        )
        return RectifiedPair(left, right, geometry)
