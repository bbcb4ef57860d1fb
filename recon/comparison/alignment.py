"""The rigid motion that brings one shape onto another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from recon.comparison.distances import distances_to
from recon.comparison.shapes import Shape
from recon.open3d_library import loaded_open3d
from recon.types import Array

__all__ = ["Alignment", "aligned"]

MOST_POINTS = 100_000
REACHES = (3.0, 1.5, 0.75)
"""Of one round after the other: how far pairs of points may be apart, in 90th percentiles of the
distances before."""

NEIGHBOURS = 20
SMALLEST_REACH = 1e-6


@dataclass(frozen=True, eq=False)
class Alignment:
    """What moved A onto B.

    Attributes:
        b_from_a: (4, 4) rigid motion, metres.
        rotation_deg: angle of its rotation.
        translation_m: length of its translation.
        share_matched: of the points of A, 0 to 1, that have a partner in the last round.
        median_before_m: distance of A from B before.
    """

    b_from_a: Array
    rotation_deg: float
    translation_m: float
    share_matched: float
    median_before_m: float


def aligned(a: Shape, b: Shape) -> tuple[Shape, Alignment]:
    """Move A onto B by iterated closest points, each to the plane at its partner.

    It begins where A lies and finds small motions only; scale is not changed.

    Source: Chen & Medioni, Object Modelling by Registration of Multiple Range Images, IVC 10(3),
    1992, with open3d's `registration_icp`.

    Args:
        a: that is moved.
        b: that stays.
    """
    open3d = loaded_open3d()
    registration = open3d.pipelines.registration
    before = distances_to(b, a)
    spread = float(np.percentile(before.distances[before.asked], 90))
    source, target = (_thinned(shape.points) for shape in (a, b))
    normals = open3d.geometry.KDTreeSearchParamKNN(NEIGHBOURS)
    clouds = [
        open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points.astype(np.float64)))
        for points in (source, target)
    ]
    clouds[1].estimate_normals(normals)
    pose, matched = np.eye(4), 0.0
    for reach in REACHES:
        found = registration.registration_icp(
            *clouds,
            max(reach * spread, SMALLEST_REACH),
            pose,
            registration.TransformationEstimationPointToPlane(),
            registration.ICPConvergenceCriteria(max_iteration=50),
        )
        pose, matched = np.asarray(found.transformation), float(found.fitness)
    cosine = np.clip((np.trace(pose[:3, :3]) - 1) / 2, -1, 1)
    return a.moved(pose), Alignment(
        pose,
        float(np.degrees(np.arccos(cosine))),
        float(np.linalg.norm(pose[:3, 3])),
        matched,
        float(np.median(before.distances[before.asked])),
    )


def _thinned(points: Array) -> Array:
    """Return points at regular places in their order."""
    step = max(1, -(-len(points) // MOST_POINTS))
    return points[::step]
