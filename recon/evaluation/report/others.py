"""Published rows: which of them may stand beside a run, and how they are written."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from recon.evaluation.protocols import OFFICIAL_WEIGHTS
from recon.evaluation.published import Published
from recon.evaluation.report.cells import Column, Row, printed
from recon.evaluation.report.contents import protocol_labels, scene_names
from recon.evaluation.report.glossary import FULL_SIZE, family, scored_on

__all__ = ["has_figure", "is_comparable", "published_row", "related", "sources"]


def related(published: Iterable[Published], results: Mapping[str, Any]) -> tuple[Published, ...]:
    """Return the rows that say something of a run: of its protocols, if it has pairs of theirs."""
    families = {
        family(label)
        for label in protocol_labels(results)
        if any(scene.name in OFFICIAL_WEIGHTS for scene in scene_names(results, label))
    }
    return tuple(row for row in published if row.protocol in families)


def sources(published: Iterable[Published]) -> tuple[tuple[str, str], ...]:
    """Return every source with its note once, in the order of the rows."""
    return tuple(dict.fromkeys((row.source, row.note) for row in published))


def is_comparable(row: Published, *, size: str, pairs: set[str]) -> bool:
    """Return whether a published mean is over the pairs of a run, and of errors in its pixels.

    Args:
        row: of the same protocol.
        size: letter of the size of the run's truth, "" if it is not known.
        pairs: names of the run's scenes.
    """
    same_pixels = row.protocol == "official" or row.matched_at in ("", size)
    return same_pixels and row.pairs == "training" and pairs == set(OFFICIAL_WEIGHTS)


def has_figure(row: Published, column: Column) -> bool:
    """Return whether a published row has a mean for a column."""
    return _key(column) in row.means


def published_row(
    row: Published, columns: Sequence[Column], *, ranked_by: Column, source: int
) -> Row:
    """Return a published row as part of a table.

    Args:
        row: to be written.
        columns: of the table.
        ranked_by: the column that rows are sorted by.
        source: its number in the list of sources.
    """
    size = FULL_SIZE if row.protocol == "official" else row.matched_at
    return Row(
        row.name,
        f"{scored_on(row.protocol, size)}, {row.pairs} pairs",
        tuple(printed(row.means.get(_key(column))) for column in columns),
        row.means.get(_key(ranked_by)),
        ours=False,
        source=source,
    )


def _key(column: Column) -> str:
    """Return the name of a figure in published rows, such as nonocc avgerr."""
    return f"{column.region} {column.measure}"
