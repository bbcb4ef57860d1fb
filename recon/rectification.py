"""Whether the rows of a pair agree, as they must before matching, and what to do if not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from math import atan, degrees
from typing import Any

import numpy as np

from calib.epipolar import VerticalResidual, looks_mirrored, match_views, vertical_residual
from calib.pair import RectifiedPair, StereoPair
from calib.rectify import Rectifier
from calib.rig import StereoCalibration
from calib.row_correction import (
    RowCorrection,
    corrected_pair,
    corrected_rig,
    estimate_row_correction,
)

__all__ = [
    "CheckedPair",
    "RectificationCheck",
    "check_rectification",
    "check_rows",
    "in_words",
    "rectification_report",
    "rectify_and_check",
    "view_in_words",
]

WARNED_PX = 0.5
MEANINGLESS_SHARE = 0.005
"""Of the height. Shifting one view of Middlebury's Teddy (375 rows) by 1, 2, 4, 8 px leaves 61, 40,
31, 14 % of the pixels matched, in place of 86 %, of which 7, 21, 25, 55 % are wrong, in place of
2 %. What larger pictures show is larger in pixels, too, and bears more."""
LEAST_MEANINGLESS_PX = 2.0
WARNED_BEHIND = 0.05
MEANINGLESS_BEHIND = 0.5
EVEN_SHARE = 0.8  # of the mean absolute residual, that the median has if all is shifted alike


@dataclass(frozen=True)
class RectificationCheck:
    """What was found about the rows of a pair.

    Attributes:
        residual: as measured.
        note: one sentence with the figure.
        warnings: what makes the result worse, its likely cause and what to do, in sentences.
        error: why matching along rows is meaningless and what to do; None if it is not.
    """

    residual: VerticalResidual
    note: str
    warnings: tuple[str, ...] = ()
    error: str | None = None


@dataclass(frozen=True, eq=False)
class CheckedPair:
    """A rectified pair and how well its rows agree.

    Attributes:
        pair: ready to be matched.
        check: of this pair.
        correction: that was applied to it; None if none was asked for.
        calibration: that it was rectified with, corrected; None if it came rectified.
    """

    pair: RectifiedPair
    check: RectificationCheck
    correction: RowCorrection | None = None
    calibration: StereoCalibration | None = None


def check_rectification(pair: RectifiedPair, *, refined: bool = False) -> RectificationCheck:
    """Match points of both views, wherever they are, and see whether they lie in the same rows.

    Args:
        pair: rectified, of the size that is to be matched.
        refined: whether the rectification was refined, so that this is no advice.
    """
    infinity = pair.geometry.disparity_at_infinity
    return check_rows(pair, disparity_at_infinity=infinity, refined=refined)


def check_rows(
    pair: StereoPair | RectifiedPair,
    *,
    disparity_at_infinity: float = 0.0,
    refined: bool = False,
) -> RectificationCheck:
    """Do the same for a pair that may be raw.

    Args:
        pair: any.
        disparity_at_infinity: pixels.
        refined: whether the rectification was refined.
    """
    matches = match_views(pair.left, pair.right)
    infinity = disparity_at_infinity
    residual = vertical_residual(matches, disparity_at_infinity=infinity)
    if not residual.reliable:
        return _unknown(pair, residual)
    note = (
        f"rows differ by {residual.mean_absolute_px:.2f} px (mean absolute; 95 % by less than "
        f"{residual.p95_px:.2f} px, {residual.count} matches)"
    )
    advice = "calibrate again" + ("" if refined else ", or try --refine-rectification")
    findings = (_of_rows(residual, pair.left.shape[0], advice), _of_order(residual, infinity))
    errors = [text for text, meaningless in findings if meaningless]
    warnings = [text for text, meaningless in findings if text and not meaningless]
    return RectificationCheck(residual, note, tuple(warnings), ". Also, ".join(errors) or None)


def rectify_and_check(
    pair: StereoPair | RectifiedPair,
    *,
    refine: bool = False,
    rectifier: Callable[[StereoCalibration], Rectifier] = Rectifier,
) -> CheckedPair:
    """Rectify a pair if it is raw, and check its rows.

    Args:
        pair: raw or rectified.
        refine: turn the cameras so that the rows agree better, if that is a significant gain: of a
            raw pair by correcting the calibration, of a rectified one by warping the views.
        rectifier: what rectifies for a calibration.

    Raises:
        ValueError: if the pair cannot be rectified, or the rows ask for a turn that is not small.
    """
    calibration = pair.calibration if isinstance(pair, StereoPair) else None
    rectified = rectifier(pair.calibration)(pair) if isinstance(pair, StereoPair) else pair
    if not refine:
        return CheckedPair(rectified, check_rectification(rectified), None, calibration)
    matches = match_views(rectified.left, rectified.right)
    correction = estimate_row_correction(matches, rectified.geometry)
    if correction.changes:
        if isinstance(pair, StereoPair):
            calibration = corrected_rig(rectifier(pair.calibration), correction)
            rectified = rectifier(calibration)(StereoPair(pair.left, pair.right, calibration))
        else:
            rectified = corrected_pair(rectified, correction)
    check = check_rectification(rectified, refined=True)
    return CheckedPair(rectified, check, correction, calibration)


def in_words(correction: RowCorrection) -> str:
    """Return a sentence on what a correction did."""
    if not correction.changes:
        return (
            "the rectification was left as it is: no turn of a camera makes the rows agree "
            f"significantly better than {correction.before_px:.2f} px (mean absolute)"
        )
    turned = (
        f"the right camera was turned by {degrees(correction.pitch):+.3f} degrees of pitch and "
        f"{degrees(correction.roll):+.3f} of roll"
    )
    if correction.baseline_roll:
        turned += f", the baseline by {degrees(correction.baseline_roll):+.3f} of roll"
    return (
        f"{turned}: the rows agree within {correction.after_px:.2f} px (mean absolute), "
        f"{correction.before_px:.2f} px before; the yaw of the cameras cannot be refined so, and "
        "with it the depths are as right as the calibration"
    )


def rectification_report(checked: CheckedPair) -> dict[str, Any]:
    """Return what was found and done, for run.json."""
    check, correction = checked.check, checked.correction
    return {
        "note": check.note,
        "warnings": list(check.warnings),
        "error that was ignored": check.error,
        "vertical residual": asdict(check.residual),
        "refinement": None
        if correction is None
        else {"note": in_words(correction), "radians and pixels": asdict(correction)},
    }


def view_in_words(
    checked: CheckedPair, rectifier: Callable[[StereoCalibration], Rectifier] = Rectifier
) -> tuple[str, str]:
    """Return what rectified views show, and how much of them is filled.

    Args:
        checked: a pair that came raw.
        rectifier: what it was rectified with.
    """
    geometry, calibration = checked.pair.geometry, checked.calibration
    assert calibration is not None, "a pair that came rectified"
    (width, height), focal = geometry.size, geometry.focal_px
    across, down = (degrees(2 * atan(side / 2 / focal)) for side in (width, height))
    white = np.full((*calibration.left.size[::-1], 3), 255, np.uint8)
    filled = rectifier(calibration)(StereoPair(white, white, calibration))
    left, right = ((view[..., 0] > 0) for view in (filled.left, filled.right))
    return (
        f"each view shows {across:.1f} x {down:.1f} degrees on {width} x {height} px, focal length "
        f"{focal:.1f} px, disparity at infinity {geometry.disparity_at_infinity:.2f} px",
        f"{left.mean():.0%} of the left view and {right.mean():.0%} of the right one are filled, "
        f"{(left & right).mean():.0%} in both",
    )


def _unknown(pair: StereoPair | RectifiedPair, residual: VerticalResidual) -> RectificationCheck:
    """Return what can be said where hardly a point matches."""
    note = (
        f"whether the rows agree is unknown: only {residual.count} points of both views match; "
        "is there little texture, or do the pictures hardly show the same?"
    )
    if not looks_mirrored(pair.left, pair.right, residual.count):
        return RectificationCheck(residual, note)
    warning = "the views match if one of them is mirrored: flip that picture left to right"
    return RectificationCheck(residual, note, (warning,))


def _of_rows(residual: VerticalResidual, height: int, advice: str) -> tuple[str, bool]:
    """Return what is wrong with the rows, empty if nothing is, and whether it is too much."""
    far = residual.mean_absolute_px
    if far <= WARNED_PX:
        return "", False
    limit = max(LEAST_MEANINGLESS_PX, MEANINGLESS_SHARE * height)
    measured = (
        f"the rows of the views disagree by {far:.2f} px (mean absolute; median "
        f"{residual.median_px:+.2f} px, 95 % within {residual.p95_px:.2f} px, "
        f"{residual.count} matches): {_cause(residual)}"
    )
    if far <= limit:
        return f"{measured}. Details will be missing; {advice}", False
    return f"{measured}. Beyond {limit:.1f} px matching along rows is meaningless; {advice}", True


def _cause(residual: VerticalResidual) -> str:
    if residual.upside_down:
        return "is one of the pictures upside down"
    if abs(residual.median_px) > EVEN_SHARE * residual.mean_absolute_px:
        return "nearly the same everywhere, as after a camera was knocked"
    return (
        "differently in different places, as with pictures that are not rectified, or with the "
        "calibration of another rig or focus"
    )


def _of_order(residual: VerticalResidual, infinity: float) -> tuple[str, bool]:
    """Return what is wrong with the signs of the disparities, and whether it is too much."""
    if residual.behind_infinity <= WARNED_BEHIND:
        return "", False
    measured = (
        f"{residual.behind_infinity:.0%} of {residual.count} matches lie behind infinity "
        f"(x_left - x_right below {infinity:.1f} px)"
    )
    if not residual.swapped_fits_better:
        return f"{measured}: are the principal points those of these pictures", False
    swapped = f"{measured}, as when left and right are swapped or both mirrored: exchange them"
    return swapped, residual.behind_infinity > MEANINGLESS_BEHIND
