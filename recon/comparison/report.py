"""A comparison on disk: figures, the first shape coloured by distance, and a page with pictures."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from recon.colours import COLOUR_TABLE, colour_mapped
from recon.comparison.distances import Direction
from recon.comparison.drawing import VIEWS, data_address, drawn
from recon.comparison.figures import Comparison, plain_figures
from recon.comparison.shapes import Shape
from recon.files import atomic, write_json
from recon.files.ply import write_ply_vertices
from recon.types import Array

__all__ = ["DISTANCE_OUTPUTS", "colour_limit", "render_page", "write_comparison"]

DISTANCE_OUTPUTS = ("compare.json", "compare.html", "a_by_distance.ply")
FARTHEST_PERCENT = 95
GREY = 128
CURVE_SIZE = (420, 240)
CURVE_STEPS = 120
LEGEND_STEPS = 16


def write_comparison(folder: Path, comparison: Comparison) -> None:
    """Write `DISTANCE_OUTPUTS`.

    Args:
        folder: exists.
        comparison: of two shapes.
    """
    limit = colour_limit(comparison)
    write_json(folder / "compare.json", plain_figures(comparison) | {"red from_m": limit})
    _write_coloured(folder / "a_by_distance.ply", comparison.a, comparison.a_to_b, limit)
    with atomic(folder / "compare.html") as partial:
        partial.write_text(render_page(comparison), encoding="utf-8")


def colour_limit(comparison: Comparison) -> float:
    """Return from which distance on points are of the last colour: metres, a round number.

    It is the 95th percentile of both directions, raised to 1, 2 or 5 times a power of ten.
    """
    both = [d.distances[d.asked] for d in (comparison.a_to_b, comparison.b_to_a)]
    farthest = float(np.percentile(np.concatenate(both), FARTHEST_PERCENT))
    if farthest <= 0:
        return 1e-6
    power = 10.0 ** np.floor(np.log10(farthest))
    return float(next(m * power for m in (1, 2, 5, 10) if m * power >= farthest * (1 - 1e-9)))


def _by_distance(direction: Direction, limit: float) -> Array:
    """Return colours (N, 3) uint8, dark blue at 0 and red at the limit."""
    return colour_mapped(direction.distances.reshape(-1, 1), 0.0, limit).reshape(-1, 3)


def _write_coloured(path: Path, shape: Shape, direction: Direction, limit: float) -> None:
    """Write the points of a shape with their distance as a property and as a colour."""
    colours = _by_distance(direction, limit)
    properties = {
        **{axis: shape.points[:, number] for number, axis in enumerate("xyz")},
        **dict(zip(("red", "green", "blue"), colours.T, strict=True)),
        "distance_m": direction.distances,
    }
    legend = f"colour: distance, dark blue at 0, red from {limit:g} m on; also in distance_m"
    write_ply_vertices(path, properties, comments=[legend])


def render_page(comparison: Comparison) -> str:
    """Return one HTML page that loads nothing."""
    limit = colour_limit(comparison)
    box = np.concatenate([comparison.a.points[::7], comparison.b.points[::7]])
    rows = [
        ("A, its own colours", _views(comparison.a, _own_colours(comparison.a), box)),
        ("B, its own colours", _views(comparison.b, _own_colours(comparison.b), box)),
        (
            "A, by its distance from B",
            _views(comparison.a, _by_distance(comparison.a_to_b, limit), box),
        ),
        (
            "B, by its distance from A",
            _views(comparison.b, _by_distance(comparison.b_to_a, limit), box),
        ),
    ]
    stops = COLOUR_TABLE[np.linspace(0, 255, LEGEND_STEPS).astype(int)]
    page: str = _template().render(
        figures=plain_figures(comparison),
        rows=rows,
        views=list(VIEWS),
        limit=limit,
        legend=", ".join(f"rgb({r},{g},{b})" for r, g, b in stops),
        curves=[_curve(d, limit) for d in (comparison.a_to_b, comparison.b_to_a)],
        curve_size=CURVE_SIZE,
        length=length,
    )
    return page


def length(metres: float | None) -> str:
    """Return a length in the unit that suits it, with three digits."""
    if metres is None:
        return "unknown"
    for unit, size in (("µm", 1e-6), ("mm", 1e-3), ("m", 1.0)):
        if abs(metres) < 1000 * size or unit == "m":
            return f"{metres / size:.3g} {unit}"
    raise AssertionError


def _own_colours(shape: Shape) -> Array:
    """Return the colours of a shape; of one without, brighter where it is nearer."""
    if shape.colours is not None:
        return shape.colours
    nearness = -np.linalg.norm(shape.points, axis=1)
    order = np.argsort(np.argsort(nearness)) / max(1, len(nearness) - 1)
    return np.repeat((60 + GREY * order).astype(np.uint8)[:, None], 3, axis=1)


def _views(shape: Shape, colours: Array, box: Array) -> list[str]:
    """Return the pictures of a shape from all sides."""
    return [data_address(drawn(shape.points, colours, view, box)) for view in VIEWS]


def _curve(direction: Direction, limit: float) -> str:
    """Return the share of points below each distance up to the limit, as a polyline."""
    metres = np.sort(direction.distances[direction.asked])
    at = np.linspace(0, limit, CURVE_STEPS)
    share = np.searchsorted(metres, at, side="right") / max(1, len(metres))
    width, height = CURVE_SIZE
    return " ".join(
        f"{width * step / limit:.1f},{height * (1 - y):.1f}"
        for step, y in zip(at, share, strict=True)
    )


@cache
def _template() -> Any:  # noqa: ANN401  jinja2's templates are of no public type
    loader = FileSystemLoader(Path(__file__).parent)
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined)
    return environment.get_template("compare.html.j2")
