"""The report that answers "is this calibration good?": one HTML file, and the same as JSON."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from calib.estimation import Quality, RigEstimate
from calib.pair import StereoPair
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


def plain_report(estimate: RigEstimate, quality: Quality) -> dict[str, Any]:
    """Return every figure with its unit in its name, for JSON."""
    rig, sure = estimate.calibration, quality.uncertainty
    cameras = {
        side: {
            "focal_px": [camera.K[0, 0], camera.K[1, 1]],
            "focal_sigma_relative": sure.focal[index],
            "centre_px": [camera.K[0, 2], camera.K[1, 2]],
            "centre_sigma_px": sure.centre_px[index],
            "distortion": camera.distortion.tolist(),
            "model": camera.model,
            "rms_px": quality.camera_rms_px[index],
            "rms_alone_px": estimate.camera_rms_px[index],
            "corners_per_cell": quality.coverage[index].tolist(),
        }
        for index, (side, camera) in enumerate(zip(SIDES, (rig.left, rig.right), strict=True))
    }
    turn = rig.right_from_left.values[:3]
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
        "rotation_rad": turn.tolist(),
        "rotation_sigma_deg": list(sure.turn_deg),
        "disparity_sigma_px": sure.disparity_px,
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


@cache
def _template() -> Any:  # noqa: ANN401  jinja2's templates are of no public type
    loader = FileSystemLoader(Path(__file__).parent)
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined)
    return environment.get_template("report.html.j2")
