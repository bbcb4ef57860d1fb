"""The table that `reconstruct evaluate` prints: one row a method, means over scenes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.table import Table

from recon.cli.terminal import console

__all__ = ["print_means"]

COLUMNS = (
    ("nonocc", "avgerr"), ("nonocc", "bad2.0"), ("nonocc", "bad4.0"), ("nonocc", "invalid"),
    ("all", "avgerr"), ("all", "bad2.0"),
)  # fmt: skip


def print_means(result: dict[str, Any]) -> None:
    """Print one table a protocol."""
    methods = result["methods"]
    labels = dict.fromkeys(label for method in methods.values() for label in method["protocol"])
    for label in labels:
        rows = {
            name: method["protocol"][label]
            for name, method in methods.items()
            if label in method["protocol"]
        }
        holes = any(_figure(found, "nonocc", "invalid") for found in rows.values())
        left_out = "bad4.0" if holes else "invalid"  # a terminal has 80 columns
        shown = [
            (region, measure)
            for region, measure in COLUMNS
            if measure != left_out
            and any(_figure(found, region, measure) is not None for found in rows.values())
        ]
        pairs = sorted({_pairs(found) for found in rows.values()})
        title = f"{label}, means over {' or '.join(pairs)} pairs (errors in px, the rest in %)"
        table = Table(
            title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False
        )
        table.add_column("\nmethod", no_wrap=True)
        for region, measure in shown:
            table.add_column(f"{region}\n{measure}", justify="right")
        costs = ("\ns", "peak\nMB", "\npairs")[: 2 if len(pairs) == 1 else 3]
        for name in costs:
            table.add_column(name, justify="right")
        for name, found in rows.items():
            table.add_row(name, *_cells(found, shown)[: len(shown) + len(costs)])
        console.print(table)


def _figure(found: dict[str, Any], region: str, measure: str) -> float | None:
    """Return the mean of one measure, None if it has none."""
    figure: float | None = found["mean"].get(region, {}).get(measure)
    return figure


def _pairs(found: dict[str, Any]) -> str:
    """Return how many scenes the means are over."""
    counted: int = found["scenes_counted"]
    failed = found["scenes_failed"]
    return f"{counted} of {counted + failed}" if failed else str(counted)


def _cells(found: dict[str, Any], shown: Iterable[tuple[str, str]]) -> list[str]:
    """Return the cells of one row."""
    mean = found["mean"]
    figures = [*(_figure(found, *column) for column in shown), mean.get("seconds")]
    peak = mean.get("peak_mb")
    return [
        *("-" if figure is None else f"{figure:.2f}" for figure in figures),
        "-" if peak is None else f"{peak:.0f}",
        _pairs(found),
    ]
