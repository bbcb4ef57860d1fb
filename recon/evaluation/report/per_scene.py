"""Tables beside the main one: scene by scene, depth, and every measure of every region."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from recon.evaluation.metrics import MEASURES
from recon.evaluation.published import Published
from recon.evaluation.report.cells import (
    FAILED,
    Cell,
    Column,
    Row,
    best_marked,
    best_marked_rows,
    dense_or_all,
    measured,
    printed,
)
from recon.evaluation.report.contents import (
    SceneName,
    figure_of,
    main_protocol,
    of_protocol,
    scene_figures,
    scene_names,
)
from recon.evaluation.report.glossary import family
from recon.evaluation.report.overview import ranking

__all__ = ["DepthTable", "Everything", "SceneTable", "depth_table", "everything", "scene_table"]

Results = Mapping[str, Any]

DEPTH_COLUMNS = (
    *(
        column
        for region in ("nonocc", "all")
        for group in (f"depth, {region}",)
        for column in (
            Column(f"depth.{region}", "median_relative", "%", "median", group, ""),
            Column(f"depth.{region}", "within_1%", "%", "in 1 %", group, "high"),
            Column(f"depth.{region}", "within_5%", "%", "in 5 %", group, "high"),
        )
    ),
    *(
        column
        for side in ("accuracy", "completeness")
        for group in (f"cloud {side}",)
        for column in (
            Column("cloud", f"{side}_1%", "%", "in 1 %", group, "high"),
            Column("cloud", f"{side}_5%", "%", "in 5 %", group, "high"),
            Column("cloud", f"{side}_median_m", "m", "median", group, ""),
        )
    ),
    Column("cloud", "chamfer_%", "%", "chamfer", "cloud"),
)
PERCENT = 100.0
NOT_REGIONS = ("depth", "cloud", "coverage", "reliability")
COSTS = {"seconds": "s", "seconds_per_mp": "s", "seconds_per_gdisp": "s", "peak_mb": "MB"}


@dataclass(frozen=True)
class SceneTable:
    """The deciding figure of every scene and method under one protocol.

    Attributes:
        label: of the protocol.
        column: which figure.
        methods: of this run, the first columns.
        published: the columns after them: rows whose table lists scenes.
        scenes: the rows.
        cells: of each scene, one a column.
    """

    label: str
    column: Column
    methods: tuple[str, ...]
    published: tuple[Published, ...]
    scenes: tuple[SceneName, ...]
    cells: tuple[tuple[Cell, ...], ...]


@dataclass(frozen=True)
class DepthTable:
    """How far depths and clouds are from the truth, as plain means over calibrated scenes.

    Attributes:
        columns: from left to right.
        rows: one a method.
        scenes: how many are calibrated.
    """

    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    scenes: int


@dataclass(frozen=True)
class Everything:
    """All measures of all regions under one protocol.

    Attributes:
        label: of the protocol.
        kinds: of means, "weighted mean" and "plain mean"; only the second where they agree.
        methods: the columns under each of these.
        rows: region, measure and cells.
    """

    label: str
    kinds: tuple[str, ...]
    methods: tuple[str, ...]
    rows: tuple[tuple[str, str, tuple[Cell, ...]], ...]


def scene_table(results: Results, label: str, published: Sequence[Published]) -> SceneTable:
    """Return the deciding figure of every scene.

    Args:
        results: the whole result.
        label: of the protocol.
        published: rows that may be shown.
    """
    methods = tuple(m for m in results["methods"] if of_protocol(results, m, label))
    scenes = scene_names(results, label)
    column = ranking(label, [of_protocol(results, m, label).get("mean", {}) for m in methods])
    beside = tuple(
        row
        for row in published
        if column.measure == "avgerr"
        and row.protocol == family(label)
        and any(scene.name in row.scenes.get(column.region, {}) for scene in scenes)
    )
    cells = (
        (
            *_best_of_scene([scene_figures(results, m, label, scene.key) for m in methods], column),
            *(printed(row.scenes[column.region].get(scene.name)) for row in beside),
        )
        for scene in scenes
    )
    return SceneTable(label, column, methods, beside, scenes, tuple(cells))


def _best_of_scene(of_methods: Sequence[Results | None], column: Column) -> tuple[Cell, ...]:
    """Return what every method reached on a scene, the best of those that compare marked."""
    cells = [
        FAILED
        if figures and "error" in figures
        else measured(figure_of(figures, column.region, column.measure), column.unit)
        for figures in of_methods
    ]
    invalid = [figure_of(figures, column.region, "invalid") for figures in of_methods]
    among = [cell.value is not None for cell in cells]
    return best_marked(cells, compared=dense_or_all(invalid, among=among))


def depth_table(results: Results) -> DepthTable | None:
    """Return depth and cloud measures of every method; None if no scene is calibrated."""
    of_method = {method: _figures_with_depth(results, method) for method in results["methods"]}
    most = max((len(scenes) for scenes in of_method.values()), default=0)
    if not most:
        return None
    columns = tuple(
        column
        for column in DEPTH_COLUMNS
        if any(_mean(scenes, column) is not None for scenes in of_method.values())
    )
    rows = [
        Row(
            method,
            "",
            tuple(measured(_mean(scenes, column), column.unit) for column in columns),
            scenes=len(scenes),
        )
        for method, scenes in of_method.items()
    ]
    marked = best_marked_rows(
        rows,
        columns,
        compared={column.region: [row.scenes == most for row in rows] for column in columns},
    )
    return DepthTable(columns, marked, most)


def _figures_with_depth(results: Results, method: str) -> list[Results]:
    """Return the scenes of a method that have depths, each once; protocols do not change them."""
    found = []
    for scene in scene_names(results):
        label = main_protocol(results, scene.key)
        figures = scene_figures(results, method, label, scene.key) if label else None
        if figures and (figures.get("depth") or figures.get("cloud")):
            found.append(figures)
    return found


def _mean(scenes: Sequence[Results], column: Column) -> float | None:
    """Return the plain mean over the scenes that have the figure."""
    values = [figure_of(figures, column.region, column.measure) for figures in scenes]
    present = [value for value in values if value is not None]
    scale = PERCENT if column.measure == "median_relative" else 1.0
    return scale * sum(present) / len(present) if present else None


def everything(results: Results, label: str) -> Everything:
    """Return all means under a protocol.

    Args:
        results: the whole result.
        label: of the protocol.
    """
    methods = tuple(m for m in results["methods"] if of_protocol(results, m, label))
    kinds = {"weighted mean": "mean", "plain mean": "plain_mean"}
    means = {
        title: [of_protocol(results, method, label).get(key, {}) for method in methods]
        for title, key in kinds.items()
    }
    if means["weighted mean"] == means["plain mean"]:
        del means["weighted mean"]
    columns = [mean for of_kind in means.values() for mean in of_kind]
    rows = [
        (region, measure, tuple(_everything_cell(mean, region, measure) for mean in columns))
        for region in _regions(columns)
        for measure in (MEASURES if region else COSTS)
    ]
    present = (row for row in rows if any(cell.value is not None for cell in row[2]))
    return Everything(label, tuple(means), methods, tuple(present))


def _regions(means: Sequence[Results]) -> tuple[str, ...]:
    """Return all regions that any mean has, and "" for costs."""
    names = dict.fromkeys(
        name
        for mean in means
        for name, figures in mean.items()
        if isinstance(figures, Mapping) and name not in NOT_REGIONS
    )
    return (*names, "")


def _everything_cell(mean: Results, region: str, measure: str) -> Cell:
    unit = "MB" if measure == "pixels" else COSTS.get(measure, "")  # both are whole numbers
    return measured(figure_of(mean, region, measure), unit)
