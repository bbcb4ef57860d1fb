"""How the camera moved between two frames, estimated from their colours and depths."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from calib.pose import Pose, nearest_rotation
from recon.fusion import DepthView
from recon.open3d_library import loaded_open3d
from recon.types import Array

__all__ = ["LABEL", "Drift", "Step", "drift_between", "estimated_step"]

LABEL = "poses estimated frame to frame; they drift"
ITERATIONS = (30, 20, 20)
LEAST_FITNESS = 0.3
"""Share of the pixels with depth in both views that must agree; a wrong step has hardly any."""
OUTLIER_SIGMAS = 4.0
HUBER_SHARE = 0.5
MOST_TURNED = math.radians(40)


@dataclass(frozen=True)
class Step:
    """One step of the camera.

    Attributes:
        before_from_after: the pose of the later camera in the frame of the earlier one.
        fitness: share of the pixels of the later view that the earlier one explains.
        rmse_m: of their depths, metres.
    """

    before_from_after: Pose
    fitness: float
    rmse_m: float


@dataclass(frozen=True)
class Drift:
    """How far two estimates of the last pose lie apart: through all steps, and directly.

    Attributes:
        metres: between the two places.
        radians: between the two directions.
        fitness: of the direct estimate.
    """

    metres: float
    radians: float
    fitness: float


def drift_between(first: DepthView, last: DepthView) -> Drift | None:
    """Return how far the steps have drifted, None if the last view does not see what the first saw.

    Args:
        first: placed.
        last: placed by all steps between.
    """
    through = first.world_from_camera.inverse() @ last.world_from_camera
    direct = _step(first, last, through)
    if direct.fitness < LEAST_FITNESS:
        return None
    apart = direct.before_from_after.inverse() @ through
    turn = float(np.linalg.norm(apart.values[:3]))
    return Drift(float(np.linalg.norm(apart.t)), turn, direct.fitness)


def estimated_step(
    before: DepthView, after: DepthView, *, first_guess: Pose, names: tuple[str, str]
) -> Step:
    """Estimate how a camera moved from colours and depths together.

    Source: Park, Zhou & Koltun, ICCV 2017 (the hybrid error), as open3d has it, coarse to fine.

    Args:
        before: the earlier view; its pose is not looked at.
        after: the later one.
        first_guess: the later camera in the frame of the earlier one, such as the last step.
        names: of both frames, for the message.

    Raises:
        ValueError: if the views hardly agree after the best motion that was found.
        ImportError: if open3d cannot be loaded.
    """
    candidates = [_step(before, after, guess) for guess in (first_guess, Pose.identity())]
    best = max(candidates, key=lambda step: step.fitness)
    turn = float(np.linalg.norm(best.before_from_after.values[:3]))
    if not best.fitness >= LEAST_FITNESS or turn > MOST_TURNED:
        raise ValueError(
            f"the motion from frame {names[0]} to {names[1]} could not be estimated: only "
            f"{best.fitness:.0%} of the depths agree after the best motion found (at least "
            f"{LEAST_FITNESS:.0%} expected); do the frames follow each other closely? "
            "Otherwise give the poses with --poses"
        )
    return best


def _step(before: DepthView, after: DepthView, guess: Pose) -> Step:
    o3d = loaded_open3d()
    odometry = o3d.t.pipelines.odometry
    depths = [_within(view) for view in (before, after)]
    far = float(max(np.nanmax(depth, initial=0.0) for depth in depths))
    sigma = float(np.nanmedian(replace(after, depth=depths[1]).sigma_m)) if far else 1.0
    truncation = OUTLIER_SIGMAS * sigma
    try:
        found = odometry.rgbd_odometry_multi_scale(
            _rgbd(o3d, after.image, depths[1]),
            _rgbd(o3d, before.image, depths[0]),
            o3d.core.Tensor(after.K),
            o3d.core.Tensor(_matrix(guess)),
            1.0,
            far + 1.0,
            [odometry.OdometryConvergenceCriteria(count) for count in ITERATIONS],
            odometry.Method.Hybrid,
            odometry.OdometryLossParams(truncation, HUBER_SHARE * truncation, 0.1),
        )
    except RuntimeError:  # of too few pixels that agree: a singular system
        return Step(Pose.identity(), 0.0, float("nan"))
    matrix = found.transformation.numpy()
    fitness, rmse = float(found.fitness), float(found.inlier_rmse)
    if not np.isfinite(matrix).all():
        return Step(Pose.identity(), 0.0, rmse)
    return Step(Pose(nearest_rotation(matrix[:3, :3]), matrix[:3, 3]), fitness, rmse)


def _within(view: DepthView) -> Array:
    """Return the depths (H, W) that are precise enough to tell a motion."""
    median = float(np.nanmedian(view.depth)) if np.isfinite(view.depth).any() else 0.0
    near_enough = np.nan_to_num(view.depth, nan=np.inf) <= 2 * median
    return np.where(near_enough, view.depth, np.nan).astype(np.float32)


def _rgbd(o3d: object, image: Array, depth: Array) -> object:
    geometry, tensor = o3d.t.geometry, o3d.core.Tensor  # type: ignore[attr-defined]
    metres = np.nan_to_num(depth)[..., None]
    colours = image.astype(np.float32) / 255
    return geometry.RGBDImage(
        geometry.Image(tensor(np.ascontiguousarray(colours))),
        geometry.Image(tensor(np.ascontiguousarray(metres))),
    )


def _matrix(pose: Pose) -> Array:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = pose.R, pose.t
    return matrix
