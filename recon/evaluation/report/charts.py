"""Where the lines of curves lie in a drawing."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

__all__ = [
    "METHOD_COLOURS",
    "Chart",
    "Line",
    "Point",
    "Tick",
    "coverage_chart",
    "histogram_chart",
    "method_colours",
    "reliability_chart",
    "tails",
]

Curve = Mapping[str, Any]
Point = tuple[float, float]

METHOD_COLOURS = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#aa3377",
    "#56b4e9",
    "#e69f00",
    "#222222",
)
"""Distinct to the colour-blind too. Source: Okabe & Ito, Color Universal Design, 2008, without its
yellow, which white paper swallows, and with a darker purple."""

DASHES = ("", "7 3", "2 3", "9 3 2 3")
"""One for every round through the colours."""

WIDTH, HEIGHT = 420.0, 310.0
LEFT, RIGHT, TOP, BOTTOM = 46.0, 408.0, 32.0, 266.0


@dataclass(frozen=True)
class Tick:
    """A place on an axis, in units of the drawing, and its label."""

    position: float
    text: str


@dataclass(frozen=True)
class Line:
    """What one method has in a chart.

    Attributes:
        method: its name.
        points: of a polyline, "x,y x,y", in units of the drawing; "" for none.
        end: of a dot, None for none.
        summary: one sentence for those who cannot see the line.
    """

    method: str
    points: str
    end: Point | None = None
    summary: str = ""


@dataclass(frozen=True)
class Chart:
    """A drawing of lines over two axes, ready for a template.

    Attributes:
        x_title: of the horizontal axis, with its unit.
        y_title: of the vertical axis, with its unit.
        x_ticks: from left to right.
        y_ticks: from bottom to top.
        lines: one a method.
        size: (width, height).
        box: left, top, right and bottom of the area inside the axes.
    """

    x_title: str
    y_title: str
    x_ticks: tuple[Tick, ...]
    y_ticks: tuple[Tick, ...]
    lines: tuple[Line, ...]
    size: Point = (WIDTH, HEIGHT)
    box: tuple[float, float, float, float] = (LEFT, TOP, RIGHT, BOTTOM)


def method_colours(methods: Iterable[str]) -> dict[str, tuple[str, str]]:
    """Return the colour and the dashes of every method, the same wherever it is drawn.

    Args:
        methods: names, in the order of the report.

    Returns:
        Name -> (colour as #rrggbb, lengths of dashes and gaps or "").
    """
    count = len(METHOD_COLOURS)
    return {
        method: (METHOD_COLOURS[index % count], DASHES[index // count % len(DASHES)])
        for index, method in enumerate(methods)
    }


def coverage_chart(
    curves: Mapping[str, Curve | None], ends: Mapping[str, Point | None]
) -> Chart | None:
    """Draw the share of wrong pixels among those kept, over the share that is kept.

    Args:
        curves: method -> mean of its coverage curves, None for a method without confidence.
        ends: method -> (percent of the pixels that have a disparity, percent of these that are
            wrong), drawn as a dot.

    Returns:
        None if there is nothing to draw.
    """
    lines = {method: _coverage_points(curve) for method, curve in curves.items()}
    dots = {method: end for method, end in ends.items() if end is not None}
    heights = [y for points in lines.values() for _, y in points] + [y for _, y in dots.values()]
    if not heights:
        return None
    y_ticks = _round_steps(max(heights), at_most=6)
    across, up = _scale(0, 100, LEFT, RIGHT), _scale(0, y_ticks[-1], BOTTOM, TOP)
    methods = [m for m in dict.fromkeys([*lines, *dots]) if lines.get(m) or m in dots]
    return Chart(
        "kept: the surest share of the pixels, %",
        "bad2.0 of the kept pixels, %",
        tuple(Tick(across(x), f"{x}") for x in range(0, 101, 20)),
        tuple(Tick(up(y), f"{y:g}") for y in y_ticks),
        tuple(
            Line(
                method,
                _polyline((across(x), up(y)) for x, y in lines.get(method, ())),
                (across(dots[method][0]), up(dots[method][1])) if method in dots else None,
                _coverage_summary(lines.get(method, ()), dots.get(method)),
            )
            for method in methods
        ),
    )


def _coverage_points(curve: Curve | None) -> list[Point]:
    """Return share and bad2.0 where both exist."""
    if curve is None:
        return []
    pairs = zip(curve["share"], curve["bad2.0"], strict=True)
    return [(share, bad) for share, bad in pairs if bad is not None]


def _coverage_summary(points: Sequence[Point], end: Point | None) -> str:
    """Say the ends of a curve in words."""
    parts = [f"{bad:.2f} % of the surest {share:g} %" for share, bad in points[:1]]
    parts += [f"{end[1]:.2f} % of all {end[0]:.1f} % with a disparity"] if end else []
    return " to ".join(parts)


def reliability_chart(curves: Mapping[str, Curve | None]) -> Chart | None:
    """Draw the share of disparities that are right over the confidence that was said.

    Args:
        curves: method -> its reliability, None for a method without confidence.

    Returns:
        None if there is nothing to draw.
    """
    lines = {name: curve for name, curve in curves.items() if curve is not None}
    if not lines:
        return None
    across, up = _scale(0, 100, LEFT, RIGHT), _scale(0, 100, BOTTOM, TOP)
    return Chart(
        "confidence, %",
        "within 1 px, %",
        tuple(Tick(across(x), f"{x}") for x in range(0, 101, 20)),
        tuple(Tick(up(y), f"{y}") for y in range(0, 101, 20)),
        tuple(
            Line(
                method,
                _polyline((across(x), up(y)) for x, y in _reliability_points(curve)),
                summary=f"{100 * curve['gap']:.1f} points apart in the mean",
            )
            for method, curve in lines.items()
        ),
    )


def _reliability_points(curve: Curve) -> list[Point]:
    """Return what was said and what came true, in percent, of the tenths that hold pixels."""
    tenths = zip(curve["pixels"], curve["said"], curve["right"], strict=True)
    return [(100 * said / n, 100 * right / n) for n, said, right in tenths if n]


def histogram_chart(histograms: Mapping[str, Curve | None]) -> Chart | None:
    """Draw how errors are spread, as steps of equal area, on a scale of powers of ten.

    Args:
        histograms: method -> its histogram with open bins at either end, which are not drawn; see
            `tails`.

    Returns:
        None if nothing was counted.
    """
    steps = {
        method: _density_steps(histogram)
        for method, histogram in histograms.items()
        if histogram is not None and sum(histogram["counts"])
    }
    heights = [y for points in steps.values() for _, y in points if y > 0]
    if not heights:
        return None
    lowest = math.floor(math.log10(max(min(heights), max(heights) / 1e4)))
    highest = max(math.ceil(math.log10(max(heights))), lowest + 1)
    furthest = max(abs(x) for points in steps.values() for x, _ in points)
    across = _scale(-furthest, furthest, LEFT, RIGHT)
    up = _scale(lowest, highest, BOTTOM, TOP)
    floor = 10.0**lowest
    sides = _round_steps(furthest, at_most=4)
    x_values = [*(-x for x in reversed(sides[1:])), *sides]
    return Chart(
        "error, px; positive is too near",
        "share of the pixels, % per px",
        tuple(Tick(across(x), f"{x:g}".replace("-", "−")) for x in x_values if abs(x) <= furthest),
        tuple(Tick(up(power), f"{10.0**power:g}") for power in range(lowest, highest + 1)),
        tuple(
            Line(
                method,
                _polyline((across(x), up(math.log10(max(y, floor)))) for x, y in points),
                summary=tails(histograms[method]),
            )
            for method, points in steps.items()
        ),
    )


def tails(histogram: Curve | None) -> str:
    """Say how much lies beyond the outer edges of a histogram; nothing of an empty one."""
    if histogram is None or not sum(histogram["counts"]):
        return ""
    edges, counts = histogram["edges"], histogram["counts"]
    below, above = (100 * count / sum(counts) for count in (counts[0], counts[-1]))
    first, last = (f"{edge:g}".replace("-", "−") for edge in (edges[0], edges[-1]))
    return f"{below:.2f} % below {first} px, {above:.2f} % from {last} px"


def _density_steps(histogram: Curve) -> list[Point]:
    """Return the corners of a histogram's outline: percent of all counted, per pixel."""
    total = sum(histogram["counts"])
    corners = []
    inner = histogram["counts"][1:-1]
    for (left, right), count in zip(pairwise(histogram["edges"]), inner, strict=True):
        density = 100 * count / total / (right - left)
        corners += [(left, density), (right, density)]
    return corners


def _scale(first: float, last: float, start: float, end: float) -> Callable[[float], float]:
    """Return the straight line that takes `first` to `start` and `last` to `end`."""

    def place(value: float) -> float:
        share = (value - first) / (last - first)
        return round(start + share * (end - start), 1)

    return place


def _polyline(points: Iterable[Point]) -> str:
    return " ".join(f"{x:g},{y:g}" for x, y in points)


def _round_steps(highest: float, *, at_most: int) -> list[float]:
    """Return 0, s, 2 s, .. up to the first multiple not below `highest`, s = 1, 2 or 5 x 10^n."""
    highest = max(highest, 1e-3)
    power = 10.0 ** math.floor(math.log10(highest / at_most))
    step = next(s for s in (power, 2 * power, 5 * power, 10 * power) if highest / s <= at_most)
    return [number * step for number in range(math.ceil(highest / step - 1e-9) + 1)]
