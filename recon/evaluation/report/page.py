"""One HTML file that says what was evaluated, how, and with what result; it loads nothing."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from recon.colours import COLOUR_TABLE
from recon.evaluation.published import Published
from recon.evaluation.report.cells import DENSE_INVALID, Column
from recon.evaluation.report.charts import (
    coverage_chart,
    histogram_chart,
    method_colours,
    reliability_chart,
)
from recon.evaluation.report.contents import (
    failures,
    protocol_labels,
    scene_names,
)
from recon.evaluation.report.curves import end_points
from recon.evaluation.report.gallery import PictureSource, gallery
from recon.evaluation.report.glossary import MEASURES, sentence, told
from recon.evaluation.report.others import related, sources
from recon.evaluation.report.overview import Overview, overview
from recon.evaluation.report.per_scene import depth_table, everything, scene_table
from recon.evaluation.report.pictures import (
    ERROR_EDGES_PX,
    OCCLUDED,
    UNKNOWN,
    error_colours,
)

__all__ = ["error_legend", "render_page"]

Results = Mapping[str, Any]

TEMPLATE = "page.html.j2"
SHORT_TABLE_ROWS = 10
RAMP_STEPS = 32
LINKS = re.compile(
    r"(?P<url>https?://[^\s,;)]*[^\s,;).])"
    r"|(?:doi[: ]\s*)(?P<doi>10\.\d{4,9}/[^\s,;)]*[^\s,;).])"
    r"|(?P<host>github\.com/[^\s,;)]*[^\s,;).])",
    re.IGNORECASE,
)


def render_page(
    results: Results,
    *,
    pictures: PictureSource,
    published: Sequence[Published],
    curves: Mapping[str, Mapping[str, Any]],
    links: Mapping[str, str] | None = None,
) -> str:
    """Write the report of an evaluation.

    The same input gives the same text: it holds no date and nothing drawn at random.

    Args:
        results: the whole result, as results.json holds it.
        pictures: gives the contents of picture files, by method (None for the scene's own), data
            set, scene and file name; None where there is no such file.
        published: rows of others; those of protocols that the run does not have are left out.
        curves: method -> "coverage", as `mean_coverage` gives it, "reliability", as
            `summed_reliability` does, and "histogram", as `summed_histogram` does; each may be
            None.
        links: text -> address relative to the page, such as {"results.json": "results.json"}.

    Returns:
        HTML without any reference to other files but the links.
    """
    rows = related(published, results)
    labels, scenes = protocol_labels(results), scene_names(results)
    tables = [overview(results, label, rows) for label in labels]
    histograms = {name: curve.get("histogram") for name, curve in curves.items()}
    reliabilities = {name: curve.get("reliability") for name, curve in curves.items()}
    coverages = {name: curve.get("coverage") for name, curve in curves.items()}
    return (
        _environment()
        .get_template(TEMPLATE)
        .render(
            results=results,
            problems=results.get("problems", ()),
            scenes=scenes,
            scene_numbers={scene.key: number for number, scene in enumerate(scenes, start=1)},
            colours=method_colours(results["methods"]),
            tables=tables,
            scene_tables=[scene_table(results, label, rows) for label in labels],
            all_measures=[everything(results, label) for label in labels],
            depths=depth_table(results),
            failures=failures(results),
            coverage=coverage_chart(coverages, end_points(results)),
            reliability=reliability_chart(reliabilities),
            histogram=histogram_chart(histograms),
            gallery=gallery(results, pictures),
            legend=error_legend(),
            ramp=[
                _hexadecimal(colour) for colour in COLOUR_TABLE[:: len(COLOUR_TABLE) // RAMP_STEPS]
            ],
            sources=sources(rows),
            measures=MEASURES,
            links=links or {},
            dense_invalid=DENSE_INVALID,
            short_table_rows=SHORT_TABLE_ROWS,
        )
    )


def error_legend() -> tuple[tuple[str, str, str], ...]:
    """Return the colours of error maps: of visible and of occluded pixels, and their meaning."""
    first, last = ERROR_EDGES_PX[0], ERROR_EDGES_PX[-1]
    between = (f"{low:g} to {high:g}" for low, high in pairwise(ERROR_EDGES_PX))
    meanings = (f"up to {first:g} px", *between, f"above {last:g}", "no result", "truth unknown")
    classes = np.arange(len(meanings), dtype=np.uint8)
    visible, occluded = error_colours(classes), error_colours(classes + OCCLUDED)
    occluded[UNKNOWN] = visible[UNKNOWN]  # there, nobody knows either
    return tuple(
        (_hexadecimal(colour), _hexadecimal(dark), meaning)
        for colour, dark, meaning in zip(visible, occluded, meanings, strict=True)
    )


def _hexadecimal(colour: Iterable[int]) -> str:
    """Write a colour as #rrggbb."""
    return "#" + "".join(f"{channel:02x}" for channel in colour)


@cache
def _environment() -> Environment:
    """Return the template language with what our templates call."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(
        averaged=_averaged,
        groups=_groups,
        linked=_linked,
        settings=_settings_text,
        sentence=sentence,
        told=told,
    )
    return environment


def _groups(columns: Sequence[Column]) -> list[tuple[str, int]]:
    """Return the titles above several columns, each with how many these are."""
    return [
        (title, len(list(group)))
        for title, group in groupby(columns, key=lambda column: column.group_title)
    ]


def _averaged(table: Overview) -> str:
    """Say how many scenes the rows of this run average, and which rows can be the best."""
    own = [row for row in table.rows if row.ours]
    fewer = [row for row in own if row.scenes != table.scenes]
    every = f"all {table.scenes} scenes" if table.scenes > 1 else "one scene"
    if fewer:
        parts = [f"{row.name} averages {row.scenes or 0} of {table.scenes} scenes" for row in fewer]
        rest = f"; the others average {every}" if len(fewer) < len(own) else ""
        text = f"{sentence(parts)}{rest}."
    else:
        text = f"Every row of this run averages {every}."
    if len(own) > 1:
        text += (
            " Bold is the best of this run, among the rows with most scenes that have a result at "
            f"{100 - DENSE_INVALID:g} % of the pixels, if there are any."
        )
    return text


def _linked(text: str) -> Markup:
    """Escape a text and make links of the addresses and DOIs in it."""
    result, end = Markup(""), 0
    for match in LINKS.finditer(text):
        address = match["url"] or (
            f"https://doi.org/{match['doi']}" if match["doi"] else f"https://{match['host']}"
        )
        link = Markup('<a href="{}">{}</a>').format(address, match.group())
        result += escape(text[end : match.start()]) + link
        end = match.end()
    return result + escape(text[end:])


def _settings_text(settings: object) -> str:
    """Write settings as indented lines."""
    return json.dumps(settings, indent=2, ensure_ascii=False, default=str)
