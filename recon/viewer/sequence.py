"""A recording of a sequence: the camera moves, and the model grows behind it."""

from __future__ import annotations

import contextlib
import math
import os
import uuid
from collections.abc import Mapping
from types import TracebackType
from typing import Any

import cv2
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from calib.pose import Pose
from recon.files import atomic
from recon.fusion import DepthView, FusedSurface, Volume
from recon.types import Array
from recon.viewer.arrangement import DEPTH, PHOTOGRAPH, SUMMARY, panels, picture
from recon.viewer.drawing import WORLD
from recon.viewer.summary import summary
from recon.viewer.thinning import Limits, clustered_surface

__all__ = ["SequenceObserver"]

APPLICATION = "stereo-recon sequence"
TIMELINE = "frame"
CAMERA, PATH, MODEL, MESH = (f"{WORLD}/{name}" for name in ("camera", "path", "model", "mesh"))
FRAME = "/frame"
PATH_COLOUR = (255, 190, 0)
SNAPSHOTS = 12
"""How often the growing model is drawn; each time it is a whole cloud."""
POINTS_OF_SNAPSHOT = 60_000
POINTS_AT_LAST = 300_000
WIDEST_PX = 640
JPEG_QUALITY = 80
FRUSTUM = 0.2
"""Length of the drawn camera, in median depths of the first frame."""
PLAYED_S, SLOWEST_FPS, FASTEST_FPS = 10.0, 1.0, 30.0
"""A recording is played in so many seconds, if that is neither slow nor fast."""
FARTHEST_COLOUR = 2.5
"""Depth of the last colour, in median depths of the first frame."""
EYE_FROM = np.array([-0.45, -0.5, -0.75])
"""Where the eye stands: left of, above and behind the first camera."""
HALF_VIEW = math.tan(math.radians(55) / 2)
"""Tangent of half the angle that the viewer shows from top to bottom; it shows more across."""
IN_VIEW = 0.99
"""Share of the model that each side of the view leaves in it."""


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
        self._file = contextlib.ExitStack()
        self._recording = rr.RecordingStream(APPLICATION, recording_id=uuid.uuid4())
        self._recording.set_log_time_enabled(False)
        self._recording.save(self._file.enter_context(atomic(path)))
        self._file.callback(self._end)
        self._recording.log("/", rr.ViewCoordinates.RDF, static=True)
        self._drawn: dict[str, type] = {}
        self._first: DepthView | None = None
        self._places: list[Array] = []
        self._shown: Array = np.zeros((0, 3))
        self._voxel_m = 0.0
        self._notes: list[str] = []

    def __enter__(self) -> SequenceObserver:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.__exit__(kind, error, trace)

    def _end(self) -> None:
        """Arrange the windows around what was drawn."""
        eye = None
        if self._first is not None and len(self._shown):
            eye = _eye(self._shown, np.array(self._places), self._first.world_from_camera)
        self._recording.send_blueprint(_blueprint(eye, len(self._places), self._drawn))
        self._recording.flush()
        self._recording.disconnect()

    def __call__(self, stage: str, result: Any) -> None:  # noqa: ANN401, ARG002  an observer
        """Draw what a stage made.

        Args:
            stage: slash-separated name, such as "frames/000012".
            result: a frame that was fused, the surface at the end, or a mapping of numbers.
        """
        if hasattr(result, "volume") and hasattr(result, "frame"):
            self._frame(result)
        elif isinstance(result, FusedSurface):
            self._surface(result)
        elif isinstance(result, Mapping):
            text = summary(result, self._notes)
            document = rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)
            self._recording.log(SUMMARY, document, static=True)

    def _log(self, path: str, *archetypes: rr.AsComponents) -> None:
        self._recording.log(path, *archetypes)
        self._drawn[path] = type(archetypes[-1])

    def _frame(self, result: Any) -> None:  # noqa: ANN401  see the class
        view: DepthView = result.frame.view
        self._first = self._first or view
        self._recording.set_time(TIMELINE, sequence=result.number)
        words = f"**{result.frame.name}**, {result.number + 1} of {result.count}"
        self._log(FRAME, rr.TextDocument(words, media_type=rr.MediaType.MARKDOWN))
        self._camera(view, self._first)
        self._places.append(view.world_from_camera.t)
        self._log(PATH, rr.LineStrips3D([np.array(self._places)], colors=PATH_COLOUR))
        volume: Volume = result.volume
        self._voxel_m = volume.settings.voxel_m
        last = result.number == result.count - 1  # then the surface follows
        if not last and result.number % math.ceil(result.count / SNAPSHOTS) == 0:
            self._model(*volume.points(), POINTS_OF_SNAPSHOT)

    def _camera(self, view: DepthView, first: DepthView) -> None:
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
            image_plane_distance=FRUSTUM * float(np.median(_known(first))),
        )
        millimetres = np.nan_to_num(depth * 1000.0).clip(0, 65535).astype(np.uint16)
        _, png = cv2.imencode(".png", millimetres)
        shown = rr.Image(np.ascontiguousarray(image)).compress(jpeg_quality=JPEG_QUALITY)
        in_depth = rr.EncodedDepthImage(
            png.tobytes(), media_type="image/png", meter=1000.0, depth_range=_colours_mm(first)
        )
        self._log(CAMERA, rr.Transform3D(translation=pose.t, mat3x3=pose.R), camera)
        self._log(f"{CAMERA}/{PHOTOGRAPH}", shown)
        self._log(f"{CAMERA}/{DEPTH}", in_depth)

    def _model(self, points: Array, colours: Array, limit: int) -> None:
        """Draw the surface so far as points, at most `limit`; fewer points are larger."""
        chosen = np.linspace(0, len(points) - 1, min(limit, len(points))).astype(np.intp)
        radius = self._voxel_m * math.sqrt(len(points) / max(1, len(chosen)))
        self._log(MODEL, rr.Points3D(points[chosen], colors=colours[chosen], radii=radius))
        self._shown = points[chosen]

    def _surface(self, surface: FusedSurface) -> None:
        """Draw the result, as points and as a mesh."""
        self._model(surface.vertices, surface.colours, POINTS_AT_LAST)
        shown = clustered_surface(surface, Limits().max_faces)
        for name, few, all_of_them in (
            ("points", len(self._shown), len(surface.vertices)),
            ("triangles", len(shown.faces), len(surface.faces)),
        ):
            if few < all_of_them:
                told = f"{few:,} of {all_of_them:,} {name} are shown; the files have all of them"
                self._notes.append(told)
        mesh = rr.Mesh3D(
            vertex_positions=shown.vertices,
            triangle_indices=shown.faces,
            vertex_colors=shown.colours,
            vertex_normals=shown.normals,
        )
        self._recording.log(MESH, mesh, static=True)
        self._drawn[MESH] = rr.Mesh3D


def _colours_mm(view: DepthView) -> tuple[float, float]:
    """Return the depths of the first and the last colour; what is far shall not take most."""
    near, median, far = np.percentile(_known(view), [1, 50, 99]) * 1000.0
    return float(near), float(min(far, FARTHEST_COLOUR * median))


def _known(view: DepthView) -> Array:
    """Return the depths that a view has, (N,) metres; one metre if it has none."""
    known: Array = view.depth[np.isfinite(view.depth)]
    return known if len(known) else np.ones(1, np.float32)


def _eye(model: Array, path: Array, first: Pose) -> rrb.EyeControls3D:
    """Look at nearly all of a model, and all of a path, from behind and above the first camera.

    With x and y across the view, z ahead and t the tangent of half the angle of view, the eye e
    sees a place if |x - e_x| <= t (z - e_z), which is to say x - t z <= e_x - t e_z and
    -x - t z <= -e_x - t e_z: the greatest e_z that all places allow is half the sum of the
    greatest left sides, divided by -t, and e_x half their difference.

    Args:
        model: (N, 3) in the world, metres.
        path: (M, 3) likewise.
        first: `world_from_camera` of the first camera.
    """
    ahead = -EYE_FROM / np.linalg.norm(EYE_FROM)
    across = np.cross([0.0, 1.0, 0.0], ahead)
    across /= np.linalg.norm(across)
    axes = np.stack([across, np.cross(ahead, across), ahead])
    seen, passed = (axes @ first.inverse().apply(p.astype(np.float64)).T for p in (model, path))

    def reach(axis: int, sign: float) -> float:
        """Return the greatest left side, of `sign` x or y."""
        of_model, of_path = (sign * p[axis] - HALF_VIEW * p[2] for p in (seen, passed))
        return max(float(np.quantile(of_model, IN_VIEW)), float(of_path.max()))

    sides = [(reach(axis, 1), reach(axis, -1)) for axis in (0, 1)]
    back = min(-(more + less) / (2 * HALF_VIEW) for more, less in sides)
    eye = np.array([*((more - less) / 2 for more, less in sides), back])
    target = np.array([eye[0], eye[1], np.median(seen[2])])
    behind, middle = first.apply(np.stack([eye, target]) @ axes)
    return rrb.EyeControls3D(
        position=tuple(behind), look_target=tuple(middle), eye_up=tuple(-first.R[:, 1])
    )


def _blueprint(
    eye: rrb.EyeControls3D | None, count: int, drawn: Mapping[str, type]
) -> rrb.Blueprint:
    """Return the one layout: the scene large; pictures and numbers beside it.

    Args:
        eye: that looks at the scene.
        count: of the frames.
        drawn: what was drawn at each absolute path.
    """
    cameras = [WORLD, PATH, CAMERA, f"{CAMERA}/{PHOTOGRAPH}"]
    scenes = [
        rrb.Spatial3DView(
            origin="/",
            contents=[*cameras, path],
            name=name,
            eye_controls=eye,
            line_grid=False,  # at the height of the first camera, it would cut through the model
        )
        for name, path in (("growing model", MODEL), ("mesh", MESH))
        if path in drawn
    ]
    image, depth = f"{CAMERA}/{PHOTOGRAPH}", f"{CAMERA}/{DEPTH}"
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Tabs(*scenes, name="scene"),
            rrb.Vertical(
                rrb.TextDocumentView(origin=FRAME, name="frame"),
                picture("photograph", CAMERA, [image], drawn),
                picture("depth", CAMERA, [depth], drawn),
                rrb.TextDocumentView(origin=SUMMARY, name="summary"),
                row_shares=[1, 3, 3, 4],
            ),
            column_shares=[3, 2],
        ),
        *panels(TIMELINE, min(max(count / PLAYED_S, SLOWEST_FPS), FASTEST_FPS)),
        auto_views=False,
    )
