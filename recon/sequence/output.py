"""What a fused sequence leaves on disk."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from calib.trajectories import write_trajectory
from recon.files import write_glb, write_ply
from recon.fusion import FusedSurface
from recon.sequence.odometry import LABEL
from recon.sequence.run import FusedSequence
from recon.types import Array, Mesh, PixelStatus, PointCloud

__all__ = [
    "KEPT_FRAMES",
    "SEQUENCE_OUTPUTS",
    "as_cloud",
    "as_mesh",
    "sequence_report",
    "write_sequence",
]

SEQUENCE_OUTPUTS = {
    "cloud.ply": "points of the surface in the world frame of the poses, metres",
    "mesh.glb": "the surface with colours at the vertices, as the first camera sees it, y up",
    "trajectory.json": "where the camera stood at every frame, exact",
    "trajectory_kitti.txt": "the same in KITTI's format",
    "trajectory_tum.txt": "the same in TUM's format; frame numbers stand for times",
    "recording.rrd": "camera, images, depths and the growing model over the frames, for Rerun",
    "run.json": "settings, versions, times and counts",
}

KEPT_FRAMES = ".frames"
"""Folder inside the results where depths are kept until a run has ended well."""


def write_sequence(folder: Path, fused: FusedSequence) -> None:
    """Write all of `SEQUENCE_OUTPUTS` but the recording and run.json.

    Args:
        folder: exists.
        fused: of `fuse_sequence`.
    """
    write_ply(folder / "cloud.ply", as_cloud(fused.surface))
    write_glb(folder / "mesh.glb", as_mesh(_seen_by_first(fused)), vertex_colours=True)
    for name, format in (
        ("trajectory.json", "json"),
        ("trajectory_kitti.txt", "kitti"),
        ("trajectory_tum.txt", "tum"),
    ):
        write_trajectory(folder / name, fused.trajectory, format=format)


def as_cloud(surface: FusedSurface) -> PointCloud:
    """Return the vertices of a surface as points; all of them were measured.

    Args:
        surface: in any frame; the points are in it.
    """
    count = len(surface.vertices)
    return PointCloud(
        points=surface.vertices,
        colours=surface.colours,
        normals=surface.normals,
        confidence=surface.trust,
        depth_sigma_m=surface.sigma_m,
        status=np.full(count, PixelStatus.MATCHED, np.uint8),
    )


def as_mesh(surface: FusedSurface) -> Mesh:
    """Return a surface with colours at its vertices and no texture."""
    return Mesh(
        vertices=surface.vertices,
        faces=surface.faces,
        uv=None,
        texture=None,
        colours=surface.colours,
        normals=surface.normals,
    )


def _seen_by_first(fused: FusedSequence) -> FusedSurface:
    """Return the surface in the frame of the first camera, which glTF's axes are told from."""
    surface, first_from_world = fused.surface, fused.world_from_first.inverse()
    vertices = first_from_world.apply(surface.vertices.astype(np.float64))
    return surface.moved(
        vertices.astype(np.float32), (surface.normals @ first_from_world.R.T).astype(np.float32)
    )


def sequence_report(fused: FusedSequence) -> dict[str, Any]:
    """Return what a person should know of a fused sequence, for run.json."""
    surface, places = fused.surface, _places(fused)
    path_m = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    report: dict[str, Any] = {
        "in short": (
            f"{len(surface.vertices):,} points and {len(surface.faces):,} triangles of "
            f"{len(places)} frames, standard deviation {np.median(surface.sigma_m) * 1000:.1f} mm "
            "in the median"
        ),
        "units": "metres, as far as the calibration and the poses are",
        "frame": "world frame of the poses; mesh.glb in that of the first camera, y up",
        "frames": len(places),
        "frames kept by an earlier run": fused.from_disk,
        "path of the camera m": round(path_m, 4),
        "fusion": {**asdict(fused.fusion), "depths used up to m": round(fused.farthest_m, 3)},
        "blocks of voxels": fused.blocks,
        "points": len(surface.vertices),
        "triangles": len(surface.faces),
        "sigma m": _spread(surface.sigma_m),
        "views of a point": _spread(surface.views),
    }
    if fused.steps:
        report["poses"] = LABEL
        report["drift"] = _drift(fused)
        report["steps"] = [
            {"to": name, "fitness": round(step.fitness, 4), "rmse m": round(step.rmse_m, 5)}
            for name, step in zip((fused.trajectory.names or ())[1:], fused.steps, strict=True)
        ]
    return report


def _drift(fused: FusedSequence) -> str | dict[str, float]:
    if fused.drift is None:
        return "unknown: the last frame does not see what the first saw"
    return {
        "last frame directly against step by step m": round(fused.drift.metres, 5),
        "degrees": round(float(np.degrees(fused.drift.radians)), 4),
        "fitness of the direct estimate": round(fused.drift.fitness, 4),
    }


def _places(fused: FusedSequence) -> Array:
    return np.array([pose.t for pose in fused.trajectory.world_from_camera])


def _spread(values: Array) -> dict[str, float]:
    """Return the median and the outer twentieths."""
    low, median, high = (float(value) for value in np.percentile(values, [5, 50, 95]))
    return {"5 %": round(low, 6), "median": round(median, 6), "95 %": round(high, 6)}
