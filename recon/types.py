"""The values passed from step to step. Read this file first.

Inside the matcher arrays are torch tensors on the device of the input; before and after it they
are NumPy arrays. `DisparityMap` exists on both sides, hence its type parameter.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Any, Generic, TypeVar

import numpy as np
import numpy.typing as npt
from torch import Tensor

from recon.kernels.shifts import diagonals

__all__ = [
    "Array",
    "CostVolume",
    "DisparityMap",
    "Mesh",
    "PixelStatus",
    "PointCloud",
    "Removal",
]

Array = npt.NDArray[Any]
ArrayT = TypeVar("ArrayT", Tensor, Array)

UNIT_LENGTH_TOLERANCE = 1e-3
"""How far the length of a normal may be from 1: it may have been stored in 16 bits."""


class PixelStatus(IntEnum):
    """What is known about the disparity of a pixel, and if it was not measured, why."""

    OUTSIDE = 0
    """No candidate: the other view does not see this column at any disparity searched."""
    MATCHED = 1
    """Measured, and both views agree."""
    OCCLUDED = 2
    """No disparity: the other view cannot see this point."""
    MISMATCHED = 3
    """No disparity: the other view sees this point, but the match was wrong."""
    FILLED_OCCLUSION = 4
    """Extrapolated from the background beside an occlusion or the border of the image."""
    FILLED_MISMATCH = 5
    """Interpolated between measured neighbours."""

    @classmethod
    def with_disparity(cls) -> tuple[PixelStatus, ...]:
        """Return the states in which a pixel has a disparity."""
        return cls.MATCHED, cls.FILLED_OCCLUSION, cls.FILLED_MISMATCH


@dataclass(frozen=True, eq=False)
class CostVolume:
    """How badly every pixel of the left view fits every candidate disparity.

    Attributes:
        cost: (H, W, D) float32; lower is better, +inf where a candidate has no cost.
        disparities: the D candidates d = x_left - x_right, in pixels.
        of_right: whether the pixels are those of the right view.
        origin: row and column of the first pixel in the view, of a strip or tile of it.
    """

    cost: Tensor
    disparities: range
    of_right: bool = False
    origin: tuple[int, int] = (0, 0)

    def __post_init__(self) -> None:
        if self.cost.ndim != 3 or self.cost.shape[2] != len(self.disparities):
            raise ValueError(
                f"cost volume is {tuple(self.cost.shape)} but there are "
                f"{len(self.disparities)} disparities; expected (H, W, D)"
            )

    def seen_from_right(self) -> CostVolume:
        """Return the same costs indexed by the pixels of the right view.

        A pair of pixels (x_left, x_right) has one cost, whichever view names it:
        right[y, x, d] = left[y, x + d, d].

        Returns:
            The volume of the right view with the same candidates; +inf where x + d leaves the
            left view.
        """
        diagonal = diagonals(self.cost, self.disparities)
        return CostVolume(diagonal, self.disparities, of_right=True)


@dataclass(frozen=True, eq=False)
class DisparityMap(Generic[ArrayT]):
    """The disparity of every pixel of one view, and how far to trust it.

    Attributes:
        values: (H, W) float32, d = x_left - x_right in pixels; NaN exactly where `status` says
            that there is none.
        status: (H, W) uint8, a `PixelStatus`.
        confidence: (H, W) float32 in [0, 1], after `recon.confidence.Confidence` the probability
            that the value is within 1 px of the truth; 0 where there is no disparity.
    """

    values: ArrayT
    status: ArrayT
    confidence: ArrayT

    def __post_init__(self) -> None:
        shapes = {tuple(field.shape) for field in (self.values, self.status, self.confidence)}
        if len(shapes) != 1 or len(next(iter(shapes))) != 2:
            raise ValueError(f"values, status and confidence must be (H, W), got {shapes}")
        present = has_disparity(self.status)
        if bool(((self.values == self.values) != present).any()):
            raise ValueError("values must be NaN exactly where the status has no disparity")

    @property
    def valid(self) -> ArrayT:
        """(H, W) bool: where there is a disparity."""
        return has_disparity(self.status)


def has_disparity(status: ArrayT) -> ArrayT:
    """Return where a status array says that there is a disparity.

    Args:
        status: any shape, uint8, a `PixelStatus`.
    """
    present: ArrayT = status < 0
    for state in PixelStatus.with_disparity():
        present = present | (status == int(state))
    return present


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Coloured points in the frame of the left rectified camera (x right, y down, z forward).

    Attributes:
        points: (N, 3) float32, metres, finite.
        colours: (N, 3) uint8 RGB.
        normals: (N, 3) float32, unit length, facing the camera that saw the point.
        confidence: (N,) float32 in [0, 1].
        depth_sigma_m: (N,) float32, expected standard deviation of the depth, metres.
        status: (N,) uint8, a `PixelStatus`.
    """

    points: Array
    colours: Array
    normals: Array
    confidence: Array
    depth_sigma_m: Array
    status: Array

    def __post_init__(self) -> None:
        count = len(self.points)
        expected = {
            "points": (count, 3),
            "colours": (count, 3),
            "normals": (count, 3),
            "confidence": (count,),
            "depth_sigma_m": (count,),
            "status": (count,),
        }
        for name, shape in expected.items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name} must be {shape}, got {getattr(self, name).shape}")
        if not np.isfinite(self.points).all():
            raise ValueError("points must be finite")
        lengths = np.linalg.norm(self.normals, axis=1)
        if not (np.abs(lengths - 1) <= UNIT_LENGTH_TOLERANCE).all():
            raise ValueError("normals must be of unit length, and none may be NaN")

    def __len__(self) -> int:
        return len(self.points)

    def chosen(self, which: Array) -> PointCloud:
        """Return some of the points, with all that is known of them.

        Args:
            which: (N,) bool, or indices (M,) in the order that is wanted.
        """
        return PointCloud(**{f.name: getattr(self, f.name)[which] for f in fields(self)})


@dataclass(frozen=True)
class Removal:
    """What a filter took away.

    Attributes:
        filter: its name, for people.
        removed: how many pixels or points.
        of: how many there were before it.
    """

    filter: str
    removed: int
    of: int

    @property
    def percent(self) -> float:
        """The share that was removed, 0 of nothing."""
        return 100 * self.removed / self.of if self.of else 0.0


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh in metres, in the frame of the left rectified camera.

    Attributes:
        vertices: (V, 3) float32, metres.
        faces: (F, 3) int32, indices of vertices, counter-clockwise seen from the camera.
        uv: (V, 2) float32 in [0, 1], from the left and from the top of the texture; None where
            there is no texture.
        texture: (H, W, 3) uint8 RGB; None if the surface was not seen by one camera alone.
        colours: (V, 3) uint8 RGB, the same colours at the vertices.
        normals: (V, 3) float32 of unit length, smooth, on the side from which faces are
            counter-clockwise.
    """

    vertices: Array
    faces: Array
    uv: Array | None
    texture: Array | None
    colours: Array
    normals: Array

    def __post_init__(self) -> None:
        count = len(self.vertices)
        expected = {"vertices": (count, 3), "colours": (count, 3), "normals": (count, 3)}
        if (self.uv is None) != (self.texture is None):
            raise ValueError("uv and texture belong together: give both, or None for both")
        if self.uv is not None:
            expected["uv"] = (count, 2)
        for name, shape in expected.items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name} must be {shape}, got {getattr(self, name).shape}")
        if self.faces.ndim != 2 or self.faces.shape[1] != 3:
            raise ValueError(f"faces must be (F, 3), got {self.faces.shape}")
        if len(self.faces) and not (self.faces.min() >= 0 and self.faces.max() < count):
            raise ValueError(f"faces name vertices outside [0, {count})")
