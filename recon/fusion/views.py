"""A depth map, the camera that saw it, and how wrong its depths are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.pose import Pose
from calib.rig import RectifiedGeometry
from recon.types import Array

__all__ = ["KINECT_NOISE", "DepthNoise", "DepthView", "stereo_noise"]


@dataclass(frozen=True)
class DepthNoise:
    """Standard deviation of a depth z: sigma(z) = base_m + growth_per_m (z - nearest_m)^2.

    Attributes:
        base_m: the least it is.
        growth_per_m: how fast it grows.
        nearest_m: the depth where it is least.

    Raises:
        ValueError: if it would not be positive.
    """

    base_m: float
    growth_per_m: float
    nearest_m: float = 0.0

    def __post_init__(self) -> None:
        if self.base_m < 0 or self.growth_per_m < 0 or not self.base_m + self.growth_per_m > 0:
            raise ValueError(
                "the error of a depth must be positive, got "
                f"{self.base_m} m + {self.growth_per_m}/m (z - {self.nearest_m} m)^2"
            )

    def sigma_m(self, depth: Array) -> Array:
        """Return the standard deviation of depths, metres, of the shape of `depth`."""
        sigma: Array = self.base_m + self.growth_per_m * np.square(depth - self.nearest_m)
        return sigma


KINECT_NOISE = DepthNoise(0.0012, 0.0019, 0.4)
"""Of structured light: Nguyen, Izadi & Lovell, 3DIMPVT 2012, section 3 (axial noise)."""


def stereo_noise(geometry: RectifiedGeometry, disparity_sigma_px: float = 1.0) -> DepthNoise:
    """Return the error of depths from disparities, sigma_Z = Z^2 / (f B) sigma_d.

    Args:
        geometry: of the pair.
        disparity_sigma_px: standard deviation of the disparities, pixels; 1 where each pixel has
            its own, the `noise_times` of a view.
    """
    return DepthNoise(0.0, disparity_sigma_px / (geometry.focal_px * geometry.baseline_m))


@dataclass(frozen=True, eq=False)
class DepthView:
    """What one camera saw from where it stood.

    Attributes:
        depth: (H, W) float32 metres, NaN where it is unknown.
        trust: (H, W) float32 in [0, 1], probability that the depth is right.
        image: (H, W, 3) uint8 RGB.
        K: (3, 3), [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels.
        noise: the error of a right depth.
        world_from_camera: where the camera stands.
        noise_times: (H, W) float32, how many times `noise` the depth of each pixel errs; None means
            once.

    Raises:
        ValueError: if the shapes do not agree.
    """

    depth: Array
    trust: Array
    image: Array
    K: Array
    noise: DepthNoise
    world_from_camera: Pose
    noise_times: Array | None = None

    def __post_init__(self) -> None:
        shape = self.depth.shape
        if self.trust.shape != shape or self.image.shape != (*shape, 3):
            raise ValueError(
                f"depth is {shape}, trust {self.trust.shape} and the image {self.image.shape}; "
                "expected (H, W), (H, W) and (H, W, 3)"
            )
        if self.noise_times is not None and self.noise_times.shape != shape:
            raise ValueError(f"depth is {shape} but noise_times {self.noise_times.shape}")
        if self.K.shape != (3, 3):
            raise ValueError(f"K must be (3, 3), got {self.K.shape}")

    @property
    def times(self) -> Array:
        """(H, W) float32, how many times `noise` the depth of each pixel errs."""
        if self.noise_times is None:
            return np.ones(self.depth.shape, np.float32)
        return self.noise_times.astype(np.float32, copy=False)

    @property
    def sigma_m(self) -> Array:
        """(H, W) standard deviation of every depth, metres; NaN where there is none."""
        sigma: Array = self.noise.sigma_m(self.depth.astype(np.float64)) * self.times
        return sigma

    def positions(self, pixels: Array) -> Array:
        """Return where pixels lie in the world.

        Args:
            pixels: (H, W) bool; their depth must be finite.

        Returns:
            (N, 3) float64 metres, in row order.
        """
        row, column = np.nonzero(pixels)
        z = self.depth[row, column].astype(np.float64)
        x = (column - self.K[0, 2]) / self.K[0, 0] * z
        y = (row - self.K[1, 2]) / self.K[1, 1] * z
        return self.world_from_camera.apply(np.stack([x, y, z], axis=1))
