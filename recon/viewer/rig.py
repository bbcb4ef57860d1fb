"""A recording of a calibration: both cameras, the board in every view, and what was found."""

from __future__ import annotations

import os
import uuid

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from calib.camera import Camera
from calib.estimation import BoardView, Quality, RigEstimate
from calib.estimation.adjustment import rms
from calib.pair import Image
from calib.pose import Pose
from recon.files import atomic
from recon.types import Array
from recon.viewer.arrangement import panels

__all__ = ["record_rig"]

APPLICATION = "stereo-recon calibration"
TIMELINE = "view"
SIDES = ("left", "right")
BOARD, OUTLINE, EVERY = (255, 190, 0), (80, 150, 230), (130, 150, 175)
SIDE_COLOURS = ((80, 150, 230), (230, 120, 60))
QUALITY = 80


def record_rig(
    path: str | os.PathLike[str],
    estimate: RigEstimate,
    quality: Quality,
    views: tuple[BoardView, ...],
    pictures: tuple[tuple[Image, Image], ...],
) -> None:
    """Write a Rerun recording; its timeline goes through the views.

    Args:
        path: the .rrd file; it appears whole or not at all.
        estimate: the rig.
        quality: how good it is.
        views: all that were looked at.
        pictures: of each view, left and right; smaller copies will do.
    """
    recording = rr.RecordingStream(APPLICATION, recording_id=uuid.uuid4())
    with atomic(path) as partial:
        recording.save(partial, default_blueprint=_blueprint(estimate))
        scale = pictures[0][0].shape[1] / estimate.calibration.left.size[0]
        _record_rig(recording, estimate, quality, scale)
        for number, (view, pair) in enumerate(zip(views, pictures, strict=True)):
            recording.set_time(TIMELINE, sequence=number)
            _record_view(recording, estimate, view, pair, scale)
        recording.flush()
        recording.disconnect()


def _record_rig(
    recording: rr.RecordingStream, estimate: RigEstimate, quality: Quality, scale: float
) -> None:
    """Record what does not change: cameras, all boards, all corners and the summary."""
    rig = estimate.calibration
    recording.log("/", rr.ViewCoordinates.RDF, static=True)
    left_from_right = rig.right_from_left.inverse()
    right = rr.Transform3D(translation=left_from_right.t, mat3x3=left_from_right.R)
    recording.log("world/right", right, static=True)
    for index, (side, camera) in enumerate(zip(SIDES, (rig.left, rig.right), strict=True)):
        recording.log(f"world/{side}", _pinhole(camera, scale, rig.baseline_m), static=True)
        seen = np.concatenate([s.pixels for s in estimate.sightings if s.camera == index])
        points = rr.Points2D((seen + 0.5) * scale, colors=EVERY, radii=rr.Radius.ui_points(1.5))
        recording.log(f"world/{side}/every_view", points, static=True)
        line = rr.SeriesLines(colors=SIDE_COLOURS[index], names=side, widths=2)
        recording.log(f"rms/{side}", line, static=True)
    outlines = [pose.apply(_outline(estimate.board.points)) for pose in estimate.board_poses]
    every = rr.LineStrips3D(outlines, colors=EVERY, radii=rr.Radius.ui_points(0.5))
    recording.log("world/boards", every, static=True)
    recording.log("summary", _markdown(_summary(estimate, quality)), static=True)


def _record_view(
    recording: rr.RecordingStream,
    estimate: RigEstimate,
    view: BoardView,
    pair: tuple[Image, Image],
    scale: float,
) -> None:
    """Record both photographs of a view, what was found in them, and where the board was."""
    for side, picture, corners in zip(SIDES, pair, (view.left, view.right), strict=True):
        recording.log(f"world/{side}", rr.Image(picture).compress(jpeg_quality=QUALITY))
        pixels = np.zeros((0, 2)) if corners is None else (corners.pixels + 0.5) * scale
        radius = rr.Radius.ui_points(2.5)
        recording.log(f"world/{side}/corners", rr.Points2D(pixels, colors=BOARD, radii=radius))
    if view.name not in estimate.names:
        reason = next(out.reason for out in estimate.left_out if out.name == view.name)
        recording.log("view", _markdown(f"**{view.name}** left out: {reason}"))
        recording.log("world/board", rr.Clear(recursive=True))
        return
    place = estimate.names.index(view.name)
    words = [f"**{view.name}**"]
    for index, side in enumerate(SIDES):
        if errors := estimate.errors(camera=index, view=place):
            recording.log(f"rms/{side}", rr.Scalars(rms(errors)))
            words.append(f"{side} {rms(errors):.3f} px RMS")
    recording.log("view", _markdown(", ".join(words)))
    _record_board(recording, estimate.board.points, estimate.board_poses[place])


def _summary(estimate: RigEstimate, quality: Quality) -> str:
    """Return the figures that matter, in Markdown."""
    rig, sure = estimate.calibration, quality.uncertainty
    mean, most = quality.vertical_px
    findings = [f"- ({f.grade}) {f.what}: {f.advice}" for f in quality.findings]
    return "\n\n".join(
        [
            f"# Grade {quality.grade}",
            f"{len(estimate.names)} views of a {estimate.board.name}; {len(estimate.left_out)} "
            "were left out.",
            f"Corners lie **{quality.rms_px:.3f} px** from their projections (RMS), rows differ by "
            f"**{mean:.3f} px** (95 % by less than {most:.3f} px).",
            f"Baseline **{rig.baseline_m * 1000:.2f} ± {sure.baseline_m * 1000:.2f} mm**, focal "
            f"lengths {rig.left.K[0, 0]:.1f} and {rig.right.K[0, 0]:.1f} px "
            f"± {max(sure.focal):.2%}.",
            *(findings or ["Nothing to complain of."]),
        ]
    )


def _markdown(text: str) -> rr.TextDocument:
    return rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)


def _record_board(recording: rr.RecordingStream, points: Array, pose: Pose) -> None:
    radius = rr.Radius.ui_points(2)
    recording.log("world/board", rr.Points3D(pose.apply(points), colors=BOARD, radii=radius))
    outline = rr.LineStrips3D(
        [pose.apply(_outline(points))], colors=OUTLINE, radii=rr.Radius.ui_points(1)
    )
    recording.log("world/board/outline", outline)


def _outline(points: Array) -> Array:
    """Return the closed outline (5, 3) of the points of a board."""
    (x, y), (right, bottom) = points[:, :2].min(0), points[:, :2].max(0)
    return np.array([[x, y, 0], [right, y, 0], [right, bottom, 0], [x, bottom, 0], [x, y, 0]])


def _pinhole(camera: Camera, scale: float, plane_m: float) -> rr.Pinhole:
    width, height = camera.size
    fx, fy, (cx, cy) = camera.K[0, 0], camera.K[1, 1], camera.K[:2, 2]
    return rr.Pinhole(
        focal_length=(fx * scale, fy * scale),
        principal_point=((cx + 0.5) * scale, (cy + 0.5) * scale),  # from the corner of the image
        width=width * scale,
        height=height * scale,
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=plane_m,
    )


def _blueprint(estimate: RigEstimate) -> rrb.Blueprint:
    distance = float(np.median([pose.t[2] for pose in estimate.board_poses]))
    eye = rrb.EyeControls3D(
        position=(-0.6 * distance, -0.5 * distance, -0.8 * distance),
        look_target=(0.0, 0.0, 0.5 * distance),
        eye_up=(0.0, -1.0, 0.0),
    )
    photographs = rrb.Horizontal(
        *(rrb.Spatial2DView(origin=f"world/{side}", name=side) for side in SIDES)
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(
                origin="/",
                contents=["world/**", "- world/left/every_view", "- world/right/every_view"],
                name="cameras and boards",
                eye_controls=eye,
            ),
            rrb.Vertical(
                photographs,
                rrb.TextDocumentView(origin="view", name="this view"),
                rrb.TimeSeriesView(origin="rms", name="RMS of each view, px"),
                rrb.TextDocumentView(origin="summary", name="is it good?"),
                row_shares=[5, 1, 3, 4],
            ),
            column_shares=[1, 1],
        ),
        *panels(TIMELINE),
    )
