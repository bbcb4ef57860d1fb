"""How the windows of a recording are arranged when it is opened."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import rerun as rr
import rerun.blueprint as rrb

from recon.viewer.drawing import LOG, WORLD

__all__ = ["arranged"]

IN_SPACE = (rr.Points3D, rr.Mesh3D)
IN_AN_IMAGE = (rr.EncodedImage, rr.Image, rr.SegmentationImage, rr.EncodedDepthImage)


def arranged(drawn: Mapping[str, type], focus_m: float) -> rrb.Blueprint:
    """Return a layout: the scene large, the pictures of the stages in order, charts and text.

    Args:
        drawn: what was drawn at each absolute path, in the order of the stages.
        focus_m: distance from the left camera to what the eye looks at, in metres.
    """
    scenes = [path for path, kind in drawn.items() if issubclass(kind, IN_SPACE)]
    in_space = [_scene(path, focus_m) for path in reversed(scenes)] or [_scene(WORLD, focus_m)]
    pictures = _views(rrb.Spatial2DView, drawn, IN_AN_IMAGE)
    charts = _views(rrb.BarChartView, drawn, (rr.BarChart,))
    texts = _views(rrb.TextDocumentView, drawn, (rr.TextDocument,))
    texts.append(rrb.TextLogView(origin=LOG, name="log"))

    beside = [
        rrb.Tabs(*pictures, name="stages") if pictures else None,
        rrb.Tabs(*charts, *texts, name="numbers"),
    ]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Tabs(*in_space, name="scene"),
            rrb.Vertical(*[part for part in beside if part is not None]),
            column_shares=[3, 2],
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed"),
        auto_views=False,
    )


def _views(
    view: Callable[..., rrb.View], drawn: Mapping[str, type], kinds: tuple[type, ...]
) -> list[rrb.View]:
    """Return one view for each path that holds one of some kinds, and nothing below it."""
    return [
        view(origin=path, contents=["$origin"], name=path.strip("/"))
        for path, kind in drawn.items()
        if issubclass(kind, kinds)
    ]


def _scene(path: str, focus_m: float) -> rrb.Spatial3DView:
    """Return a view of one result and the cameras, from behind them, above and to the left."""
    return rrb.Spatial3DView(
        origin="/",
        contents=[f"{WORLD}/**", f"{path}/**"],
        name=path.strip("/"),
        eye_controls=rrb.EyeControls3D(
            position=(-0.35 * focus_m, -0.3 * focus_m, -0.25 * focus_m),
            look_target=(0.0, 0.0, focus_m),
            eye_up=(0.0, -1.0, 0.0),
        ),
    )
