"""The text panel of a recording, as Markdown."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from recon.viewer.probing import Probe

__all__ = ["as_markdown", "summary"]

HEADLINES = ("metric sanity", "in short")
"""Of a pair and of a sequence: what is read first."""
LATER = ("settings", "seconds", "geometry", "rectification", "inputs", "versions")
"""Long tables, in this order and below the short ones."""


def summary(
    report: Mapping[str, object], notes: Iterable[str], probes: Iterable[Probe] = ()
) -> str:
    """Return what a person wants to read first: can the units be right, and what is shown.

    Args:
        report: of a run; may be empty.
        notes: what this recording leaves out.
        probes: the pixels whose costs are shown.
    """
    parts = [f"**{report[name]}**" for name in HEADLINES if name in report]
    left_out = [f"- {note}" for note in notes] or ["- nothing was left out"]
    parts += ["## In this recording", "\n".join(left_out)]
    shown = [f"- **{probe.name}** at ({probe.x}, {probe.y}): {probe.why}" for probe in probes]
    if shown:
        parts += ["## Probed pixels of the left view (column, row)", "\n".join(shown)]
    rest = {name: value for name, value in report.items() if name not in HEADLINES}
    if rest:
        parts += ["## Run", as_markdown(rest)]
    return "\n\n".join(parts)


def as_markdown(values: Mapping[str, object]) -> str:
    """Return single values as one table, and every mapping among them as a table below it.

    Args:
        values: settings, timings or measurements.
    """
    single = {name: value for name, value in values.items() if not isinstance(value, Mapping)}
    below = [name for name in values if name not in single]
    below.sort(key=lambda name: LATER.index(name) if name in LATER else -1)
    parts = [_table(single)] if single else []
    for name in below:
        parts += [f"### {name}", _table(values[name])]
    return "\n\n".join(parts)


def _table(values: object) -> str:
    rows = [f"| {name} | {value} |" for name, value in _flattened(values)]
    return "\n".join(["| | |", "| --- | --- |", *rows])


def _flattened(value: object, name: str = "") -> list[tuple[str, str]]:
    """Return nested mappings as rows of a dotted name and a readable value."""
    if isinstance(value, Mapping):
        below = (_flattened(item, f"{name}.{key}".lstrip(".")) for key, item in value.items())
        return [row for rows in below for row in rows]
    if isinstance(value, float) and math.isfinite(value):
        return [(name, f"{value:.4g}")]
    return [(name, str(value).replace("|", "\\|").replace("\n", " "))]
