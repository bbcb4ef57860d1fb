"""A recording of a sequence: the camera moves, and the model grows behind it."""

from __future__ import annotations

import math
import os
import uuid
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import cv2
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from recon.fusion import DepthView, Volume
from recon.types import Array
from recon.viewer.drawing import archetypes
from recon.viewer.thinning import Limits

__all__ = ["SequenceObserver"]

APPLICATION = "stereo-recon sequence"
TIMELINE = "frame"
PATH_COLOUR = (255, 190, 0)
SNAPSHOTS = 12
"""How often the growing model is drawn; each time it is a whole cloud."""
POINTS_OF_SNAPSHOT = 60_000
POINTS_AT_LAST = 400_000
WIDEST_PX = 640
JPEG_QUALITY = 80
BACK = 1.2
"""How far the eye stands behind the first camera, in lengths of what is shown."""


class SequenceObserver:
    """Draw every frame of a sequence: camera, image and depth, and the model now and then.

    Used in a `with` block; the recording appears when the block ends well. It knows a frame by
    what it has: `frame.view`, `frame.name`, `number`, `count` and `volume`.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Start a recording.

        Args:
            path: the .rrd file to write.
        """
        self._target = Path(path)
        self._partial = self._target.with_name(f".{uuid.uuid4().hex}.part")
        self._recording = rr.RecordingStream(APPLICATION, recording_id=uuid.uuid4())
        self._recording.save(self._partial)
        self._recording.log("/", rr.ViewCoordinates.RDF, static=True)
        self._places: list[Array] = []
        self._eye: rrb.EyeControls3D | None = None

    def __enter__(self) -> SequenceObserver:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self._recording.send_blueprint(_blueprint(self._eye))
            self._recording.flush()
            self._recording.disconnect()
            if kind is None:
                self._partial.replace(self._target)
        finally:
            self._partial.unlink(missing_ok=True)

    def __call__(self, stage: str, result: Any) -> None:  # noqa: ANN401  an observer
        """Draw what a stage made.

        Args:
            stage: slash-separated name, such as "frames/000012".
            result: a frame that was fused, or a mapping of numbers.
        """
        if hasattr(result, "volume") and hasattr(result, "frame"):
            self._frame(result)
        elif isinstance(result, Mapping):
            for _, drawn in archetypes(result, Limits()):
                self._recording.log(f"/{stage}", drawn, static=True)

    def _frame(self, result: Any) -> None:  # noqa: ANN401  see the class
        view: DepthView = result.frame.view
        self._recording.set_time(TIMELINE, sequence=result.number)
        self._recording.log("/name", rr.TextDocument(f"{result.frame.name}"))
        _draw_view(self._recording, view)
        self._places.append(view.world_from_camera.t)
        path = rr.LineStrips3D([np.array(self._places)], colors=PATH_COLOUR)
        self._recording.log("/world/path", path)
        if self._eye is None:
            self._eye = _eye(view)
        last = result.number == result.count - 1
        if last or result.number % math.ceil(result.count / SNAPSHOTS) == 0:
            self._model(result.volume, POINTS_AT_LAST if last else POINTS_OF_SNAPSHOT)

    def _model(self, volume: Volume, limit: int) -> None:
        """Draw the surface so far as points, at most `limit`."""
        points, colours = volume.points()
        chosen = np.linspace(0, len(points) - 1, min(limit, len(points))).astype(np.intp)
        cloud = rr.Points3D(points[chosen], colors=colours[chosen], radii=rr.Radius.ui_points(1.5))
        self._recording.log("/world/model", cloud)


def _draw_view(recording: rr.RecordingStream, view: DepthView) -> None:
    """Draw a camera where it stands, with what it saw."""
    pose = view.world_from_camera
    step = math.ceil(view.depth.shape[1] / WIDEST_PX)
    image, depth = view.image[::step, ::step], view.depth[::step, ::step]
    camera = rr.Pinhole(
        focal_length=(view.K[0, 0] / step, view.K[1, 1] / step),
        principal_point=((view.K[0, 2] + 0.5) / step, (view.K[1, 2] + 0.5) / step),
        width=image.shape[1],
        height=image.shape[0],
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=0.1 * _median_depth(view),
    )
    millimetres = np.nan_to_num(depth * 1000.0).clip(0, 65535).astype(np.uint16)
    _, png = cv2.imencode(".png", millimetres)
    recording.log("/world/camera", rr.Transform3D(translation=pose.t, mat3x3=pose.R), camera)
    shown = rr.Image(np.ascontiguousarray(image)).compress(jpeg_quality=JPEG_QUALITY)
    recording.log("/world/camera/image", shown)
    in_depth = rr.EncodedDepthImage(png.tobytes(), media_type="image/png", meter=1000.0)
    recording.log("/depth", in_depth)


def _eye(view: DepthView) -> rrb.EyeControls3D:
    """Look at what the first camera sees from behind and above it."""
    far, pose = _median_depth(view), view.world_from_camera
    places = np.array([[-0.3 * far, -0.6 * far, -BACK * far], [0.0, 0.0, far]])
    behind, middle = pose.apply(places)
    return rrb.EyeControls3D(
        position=tuple(behind), look_target=tuple(middle), eye_up=tuple(-pose.R[:, 1])
    )


def _median_depth(view: DepthView) -> float:
    known = view.depth[np.isfinite(view.depth)]
    return float(np.median(known)) if len(known) else 1.0


def _blueprint(eye: rrb.EyeControls3D | None) -> rrb.Blueprint:
    """Return the one layout: the scene large; image, depth and numbers beside it."""
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(origin="/", contents="/world/**", name="scene", eye_controls=eye),
            rrb.Vertical(
                rrb.Spatial2DView(
                    origin="/world/camera", contents="/world/camera/**", name="image"
                ),
                rrb.Spatial2DView(origin="/depth", contents="/depth", name="depth"),
                rrb.Tabs(
                    rrb.TextDocumentView(origin="/run", name="run"),
                    rrb.TextDocumentView(origin="/name", name="frame"),
                ),
            ),
            column_shares=[3, 2],
        ),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.TimePanel(state="expanded"),
    )
