"""Curves of a method over all of its scenes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from recon.evaluation.report.contents import figure_of, of_protocol, protocol_labels, region_of

__all__ = ["end_points", "mean_coverage", "summed_histogram", "summed_reliability"]

Curve = Mapping[str, Any]
Results = Mapping[str, Any]

COVERAGE_FIGURES = ("bad2.0", "avgerr")


def mean_coverage(curves: Iterable[Curve | None]) -> dict[str, Any] | None:
    """Average curves of error over coverage, every scene with equal weight.

    Args:
        curves: of the scenes, as `coverage_curve` gives them; None where a method has no
            confidence.

    Returns:
        "share" as in the curves; "bad2.0" and "avgerr": means, None at shares that any scene does
        not reach, since the mean would otherwise change its scenes along the curve; "scenes": how
        many there are. None if no scene has a curve.

    Raises:
        ValueError: if the shares of two scenes differ.
    """
    present: list[Curve] = [curve for curve in curves if curve is not None]
    if not present:
        return None
    shares = list(present[0]["share"])
    if any(list(curve["share"]) != shares for curve in present):
        raise ValueError(
            f"coverage curves must have the same shares to be averaged, but the first has {shares} "
            "and another has others; were the scenes evaluated by two versions?"
        )
    means = {
        figure: [_mean_of_all(values) for values in zip(*(c[figure] for c in present), strict=True)]
        for figure in COVERAGE_FIGURES
    }
    return {"share": shares, **means, "scenes": len(present)}


def _mean_of_all(values: Sequence[float | None]) -> float | None:
    """Return the mean, None if any value is missing."""
    present = [value for value in values if value is not None]
    return math.fsum(present) / len(present) if len(present) == len(values) else None


def summed_histogram(histograms: Iterable[Curve]) -> dict[str, Any] | None:
    """Add the histograms of scenes.

    Args:
        histograms: as `error_histogram` gives them, with open bins at either end.

    Returns:
        "edges" as in the histograms, "counts" added; None if there are none.

    Raises:
        ValueError: if the edges of two scenes differ.
    """
    present = list(histograms)
    if not present:
        return None
    edges = list(present[0]["edges"])
    if any(list(histogram["edges"]) != edges for histogram in present):
        raise ValueError(
            f"histograms must have the same edges to be added, but the first has {edges} and "
            "another has others; were the scenes evaluated by two versions?"
        )
    counts = zip(*(histogram["counts"] for histogram in present), strict=True)
    return {"edges": edges, "counts": [sum(column) for column in counts]}


def summed_reliability(curves: Iterable[Curve | None]) -> dict[str, Any] | None:
    """Add the reliabilities of scenes, every pixel with equal weight.

    Args:
        curves: as `reliability_curve` gives them; None where a method has no confidence.

    Returns:
        "pixels", "said" and "right" added, and "gap": the mean of |said - right| over the pixels,
        both taken tenth by tenth. None if no scene has a pixel.
    """
    present = [curve for curve in curves if curve is not None]
    sums = {
        name: [sum(column) for column in zip(*(c[name] for c in present), strict=True)]
        for name in ("pixels", "said", "right")
    }
    pixels = sum(sums["pixels"])
    if not pixels:
        return None
    gaps = (abs(said - right) for said, right in zip(sums["said"], sums["right"], strict=True))
    return {**sums, "gap": math.fsum(gaps) / pixels}


def end_points(results: Results) -> dict[str, tuple[float, float] | None]:
    """Return what every method reaches with all of its disparities.

    Returns:
        Method -> (percent of the counted pixels with a disparity, percent of these that err by
        more than 2 px), under the official rules of each scene and as plain means, like the
        coverage curves; None if it has no result.
    """
    official = [label for label in protocol_labels(results) if not label.startswith("zs-")]
    return {
        method: _end_point(
            [
                figures
                for label in official
                for figures in of_protocol(results, method, label).get("scenes", {}).values()
            ]
        )
        for method in results["methods"]
    }


def _end_point(scenes: Iterable[Results]) -> tuple[float, float] | None:
    """Return coverage and bad2.0 of the pixels covered, means over scenes; None without any."""
    points = []
    for figures in scenes:
        region = region_of(figures)
        invalid = figure_of(figures, region, "invalid")
        wrong = figure_of(figures, region, "wrong2.0")
        if invalid is not None and wrong is not None and invalid < 100:
            points.append((100 - invalid, 100 * wrong / (100 - invalid)))
    if not points:
        return None
    coverages, shares = zip(*points, strict=True)
    return math.fsum(coverages) / len(points), math.fsum(shares) / len(points)
