"""A recording of a calibration: both cameras, the board in every view, and what was found."""

from __future__ import annotations

import os
import uuid

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from calib.camera import Camera
from calib.estimation import BoardView, RigEstimate
from calib.pair import Image
from calib.pose import Pose
from recon.files import atomic
from recon.types import Array

__all__ = ["record_rig"]

APPLICATION = "stereo-recon calibration"
TIMELINE = "view"
BOARD, OUTLINE = (255, 190, 0), (20, 87, 168)
QUALITY = 80


def record_rig(
    path: str | os.PathLike[str],
    estimate: RigEstimate,
    views: tuple[BoardView, ...],
    pictures: tuple[tuple[Image, Image], ...],
) -> None:
    """Write a Rerun recording; its timeline goes through the views.

    Args:
        path: the .rrd file; it appears whole or not at all.
        estimate: the rig.
        views: all that were looked at.
        pictures: of each view, left and right; smaller copies will do.
    """
    recording = rr.RecordingStream(APPLICATION, recording_id=uuid.uuid4())
    with atomic(path) as partial:
        recording.save(partial, default_blueprint=_blueprint(estimate))
        _record(recording, estimate, views, pictures)
        recording.flush()
        recording.disconnect()


def _record(
    recording: rr.RecordingStream,
    estimate: RigEstimate,
    views: tuple[BoardView, ...],
    pictures: tuple[tuple[Image, Image], ...],
) -> None:
    rig = estimate.calibration
    recording.log("/", rr.ViewCoordinates.RDF, static=True)
    left_from_right = rig.right_from_left.inverse()
    right = rr.Transform3D(translation=left_from_right.t, mat3x3=left_from_right.R)
    recording.log("world/right", right, static=True)
    scale = pictures[0][0].shape[1] / rig.left.size[0]
    for side, camera in (("left", rig.left), ("right", rig.right)):
        recording.log(f"world/{side}", _pinhole(camera, scale, rig.baseline_m), static=True)
    places = {name: place for place, name in enumerate(estimate.names)}
    for number, (view, pair) in enumerate(zip(views, pictures, strict=True)):
        recording.set_time(TIMELINE, sequence=number)
        recording.log("name", rr.TextDocument(view.name))
        for side, picture, corners in zip(
            ("left", "right"), pair, (view.left, view.right), strict=True
        ):
            image = rr.Image(picture).compress(jpeg_quality=QUALITY)
            recording.log(f"world/{side}", image)
            pixels = np.zeros((0, 2)) if corners is None else (corners.pixels + 0.5) * scale
            recording.log(f"world/{side}/corners", rr.Points2D(pixels, colors=BOARD, radii=2))
        if view.name in places:
            place = places[view.name]
            _record_board(recording, estimate.board.points, estimate.board_poses[place])
        else:
            recording.log("world/board", rr.Clear(recursive=True))


def _record_board(recording: rr.RecordingStream, points: Array, pose: Pose) -> None:
    (x, y), (right, bottom) = points[:, :2].min(0), points[:, :2].max(0)
    corners = np.array([[x, y, 0], [right, y, 0], [right, bottom, 0], [x, bottom, 0], [x, y, 0]])
    radius = rr.Radius.ui_points(2)
    recording.log("world/board", rr.Points3D(pose.apply(points), colors=BOARD, radii=radius))
    outline = rr.LineStrips3D([pose.apply(corners)], colors=OUTLINE, radii=rr.Radius.ui_points(1))
    recording.log("world/board/outline", outline)


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
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(origin="/", contents="world/**", name="rig", eye_controls=eye),
            rrb.Vertical(
                rrb.Spatial2DView(origin="world/left", contents="world/left/**", name="left"),
                rrb.Spatial2DView(origin="world/right", contents="world/right/**", name="right"),
                rrb.TextDocumentView(origin="name", name="view"),
                row_shares=[4, 4, 1],
            ),
            column_shares=[3, 2],
        ),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )
