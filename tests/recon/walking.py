"""A generated scene that a rig walks by, drawn with exact poses and put on disk."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from rendered import VIEW, still_life_scene

from calib import Pose, RectifiedGeometry, write_calibration
from calib.formats import CalibrationRecord
from calib.trajectories import Trajectory, write_trajectory
from recon.files import write_image
from recon.training.composition import Scene
from recon.training.scenes import render
from recon.training.walks import seen_from

GEOMETRY = RectifiedGeometry(
    (VIEW.width, VIEW.height), VIEW.focal_px, VIEW.centre, VIEW.centre, VIEW.baseline_m
)
STEPS = 7


@dataclass(frozen=True, eq=False)
class Walk:
    """A scene in the world frame, where the left camera stood, and the pairs it saw."""

    scene: Scene
    poses: tuple[Pose, ...]
    pairs: tuple[tuple[np.ndarray, np.ndarray], ...]
    depths: tuple[np.ndarray, ...]


@cache
def walk(steps: int = STEPS) -> Walk:
    """Draw a rig that drives forward, a little to the right, and turns to the left."""
    scene = still_life_scene()
    poses = tuple(
        Pose.from_values(np.array([0, -0.01 * n, 0, 0.04 * n, 0.01 * n, 0.13 * n]))
        for n in range(steps)
    )
    samples = [render(seen_from(scene, pose), VIEW, samples=2) for pose in poses]
    noise = np.random.default_rng(4)

    def sensor(image):
        return (image.numpy() * 255 + noise.normal(0, 1.5, image.shape)).clip(0, 255).round()

    return Walk(
        scene,
        poses,
        tuple((sensor(s.left).astype(np.uint8), sensor(s.right).astype(np.uint8)) for s in samples),
        tuple(
            VIEW.focal_px * VIEW.baseline_m / s.disparity_left.numpy().astype(np.float32)
            for s in samples
        ),
    )


def on_disk(folder: Path, seen: Walk) -> Path:
    """Write left/, right/, rig.json and poses.txt, numbered without leading zeros."""
    for side in ("left", "right"):
        (folder / side).mkdir(parents=True)
    for number, pair in enumerate(seen.pairs):
        for side, image in zip(("left", "right"), pair, strict=True):
            write_image(folder / side / f"{number + 8}.png", image)
    record = CalibrationRecord(None, GEOMETRY, folder / "rig.json", "json", range(36))
    write_calibration(folder / "rig.json", record)
    write_trajectory(folder / "poses.txt", Trajectory(seen.poses), format="kitti")
    return folder


def with_depths(folder: Path, seen: Walk) -> Path:
    """Write color/ and depth/ (millimetres), exact but for rounding."""
    for name in ("color", "depth"):
        (folder / name).mkdir(parents=True)
    for number, ((left, _), depth) in enumerate(zip(seen.pairs, seen.depths, strict=True)):
        write_image(folder / "color" / f"{number}.png", left)
        millimetres = np.rint(depth * 1000).clip(0, 65535).astype(np.uint16)
        write_image(folder / "depth" / f"{number}.png", millimetres)
    write_trajectory(folder / "poses.txt", Trajectory(seen.poses), format="tum")
    return folder


INTRINSICS = (VIEW.focal_px, VIEW.focal_px, *VIEW.centre)
