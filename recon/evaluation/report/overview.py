"""The main table of a protocol: methods of this run between published rows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from recon.evaluation.published import Published
from recon.evaluation.report.cells import Column, Row, best_marked_rows, dense_or_all, measured
from recon.evaluation.report.contents import figure_of, of_protocol, region_of, scene_names
from recon.evaluation.report.glossary import (
    FULL_SIZE,
    TRUTH_SIZES,
    family,
    main_measure,
    scored_on,
    size_letter,
)
from recon.evaluation.report.others import has_figure, is_comparable, published_row, sources

__all__ = ["Overview", "overview", "ranking"]

Results = Mapping[str, Any]

COSTS = (
    Column("", "seconds", "s", "time", "cost"),
    Column("", "seconds_per_mp", "s", "per MP", "cost"),
    Column("", "peak_mb", "MB", "peak", "cost"),
)


@dataclass(frozen=True)
class Overview:
    """The table of one protocol.

    Attributes:
        label: of the protocol, such as official@Q.
        columns: from left to right.
        ranked_by: the column that rows are sorted by.
        rows: of this run, and published ones over the same pairs, best first.
        leader: the best row of this run, of those that compare; None if all failed.
        scenes: how many the run has under this protocol.
        weighted: whether means are weighted by scene.
        elsewhere: published rows over other pairs or at another size, best first.
        elsewhere_columns: those of which any of these has a figure.
    """

    label: str
    columns: tuple[Column, ...]
    ranked_by: Column
    rows: tuple[Row, ...]
    leader: Row | None
    scenes: int
    weighted: bool
    elsewhere: tuple[Row, ...]
    elsewhere_columns: tuple[Column, ...]


def overview(results: Results, label: str, published: Sequence[Published]) -> Overview:
    """Return the table of a protocol.

    Args:
        results: the whole result.
        label: of the protocol.
        published: rows that may be shown; `sources` of them all numbers their sources.
    """
    found = _found(results, label)
    means = [part.get("mean", {}) for part in found.values()]
    columns, ranked_by = _columns(label, means), ranking(label, means)
    own, leader = _own_rows(results, label, columns, ranked_by)

    scenes = scene_names(results, label)
    pairs = {scene.name for scene in scenes}
    size = _truth_size(results, label)
    others = [
        row
        for row in published
        if row.protocol == family(label) and any(has_figure(row, column) for column in columns)
    ]
    beside = [row for row in others if is_comparable(row, size=size, pairs=pairs)]
    elsewhere = [row for row in others if row not in beside]
    elsewhere_columns = tuple(c for c in columns if any(has_figure(row, c) for row in elsewhere))
    numbers = {source: number for number, source in enumerate(sources(published), start=1)}

    def written(row: Published, columns: tuple[Column, ...]) -> Row:
        source = numbers[row.source, row.note]
        return published_row(row, columns, ranked_by=ranked_by, source=source)

    return Overview(
        label=label,
        columns=columns,
        ranked_by=ranked_by,
        rows=_sorted([*own, *(written(row, columns) for row in beside)]),
        leader=leader,
        scenes=len(scenes),
        weighted=any(part.get("mean") != part.get("plain_mean") for part in found.values()),
        elsewhere=_sorted(written(row, elsewhere_columns) for row in elsewhere),
        elsewhere_columns=elsewhere_columns,
    )


def ranking(label: str, figures: Sequence[Results]) -> Column:
    """Return the column that decides under a protocol, of non-occluded pixels if they are known.

    Args:
        label: of the protocol.
        figures: means or scenes of it.
    """
    regions = {region_of(each) for each in figures}
    measure = main_measure(label)
    region = "nonocc" if "nonocc" in regions else "all"
    return Column(region, measure, "px" if measure == "avgerr" else "%")


def _found(results: Results, label: str) -> dict[str, Results]:
    """Return what every method reached under a protocol, those that were not scored left out."""
    found = {method: of_protocol(results, method, label) for method in results["methods"]}
    return {method: part for method, part in found.items() if part}


def _columns(label: str, means: Sequence[Results]) -> tuple[Column, ...]:
    """Return the columns of which at least one mean has a figure, the deciding one first."""
    errors = [("avgerr", "px"), ("bad2.0", "%"), ("bad4.0", "%"), ("invalid", "%")]
    if main_measure(label) == "d1":
        errors.append(("d1", "%"))
    errors.sort(key=lambda error: error[0] != main_measure(label))  # keeps the others in order
    wanted = [
        Column(region, measure, unit, better="" if measure == "invalid" else "low")
        for region in ("nonocc", "all")
        for measure, unit in errors
    ]
    present = [
        column
        for column in (*wanted, *COSTS)
        if any(figure_of(mean, column.region, column.measure) is not None for mean in means)
    ]
    if not {"nonocc", "all"} <= {column.region for column in present}:
        return tuple(present)
    in_one_region = {("all", "bad4.0"), ("nonocc", "invalid")}
    return tuple(c for c in present if (c.region, c.measure) not in in_one_region)


def _own_rows(
    results: Results, label: str, columns: Sequence[Column], ranked_by: Column
) -> tuple[tuple[Row, ...], Row | None]:
    """Return the rows of this run with the best figures marked, and the best row."""
    found = _found(results, label)
    protocol = scored_on(label, _truth_size(results, label))
    means = [part.get("mean", {}) for part in found.values()]
    rows = [
        Row(
            method,
            protocol,
            tuple(measured(figure_of(mean, c.region, c.measure), c.unit) for c in columns),
            figure_of(mean, ranked_by.region, ranked_by.measure),
            scenes=part.get("scenes_counted"),
            invalid=figure_of(mean, ranked_by.region, "invalid"),
        )
        for (method, part), mean in zip(found.items(), means, strict=True)
    ]
    most = max((row.scenes or 0 for row in rows if row.rank is not None), default=0)
    whole = [row.rank is not None and row.scenes == most for row in rows]
    compared = {
        region: dense_or_all([figure_of(mean, region, "invalid") for mean in means], among=whole)
        for region in dict.fromkeys(column.region for column in (*columns, ranked_by))
    }
    of_leader = zip(rows, compared[ranked_by.region], strict=True)
    leaders = _sorted(row for row, takes_part in of_leader if takes_part)
    return best_marked_rows(rows, columns, compared=compared), leaders[0] if leaders else None


def _truth_size(results: Results, label: str) -> str:
    """Return the letter of the size of the truth, "" if it is not known or not the same in all.

    Labels of the official protocol and the data sets of Middlebury v3 end in it.
    """
    if family(label) == "official":
        scored = any(part.get("scenes_counted") for part in _found(results, label).values())
        return size_letter(label) or (FULL_SIZE if scored else "")
    endings = {scene.dataset.rpartition("/")[2] for scene in scene_names(results, label)}
    ending = endings.pop() if len(endings) == 1 else ""
    return ending if ending in (FULL_SIZE, *TRUTH_SIZES) else ""


def _sorted(rows: Iterable[Row]) -> tuple[Row, ...]:
    """Return the rows with the lowest figure first, those without one last."""
    return tuple(sorted(rows, key=lambda row: (row.rank is None, row.rank or 0.0)))
