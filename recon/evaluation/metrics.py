"""How far a disparity map is from the truth, in numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from recon.types import Array

__all__ = [
    "MEASURES",
    "THRESHOLDS_PX",
    "coverage_curve",
    "error_histogram",
    "measures",
    "reliability_curve",
]

THRESHOLDS_PX = (0.5, 1.0, 2.0, 4.0)
"""An error above this is bad; those of Middlebury's table."""
QUANTILES = (50, 90, 95, 99)
"""Percent of the pixels with a result that A50 .. A99 speak of."""
D1_PX = 3.0
D1_SHARE = 0.05
COVERAGE_THRESHOLD_PX = 2.0
CONFIDENCE_STEPS = 4096
RELIABILITY_STEPS = 10
HISTOGRAM_END_PX = 4.0
HISTOGRAM_STEP_PX = 0.25

MEASURES = (
    *(f"bad{threshold}" for threshold in THRESHOLDS_PX),
    *(f"wrong{threshold}" for threshold in THRESHOLDS_PX),
    "avgerr",
    "rms",
    *(f"A{percent}" for percent in QUANTILES),
    "invalid",
    "d1",
    "pixels",
)
"""The names that `measures` gives, in this order."""


def measures(error: Array, truth: Array, counted: Array) -> dict[str, float | int | None]:
    """Summarise the errors of the counted pixels.

    With n counted pixels of which m have no result, and e the error of the others:
    wrongT = 100 |{e > T}| / n, invalid = 100 m / n, badT = wrongT + invalid; avgerr and rms are
    means over the n - m pixels with a result. Aq is the smallest error that at least q % of these
    pixels do not exceed (nearest rank: the error of a pixel, never a value in between). d1 is the
    percentage with e > 3 px and e > 5 % of the truth, or with no result. Comparisons are strict.

    Source: bad, invalid and avgerr as in the software of the Middlebury benchmark, Scharstein et
    al., GCPR 2014; d1: Menze & Geiger, CVPR 2015, section 5, but there holes are filled first.

    Args:
        error: (H, W), not negative; NaN where there is no result.
        truth: (H, W), true disparity in the pixels that `error` is in.
        counted: (H, W) bool; the truth is known at each of these pixels.

    Returns:
        One value for each of `MEASURES`: percentages, pixels, and a count in "pixels". Where
        nothing is counted all others are None; without a single result avgerr, rms and Aq are.
    """
    pixels = int(np.count_nonzero(counted))
    if not pixels:
        return {**dict.fromkeys(MEASURES), "pixels": 0}
    selected = error[counted]
    found = selected[~np.isnan(selected)]
    missing = pixels - found.size
    beyond_d1 = counted & (error > D1_PX) & (error > D1_SHARE * truth)
    values: dict[str, float | int | None] = {
        "invalid": 100 * missing / pixels,
        "d1": 100 * (int(np.count_nonzero(beyond_d1)) + missing) / pixels,
        "pixels": pixels,
        **_averages(found),
        **_quantiles(found),
    }
    for threshold in THRESHOLDS_PX:
        wrong = int(np.count_nonzero(found > threshold))
        values[f"wrong{threshold}"] = 100 * wrong / pixels
        values[f"bad{threshold}"] = 100 * (wrong + missing) / pixels
    return {name: values[name] for name in MEASURES}


def _averages(found: Array) -> dict[str, float | None]:
    """Return mean and root mean square of (N,) errors; None if there are none."""
    if not found.size:
        return {"avgerr": None, "rms": None}
    # sums in double precision: float32 loses digits over millions of pixels
    mean = found.sum(dtype=np.float64) / found.size
    mean_square = np.square(found, dtype=np.float64).sum() / found.size
    return {"avgerr": float(mean), "rms": float(np.sqrt(mean_square))}


def _quantiles(found: Array) -> dict[str, float | None]:
    """Return A50 .. A99 of (N,) errors by nearest rank; None if there are none."""
    if not found.size:
        return {f"A{percent}": None for percent in QUANTILES}
    values: dict[str, float | None] = {}
    upper, below = found, 0
    for percent in QUANTILES:
        rank = (found.size * percent + 99) // 100 - 1  # ceil(N q / 100), counted from 0
        # only the part above the last quantile has to be parted again
        upper = np.partition(upper, rank - below)[rank - below :]
        below = rank
        values[f"A{percent}"] = float(upper[0])
    return values


def coverage_curve(
    error: Array, confidence: Array, counted: Array, *, steps: int = 20
) -> dict[str, Any]:
    """Say how good the result is if only its most confident pixels are kept.

    Pixels are kept in the order of their confidence, highest first. Pixels of one confidence have
    no order among themselves: where a share ends within such a group, the group counts with its
    mean, so the place of a pixel in the image never matters.

    Source: error rate over density as in Hu & Mordohai, PAMI 34(11), 2012.

    Args:
        error: (H, W), not negative, pixels; NaN where there is no result.
        confidence: (H, W) in [0, 1], larger is surer; told apart in steps of 1 / 4096.
        counted: (H, W) bool.
        steps: how many shares there are.

    Returns:
        "share": percent of the counted pixels that are kept, 100 / steps .. 100; "bad2.0":
        percentage of the kept pixels that err by more than 2 px; "avgerr": their mean error, px.
        Both are None at shares that the pixels with a result do not fill. "auc": mean of "bad2.0"
        over the shares that it exists at, None if there are none; those of two results compare
        only if both cover the same shares.
    """
    ranked = counted & ~np.isnan(error)
    pixels, found = int(np.count_nonzero(counted)), int(np.count_nonzero(ranked))
    filled = [step for step in range(1, steps + 1) if 0 < step * pixels <= found * steps]
    kept = np.array(filled) * (pixels / steps)
    doubt = ((1 - confidence[ranked]) * CONFIDENCE_STEPS).astype(np.int64)  # (N,), sorts quickly
    errors = error[ranked]
    bad = _sums_of_first(errors > COVERAGE_THRESHOLD_PX, doubt, kept) * 100 / kept
    average = _sums_of_first(errors, doubt, kept) / kept
    unfilled = [None] * (steps - len(filled))
    return {
        "share": [100 * step / steps for step in range(1, steps + 1)],
        "bad2.0": bad.tolist() + unfilled,
        "avgerr": average.tolist() + unfilled,
        "auc": float(bad.mean()) if filled else None,
    }


def _sums_of_first(values: Array, group: Array, counts: Array) -> Array:
    """Sum the first so many values, as if those of one group were all equal to their mean.

    Args:
        values: (N,).
        group: (N,) whole numbers from 0; the values of the lowest group come first.
        counts: (K,), how many values to sum; need not be whole.

    Returns:
        (K,) float64.
    """
    members = np.cumsum(np.bincount(group))
    sums = np.cumsum(np.bincount(group, weights=values))
    return np.asarray(np.interp(counts, np.append(0, members), np.append(0, sums)))


def reliability_curve(right: Array, confidence: Array, counted: Array) -> dict[str, list[float]]:
    """Hold what a confidence says, read as a probability, against what came true.

    Source: reliability diagrams, Guo et al., On Calibration of Modern Neural Networks, ICML 2017,
    section 2.

    Args:
        right: (H, W) bool, whether the disparity is.
        confidence: (H, W) in [0, 1].
        counted: (H, W) bool.

    Returns:
        For each tenth of the scale, "pixels": how many pixels are in it; "said": the sum of their
        confidences; "right": how many of them are right. All can be added over scenes.
    """
    said = confidence[counted].astype(np.float64)
    place = np.clip((said * RELIABILITY_STEPS).astype(np.int64), 0, RELIABILITY_STEPS - 1)
    return {
        name: np.bincount(place, weights=weights, minlength=RELIABILITY_STEPS).tolist()
        for name, weights in (
            ("pixels", None),
            ("said", said),
            ("right", right[counted].astype(np.float64)),
        )
    }


def error_histogram(signed_error: Array, counted: Array) -> dict[str, Any]:
    """Count errors in steps of 0.25 px between -4 and 4 px.

    Args:
        signed_error: (H, W), pixels; positive where the result is too near. NaN is not counted.
        counted: (H, W) bool.

    Returns:
        "edges": the E = 33 limits in px, -4 .. 4; "counts": E + 1 numbers of pixels. counts[0] is
        below edges[0], counts[i] in edges[i - 1] <= error < edges[i], counts[E] at or above
        edges[E - 1].
    """
    errors = signed_error[counted]
    errors = errors[~np.isnan(errors)]
    bins = round(2 * HISTOGRAM_END_PX / HISTOGRAM_STEP_PX)
    position = np.floor((errors + HISTOGRAM_END_PX) / HISTOGRAM_STEP_PX)
    number = np.clip(position, -1, bins).astype(np.int64) + 1
    return {
        "edges": np.linspace(-HISTOGRAM_END_PX, HISTOGRAM_END_PX, bins + 1).tolist(),
        "counts": np.bincount(number, minlength=bins + 2).tolist(),
    }
