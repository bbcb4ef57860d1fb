"""The report that answers "is this calibration good?": one HTML file, and the same as JSON."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from calib.camera import Camera
from calib.estimation import Quality, RigEstimate
from calib.pair import StereoPair
from calib.rig import StereoCalibration
from recon.calibration.detection import Detected
from recon.calibration.pictures import (
    coverage_drawing,
    residual_drawing,
    rows_picture,
    thumbnails_of,
)

__all__ = ["plain_report", "render_report"]

GRADES = {
    "A": "as good as it gets",
    "B": "good",
    "C": "usable with care",
    "D": "do not use it",
}
SIDES = ("left", "right")
DEPTHS = (10, 30, 100)
"""Baselines away, at which the uncertainty of depth is stated."""


def plain_report(estimate: RigEstimate, quality: Quality) -> dict[str, Any]:
    """Return every figure with its unit in its name, for JSON."""
    rig, sure = estimate.calibration, quality.uncertainty
    middle = estimate.board.points.mean(0, keepdims=True)
    cameras = {
        side: {
            "focal_px": [camera.K[0, 0], camera.K[1, 1]],
            "focal_sigma_relative": sure.focal[index],
            "centre_px": [camera.K[0, 2], camera.K[1, 2]],
            "centre_sigma_px": sure.centre_px[index],
            "distortion": camera.distortion.tolist(),
            "model": camera.model,
            "field_of_view_deg": _field_of_view(camera),
            "rms_px": quality.camera_rms_px[index],
            "rms_alone_px": estimate.camera_rms_px[index],
            "corners_per_cell": quality.coverage[index].tolist(),
        }
        for index, (side, camera) in enumerate(zip(SIDES, (rig.left, rig.right), strict=True))
    }
    turn = rig.right_from_left.values[:3]
    distances = [float(np.linalg.norm(pose.apply(middle)[0])) for pose in estimate.board_poses]
    return {
        "grade": quality.grade,
        "findings": [vars(finding) for finding in quality.findings],
        "board": estimate.board.name,
        "rms_px": quality.rms_px,
        "corner_sigma_px": estimate.adjusted.sigma_px,
        "corners": sum(len(residual) for residual in estimate.adjusted.residuals),
        "corners_left_out": estimate.corners_left_out,
        "vertical_mean_px": quality.vertical_px[0],
        "vertical_p95_px": quality.vertical_px[1],
        "baseline_m": rig.baseline_m,
        "baseline_sigma_m": sure.baseline_m,
        "translation_m": rig.right_from_left.t.tolist(),
        "centre_of_right_m": rig.right_from_left.inverse().t.tolist(),
        "rotation_rad": turn.tolist(),
        "rotation_deg": np.degrees(turn).tolist(),
        "rotation_sigma_deg": list(sure.turn_deg),
        "disparity_sigma_px": sure.disparity_px,
        "depths": [_depth(rig, sure.disparity_px, count * rig.baseline_m) for count in DEPTHS],
        "board_distance_m": [min(distances), max(distances)],
        "cameras": cameras,
        "views": [
            {"name": name, "rms_px": float(error), "tilt_deg": float(tilt)}
            for name, error, tilt in zip(
                estimate.names, quality.view_rms_px, quality.tilts_deg, strict=True
            )
        ],
        "left_out": [vars(view) for view in estimate.left_out],
    }


def render_report(
    estimate: RigEstimate, quality: Quality, detected: Detected, example: StereoPair
) -> str:
    """Return one HTML page that loads nothing.

    Args:
        estimate: the rig.
        quality: how good it is.
        detected: what the photographs showed.
        example: a pair to show the rows of, rectified.
    """
    coverage = [coverage_drawing(estimate, camera) for camera in (0, 1)]
    residuals = [residual_drawing(estimate, camera) for camera in (0, 1)]
    pictures = {view.name: thumbnails_of(detected, view.name) for view in detected.views}
    page: str = _template().render(
        figures=plain_report(estimate, quality),
        meaning=GRADES[quality.grade],
        coverage=coverage,
        residuals=residuals,
        pictures=pictures,
        rows=rows_picture(example),
        size=estimate.calibration.left.size,
    )
    return page


def _field_of_view(camera: Camera) -> list[float]:
    """Return the angles in degrees between the middles of opposite borders: across and down."""
    (width, height), (cx, cy) = camera.size, camera.K[:2, 2]
    ends = [[0, cy], [width - 1, cy]], [[cx, 0], [cx, height - 1]]
    angles = []
    for pair in ends:
        rays = camera.unproject(np.array(pair, np.float64))
        angles.append(float(np.degrees(np.arctan(np.hypot(rays[:, 0], rays[:, 1])).sum())))
    return angles


def _depth(rig: StereoCalibration, disparity_sigma_px: float, depth_m: float) -> dict[str, float]:
    """Return how far off a depth is if all disparities are, sigma_Z = Z^2 / (f B) sigma_d."""
    sigma_m = depth_m**2 / (rig.left.K[0, 0] * rig.baseline_m) * disparity_sigma_px
    return {"depth_m": depth_m, "sigma_m": sigma_m}


@cache
def _template() -> Any:  # noqa: ANN401  jinja2's templates are of no public type
    loader = FileSystemLoader(Path(__file__).parent)
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined)
    return environment.get_template("report.html.j2")
