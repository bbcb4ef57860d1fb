"""What an evaluation leaves on disk beside the maps: figures, a table, a report."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from recon.evaluation.published import PUBLISHED
from recon.evaluation.report import (
    mean_coverage,
    render_page,
    summed_histogram,
    summed_reliability,
)
from recon.evaluation.runner import Entry, pictures_folder
from recon.evaluation.tables import csv_of
from recon.files import atomic, write_json

__all__ = ["Places", "write_results"]

Places = Mapping[str, Path]
"""Where results go: "json", "csv" and "html"."""


def write_results(
    result: Mapping[str, Any], entries: Sequence[Entry], *, out: Path, places: Places
) -> None:
    """Write results.json, results.csv and report.html.

    Args:
        result: of `whole_result`.
        entries: that it was made of.
        out: folder of the maps and pictures.
        places: of the three files; their folders are made.
    """
    for path in places.values():
        path.parent.mkdir(parents=True, exist_ok=True)
    write_json(places["json"], result)
    _write_text(places["csv"], csv_of(dict(result)))

    def picture(method: str | None, dataset: str, scene: str, name: str) -> bytes | None:
        path = pictures_folder(out, method, dataset, scene) / name
        return path.read_bytes() if path.is_file() else None

    beside = places["html"].parent
    page = render_page(
        result,
        pictures=picture,
        published=PUBLISHED,
        curves=_curves(result["methods"], entries),
        links={
            places[kind].name: Path(os.path.relpath(places[kind], beside)).as_posix()
            for kind in ("json", "csv")
        },
    )
    _write_text(places["html"], page)


def _curves(methods: Iterable[str], entries: Sequence[Entry]) -> dict[str, dict[str, Any]]:
    """Return the curve and the histogram of every method, over its scenes."""
    done = [entry for entry in entries if "error" not in entry]
    return {
        name: {
            "coverage": mean_coverage([e["coverage"] for e in done if e["method"] == name]),
            "reliability": summed_reliability(
                [e["reliability"] for e in done if e["method"] == name]
            ),
            "histogram": summed_histogram([e["histogram"] for e in done if e["method"] == name]),
        }
        for name in methods
    }


def _write_text(path: Path, text: str) -> None:
    with atomic(path) as partial:
        partial.write_text(text, encoding="utf-8")
