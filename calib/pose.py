"""Where a camera stands: a rotation and a translation."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

__all__ = ["Pose", "nearest_rotation"]

Array = npt.NDArray[np.float64]

ROTATION_TOLERANCE = 1e-6
ROUNDING_TOLERANCE = 5e-3


@dataclass(frozen=True, eq=False)
class Pose:
    """A rigid motion x_b = R x_a + t, named `b_from_a`; hence `c_from_a = c_from_b @ b_from_a`.

    Attributes:
        R: (3, 3) float64, a rotation.
        t: (3,) float64, metres.

    Raises:
        ValueError: if a shape is wrong, a number is not finite or `R` is not a rotation.
    """

    R: Array
    t: Array

    def __post_init__(self) -> None:
        # Frozen dataclasses set through object; the copies keep the caller's arrays out.
        object.__setattr__(self, "R", np.array(self.R, dtype=np.float64))
        object.__setattr__(self, "t", np.array(self.t, dtype=np.float64))
        if self.t.shape != (3,):
            raise ValueError(f"translation must be (3,), got {self.t.shape}")
        if not np.isfinite(self.t).all():
            raise ValueError(f"translation must be finite, got {self.t.tolist()} m")
        error = _rotation_error(self.R)
        if error > ROTATION_TOLERANCE:
            raise ValueError(
                f"R must be a rotation, but R R^T differs from the identity by {error:.3g}; "
                "was it rounded, scaled or mixed up with another matrix?"
            )

    @classmethod
    def identity(cls) -> Pose:
        """Return the pose that moves nothing."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_values(cls, values: Array) -> Pose:
        """Return the pose of a rotation vector (radians) and a translation, (6,)."""
        R, _ = cv2.Rodrigues(values[:3, None])
        return cls(np.asarray(R, dtype=np.float64), values[3:])

    @property
    def values(self) -> Array:
        """Rotation vector and translation, (6,)."""
        turn, _ = cv2.Rodrigues(self.R)
        return np.concatenate([np.asarray(turn, dtype=np.float64).ravel(), self.t])

    def inverse(self) -> Pose:
        """Return `a_from_b` of this `b_from_a`: x_a = R^T (x_b - t)."""
        return Pose(self.R.T, -self.R.T @ self.t)

    def __matmul__(self, other: Pose) -> Pose:
        """Return the pose that applies `other` first, then this one."""
        return Pose(self.R @ other.R, self.R @ other.t + self.t)

    def apply(self, points: Array) -> Array:
        """Move points from the frame a to the frame b.

        Args:
            points: (N, 3), metres.

        Returns:
            (N, 3), metres.
        """
        moved: Array = points @ self.R.T + self.t
        return moved


def nearest_rotation(matrix: Array) -> Array:
    """Return the rotation that a matrix read from a file stands for.

    Files round: KITTI writes seven digits, some by hand three. With the singular value
    decomposition M = U S V^T the nearest rotation is U V^T. A matrix that is a rotation already
    is returned unchanged, so that what was written in full is read exactly.

    Args:
        matrix: (3, 3).

    Raises:
        ValueError: if it is further from a rotation than rounding can explain.
    """
    error = _rotation_error(matrix)
    if error <= ROTATION_TOLERANCE:
        return matrix
    if error > ROUNDING_TOLERANCE:
        raise ValueError(
            f"R is not a rotation: R R^T differs from the identity by {error:.3g}; "
            "is it a mirror, or were its numbers cut or mixed up?"
        )
    U, _, Vt = np.linalg.svd(matrix)
    rotation: Array = U @ Vt
    return rotation


def _rotation_error(matrix: Array) -> float:
    """Return how far `matrix` is from a rotation; infinite for mirrors and what is not finite."""
    if matrix.shape != (3, 3):
        raise ValueError(f"R must be (3, 3), got {matrix.shape}")
    if not np.isfinite(matrix).all() or np.linalg.det(matrix) <= 0:
        return float("inf")
    return float(np.abs(matrix @ matrix.T - np.eye(3)).max())
