"""How the windows of a recording are arranged when it is opened; parts for every command."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from recon.viewer.drawing import WORLD

__all__ = ["HISTOGRAMS", "STAGES", "SUMMARY", "arranged", "eye_before", "panels", "picture"]

SUMMARY = "/summary"
STAGES = "/stages"
HISTOGRAMS = "/histograms"
TIMELINE = "stage"

IN_SPACE = (rr.Points3D, rr.Mesh3D)
IN_AN_IMAGE = (rr.EncodedImage, rr.Image, rr.SegmentationImage, rr.EncodedDepthImage)
GLAZE = 0.35
SLICE = "/row_"
PHOTOGRAPH, DEPTH, PROBES = "photograph", "depth", "probes"


def eye_before(point: tuple[float, float, float]) -> rrb.EyeControls3D:
    """Return an eye behind the left camera, above and to the left of it, that looks at a point.

    Args:
        point: in the frame of the left camera, metres.
    """
    distance = point[2]
    return rrb.EyeControls3D(
        position=(-0.4 * distance, -0.35 * distance, -0.55 * distance),
        look_target=point,
        eye_up=(0.0, -1.0, 0.0),
    )


def panels(timeline: str, fps: float = 1.0) -> tuple[rrb.BlueprintPart, ...]:
    """Return the panels around the views: out of the way, one click from open.

    Args:
        timeline: that is shown first.
        fps: how many of its steps are played in a second.
    """
    return (
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=timeline, fps=fps),
    )


def picture(
    name: str, camera: str, layers: Sequence[str], drawn: Mapping[str, type]
) -> rrb.Spatial2DView:
    """Return a view of what a camera sees, its layers from the lowest to the highest.

    A photograph above other layers lets them shine through. Depths lie invisibly below
    everything, so that the scene shows the place of a pixel under the mouse.

    Args:
        name: of the view.
        camera: path of the pinhole.
        layers: absolute paths below it.
        drawn: what was drawn at each absolute path.
    """
    depth = f"{camera}/{DEPTH}"
    stack = [depth, *(layer for layer in layers if layer != depth)]
    looks: dict[Any, Any] = {}
    for place, path in enumerate(stack):
        kind = drawn.get(path, object)
        if issubclass(kind, IN_AN_IMAGE):
            glazed = place > 1 and path.endswith(PHOTOGRAPH)
            looks[path] = _layer(kind, place, GLAZE if glazed else None)
    return rrb.Spatial2DView(origin=camera, contents=[camera, *stack], name=name, overrides=looks)


def _layer(kind: type[Any], place: int, opacity: float | None) -> rrb.VisualizableArchetype:
    """Return how a kind of image is drawn: above those at earlier places, opaque or not."""
    see_through = {} if opacity is None else {"opacity": opacity}
    layer: rrb.VisualizableArchetype = kind.from_fields(draw_order=float(place), **see_through)
    return layer


def arranged(
    drawn: Mapping[str, type], focus: tuple[float, float, float], probes: Sequence[str] = ()
) -> rrb.Blueprint:
    """Return a layout for one pair: the scene, the pictures of the stages, numbers, the stages.

    Args:
        drawn: what was drawn at each absolute path, in the order of the stages.
        focus: what the eye looks at, in the frame of the left camera, metres.
        probes: paths that hold the charts of a probed pixel each.
    """
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(
                rrb.Tabs(*_scenes(drawn, focus), name="scene"),
                rrb.Vertical(
                    rrb.Tabs(*_pictures(drawn), name="pictures"),
                    rrb.Tabs(*_numbers(drawn, probes), name="numbers"),
                ),
                column_shares=[1, 1],
            ),
            rrb.StateTimelineView(origin=STAGES, name="stages"),
            row_shares=[7, 1],
        ),
        *panels(TIMELINE),
        auto_views=False,
    )


def _scenes(drawn: Mapping[str, type], focus: tuple[float, float, float]) -> list[rrb.View]:
    """Return views of each result in space, the latest first, and one of all of them."""
    results = _of_kind(drawn, IN_SPACE, within=WORLD, without=PROBES)[::-1]
    alone = [_scene(path.rpartition("/")[2], [path], focus) for path in results]
    together = [_scene("all", results, focus)] if len(results) != 1 else []
    return [*alone, *together]


def _scene(
    name: str, results: Iterable[str], focus: tuple[float, float, float]
) -> rrb.Spatial3DView:
    """Return a view of some results, the cameras with their photographs, and the probes."""
    cameras = [
        f"{WORLD}/{side}{part}" for side in ("left", "right") for part in ("", "/photograph")
    ]
    return rrb.Spatial3DView(
        origin="/",
        contents=[WORLD, *cameras, f"{WORLD}/{PROBES}", *results],
        name=name,
        eye_controls=eye_before(focus),
    )


def _pictures(drawn: Mapping[str, type]) -> list[rrb.View | rrb.Container]:
    """Return what the left camera sees, stage by stage, and everything else that is an image."""
    left = f"{WORLD}/left"
    shown: list[rrb.View | rrb.Container] = []
    if f"{left}/{PHOTOGRAPH}" in drawn:
        cameras = {side: f"{WORLD}/{side}" for side in ("left", "right")}
        both = (
            picture(side, camera, [f"{camera}/{part}" for part in (PHOTOGRAPH, PROBES)], drawn)
            for side, camera in cameras.items()
        )
        shown.append(rrb.Horizontal(*both, name="photographs"))
    for layer, name in (("values", "disparity"), ("status", "status"), ("confidence",) * 2):
        layers = [path for path in drawn if path.startswith(left) and path.endswith(f"/{layer}")]
        above = [] if layer == "values" else [f"{left}/{PHOTOGRAPH}"]
        if layers:
            shown.append(picture(name, left, [*layers, *above], drawn))
    if f"{left}/{DEPTH}" in drawn:
        shown.append(picture(DEPTH, left, [f"{left}/{DEPTH}"], drawn))
    steps = [path for path in drawn if path.startswith(WORLD) and path.endswith("/values")]
    if steps:
        views = (_alone(path, path.removeprefix(f"{WORLD}/").removesuffix("/values"))
                 for path in steps)  # fmt: skip
        shown.append(rrb.Grid(*views, grid_columns=3, name="steps"))
    others = [path for path in _of_kind(drawn, IN_AN_IMAGE) if not path.startswith(WORLD)]
    slices = [path for path in others if SLICE in path]
    rest = [_alone(path, path.strip("/")) for path in others if SLICE not in path]
    if slices:
        slices.sort(key=lambda path: path.rpartition("_")[2].zfill(6))  # stable: stage by stage
        views = (_alone(path, path.strip("/")) for path in slices)
        shown.append(rrb.Grid(*views, grid_columns=2, name="cost slices"))
    return [*shown, rrb.Tabs(*rest, name="more")] if rest else shown


def _numbers(drawn: Mapping[str, type], probes: Sequence[str]) -> list[rrb.View | rrb.Container]:
    """Return the summary, cost curves, histograms, and all other texts."""
    shown: list[rrb.View | rrb.Container] = [rrb.TextDocumentView(origin=SUMMARY, name="summary")]
    if probes:
        charts = [rrb.BarChartView(origin=path, name=path.rpartition("/")[2]) for path in probes]
        shown.append(rrb.Tabs(*charts, name="cost curves"))
    histograms = [path for path in drawn if path.startswith(HISTOGRAMS)]
    if histograms:
        views = (rrb.BarChartView(origin=path, name=path.rpartition("/")[2]) for path in histograms)
        shown.append(rrb.Horizontal(*views, name="histograms"))
    texts = [path for path in _of_kind(drawn, (rr.TextDocument,)) if path != SUMMARY]
    if texts:
        documents = (rrb.TextDocumentView(origin=path, name=path.strip("/")) for path in texts)
        shown.append(rrb.Tabs(*documents, name="details"))
    return shown


def _of_kind(
    drawn: Mapping[str, type], kinds: tuple[type, ...], *, within: str = "", without: str = "\0"
) -> list[str]:
    """Return the paths that hold one of some kinds."""
    return [
        path
        for path, kind in drawn.items()
        if issubclass(kind, kinds) and path.startswith(within) and without not in path
    ]


def _alone(path: str, name: str) -> rrb.Spatial2DView:
    """Return a view of one image and nothing below it."""
    return rrb.Spatial2DView(origin=path, contents=["$origin"], name=name)
