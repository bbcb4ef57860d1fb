"""Columns, rows and cells of tables, before they are drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from recon.evaluation.report.numbers import MISSING, as_printed, fixed, two_digits

__all__ = [
    "DENSE_INVALID",
    "FAILED",
    "Cell",
    "Column",
    "Row",
    "best_marked",
    "best_marked_rows",
    "dense_or_all",
    "measured",
    "printed",
]

DECIMALS = 2
DENSE_INVALID = 1.0
"""Percent of the pixels that may lack a result where errors of all pixels are compared."""


@dataclass(frozen=True)
class Column:
    """One figure of every row.

    Attributes:
        region: in which pixels are counted; "" for costs.
        measure: its key in the results.
        unit: of the figure.
        head: what stands above it; the measure if not given.
        group: what stands above several columns; the region if not given.
        better: "low" or "high", "" if neither.
    """

    region: str
    measure: str
    unit: str
    head: str = ""
    group: str = ""
    better: str = "low"

    @property
    def title(self) -> str:
        """What stands above the column."""
        return self.head or self.measure

    @property
    def group_title(self) -> str:
        """What stands above this column and its neighbours of the same group."""
        return self.group or self.region


@dataclass(frozen=True)
class Cell:
    """A number as it is written.

    Attributes:
        text: of the number.
        value: that it was, None if there is none.
        best: no other method of this run is better.
        failed: the method has no result here.
        narrower: characters after the point that its neighbours have and it has not.
    """

    text: str
    value: float | None = None
    best: bool = False
    failed: bool = False
    narrower: int = 0


FAILED = Cell("failed", failed=True)


@dataclass(frozen=True)
class Row:
    """One method in a table.

    Attributes:
        name: of the method.
        protocol: its label; for a published row also what it was scored on.
        cells: one a column.
        rank: the figure that rows are sorted by, None if there is none.
        ours: whether this run made it.
        scenes: how many were averaged; None if a publication decides.
        invalid: percentage of the pixels without a result, None if not known.
        source: number in the list of sources, None for ours.
    """

    name: str
    protocol: str
    cells: tuple[Cell, ...]
    rank: float | None = None
    ours: bool = True
    scenes: int | None = None
    invalid: float | None = None
    source: int | None = None


def dense_or_all(invalid: Sequence[float | None], *, among: Sequence[bool]) -> list[bool]:
    """Return which results can be compared: dense ones, or all where none is.

    A result without its hard pixels has smaller errors in those that are left.

    Args:
        invalid: of each, the percentage of the pixels without a result; None if not known.
        among: which are considered at all.
    """
    dense = [
        considered and share is not None and share <= DENSE_INVALID
        for share, considered in zip(invalid, among, strict=True)
    ]
    return dense if any(dense) else list(among)


def measured(value: float | None, unit: str) -> Cell:
    """Write a figure of this run: two decimals, more of short times and lengths; whole MB."""
    if unit in ("s", "m"):
        return Cell(two_digits(value), value)
    return Cell(fixed(value, 0 if unit == "MB" else DECIMALS), value)


def printed(value: float | None) -> Cell:
    """Write a published figure with the digits that its table has."""
    text = as_printed(value)
    if text == MISSING:
        return Cell(text)
    _, point, digits = text.partition(".")
    return Cell(text, value, narrower=max(0, DECIMALS - len(digits)) + (not point))


def best_marked(
    cells: Sequence[Cell], *, compared: Sequence[bool], better: str = "low"
) -> tuple[Cell, ...]:
    """Mark the best of some figures; figures that are written alike are equally good.

    Nothing is marked where fewer than two have a figure, or all are alike.

    Args:
        cells: figures of one measure.
        compared: which of them take part.
        better: "low" or "high", "" to mark none.
    """
    present = {
        cell.text: cell.value
        for cell, takes_part in zip(cells, compared, strict=True)
        if takes_part and cell.value is not None
    }
    if len(present) < 2 or not better:
        return tuple(cells)
    best = (max if better == "high" else min)(present, key=lambda text: present[text])
    return tuple(
        replace(cell, best=takes_part and cell.text == best)
        for cell, takes_part in zip(cells, compared, strict=True)
    )


def best_marked_rows(
    rows: Sequence[Row], columns: Sequence[Column], *, compared: Mapping[str, Sequence[bool]]
) -> tuple[Row, ...]:
    """Mark the best figure of every column.

    Args:
        rows: of this run.
        columns: of the rows.
        compared: region -> which of the rows take part.
    """
    marked = [
        best_marked(
            [row.cells[index] for row in rows],
            compared=compared[column.region],
            better=column.better,
        )
        for index, column in enumerate(columns)
    ]
    return tuple(
        replace(row, cells=tuple(column[index] for column in marked))
        for index, row in enumerate(rows)
    )
