"""What is said of two shapes in numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from recon.comparison.alignment import Alignment, aligned
from recon.comparison.distances import Direction, distances_to
from recon.comparison.shapes import Shape
from recon.types import Array

__all__ = ["Comparison", "compare", "direction_figures", "plain_figures", "scale_hint"]

SHARES = (0.01, 0.05)
"""Of how far a point is from the camera: distances below these are counted."""

SIGMAS = 3.0
BOX_PERCENT = (5, 95)
ALIKE = 2.0
"""Shapes whose sizes differ by less than this factor may show different parts of one scene."""

UNITS = {
    1000.0: "millimetres for metres",
    100.0: "centimetres for metres",
    10.0: "millimetres for centimetres",
    39.37: "inches for metres",
    3.2808: "feet for metres",
}
UNIT_TOLERANCE = 1.25


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two shapes and how far apart they are.

    Attributes:
        a: the first, moved if it was aligned.
        b: the second.
        a_to_b: how far B is from every point of A: is what A shows there?
        b_to_a: how far A is from every point of B: what of B does A show?
        alignment: the motion that was looked for, or None.
        hint: what the sizes say of the units, or "".
    """

    a: Shape
    b: Shape
    a_to_b: Direction
    b_to_a: Direction
    alignment: Alignment | None
    hint: str


def compare(a: Shape, b: Shape, *, align: bool = False) -> Comparison:
    """Measure two shapes against each other.

    Args:
        a: that is judged.
        b: that it is judged by; both in one frame.
        align: move A onto B first.

    Raises:
        ImportError: if open3d does not load.
    """
    hint = scale_hint(a.points, b.points)
    moved, alignment = aligned(a, b) if align else (a, None)
    return Comparison(moved, b, distances_to(b, moved), distances_to(moved, b), alignment, hint)


def _diagonal(points: Array) -> float:
    """Return the diagonal of the box that holds all but the outermost points on each side."""
    low, high = np.percentile(points, BOX_PERCENT, axis=0)
    return float(np.linalg.norm(high - low))


def scale_hint(a: Array, b: Array) -> str:
    """Say what the sizes of two shapes make one think of their units; "" if nothing.

    Args:
        a: (N, 3).
        b: (M, 3).
    """
    ratio = _diagonal(b) / max(_diagonal(a), float(np.finfo(np.float32).tiny))
    if 1 / ALIKE <= ratio <= ALIKE:
        return ""
    larger, factor = ("B", ratio) if ratio > 1 else ("A", 1 / max(ratio, 1e-12))
    for unit, name in UNITS.items():
        if unit / UNIT_TOLERANCE <= factor <= unit * UNIT_TOLERANCE:
            return f"{larger} is about {unit:g} times as large: wrong units ({name})?"
    return f"{larger} is {factor:.3g} times as large; do both show the same scene, in one unit?"


def direction_figures(direction: Direction) -> dict[str, float | int | None]:
    """Summarise the distances of one direction; names say units.

    "within_1%" and "within_5%" are of a point's distance from the origin, where the camera is;
    "within_3_sigma" is None if nobody knows sigma. Shares are percent.
    """
    asked = direction.asked
    metres, ranges = direction.distances[asked].astype(np.float64), direction.ranges[asked]
    figures: dict[str, float | int | None] = {"points": int(asked.sum())}
    if not len(metres):
        return figures
    middle, p90, p95 = np.percentile(metres, (50, 90, 95))
    figures |= {"median_m": float(middle), "mean_m": float(metres.mean())}
    figures |= {"p90_m": float(p90), "p95_m": float(p95)}
    for share in SHARES:
        figures[f"within_{share:.0%}"] = 100 * float((metres < share * ranges).mean())
    sigma = direction.sigma_m
    figures["within_3_sigma"] = (
        None if sigma is None else 100 * float((metres < SIGMAS * sigma[asked]).mean())
    )
    return figures


def plain_figures(comparison: Comparison) -> dict[str, Any]:
    """Return every figure, for JSON."""
    return {
        "a": _box(comparison.a),
        "b": _box(comparison.b),
        "scale hint": comparison.hint,
        "alignment": None if comparison.alignment is None else vars(comparison.alignment),
        "a to b": direction_figures(comparison.a_to_b),
        "b to a": direction_figures(comparison.b_to_a),
    }


def _box(shape: Shape) -> dict[str, Any]:
    """Return the name of a shape, how many points it has, and the box that holds them."""
    low, high = shape.points.min(axis=0), shape.points.max(axis=0)
    return {
        "name": shape.name,
        "points": len(shape.points),
        "mesh": shape.faces is not None,
        "from_m": low.tolist(),
        "to_m": high.tolist(),
    }
