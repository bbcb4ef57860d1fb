"""Is this calibration good? Figures, a grade with reasons, and what to photograph next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from calib.estimation.adjustment import Array, rms
from calib.estimation.estimate import RigEstimate
from calib.rectify import Rectifier, rectifying_rotations

__all__ = ["Finding", "Quality", "Uncertainty", "judge"]

CELLS = (8, 6)
"""Columns and rows in which the corners of all views are counted."""
THIRDS = (("upper", "middle", "lower"), ("left", "centre", "right"))
SURE = 3.0  # deviations


@dataclass(frozen=True)
class Uncertainty:
    """Standard deviations of what decides about depth.

    Attributes:
        focal: of the focal lengths of left and right, relative.
        centre_px: of the principal points of left and right.
        baseline_m: of the distance of the cameras.
        turn_deg: of the rotation of the right camera about x, y and z, degrees.
        disparity_px: by which the disparity of infinity, c_left - c_right - f times the turn about
            y, may be wrong, and all others with it.
    """

    focal: tuple[float, float]
    centre_px: tuple[float, float]
    baseline_m: float
    turn_deg: tuple[float, float, float]
    disparity_px: float


@dataclass(frozen=True)
class Finding:
    """Something that is worse than it could be.

    Attributes:
        grade: the best one that a calibration with it can get, "A" to "D".
        what: what was found, with its figure.
        advice: what to do about it.
    """

    grade: str
    what: str
    advice: str


@dataclass(frozen=True, eq=False)
class Quality:
    """What there is to know about a calibration.

    Attributes:
        rms_px: root mean square distance of corners and projections, of both cameras together.
        camera_rms_px: of left and right within it.
        view_rms_px: of each view.
        vertical_px: mean and 95th percentile of |y_left - y_right| of corners that both cameras
            saw, in the rectified views at the focal length of the photographs.
        coverage: of left and right, the corners in each cell (6, 8) of the image.
        tilts_deg: (V,) angle between the board and the image plane of the left camera.
        uncertainty: see there.
        findings: the worst first; empty if there is nothing to complain of.
    """

    rms_px: float
    camera_rms_px: tuple[float, float]
    view_rms_px: Array
    vertical_px: tuple[float, float]
    coverage: tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]
    tilts_deg: Array
    uncertainty: Uncertainty
    findings: tuple[Finding, ...]

    @property
    def grade(self) -> str:
        """A: as good as it gets; B: fine; C: usable with care; D: do not use."""
        return max((finding.grade for finding in self.findings), default="A")


def judge(estimate: RigEstimate) -> Quality:
    """Return how good a calibration is, and what would make it better."""
    views = range(len(estimate.names))
    view_rms = np.array([rms(estimate.errors(view=view)) for view in views])
    left, right = (rms(estimate.errors(camera=camera)) for camera in (0, 1))
    coverage = _coverage(estimate, 0), _coverage(estimate, 1)
    tilts = _tilts(estimate)
    vertical = vertical_residuals(estimate)
    figures = Quality(
        estimate.adjusted.rms_px,
        (left, right),
        view_rms,
        (float(vertical.mean()), float(np.percentile(vertical, 95))),
        coverage,
        tilts,
        _uncertainty(estimate),
        (),
    )
    findings = [finding for check in CHECKS for finding in check(estimate, figures)]
    findings.sort(key=lambda finding: finding.grade, reverse=True)
    return replace(figures, findings=tuple(findings))


def vertical_residuals(estimate: RigEstimate) -> Array:
    """Return |y_left - y_right| (n,) of the corners that both cameras saw, rectified, in pixels."""
    rig = estimate.calibration
    cameras, rotations = (rig.left, rig.right), rectifying_rotations(rig)
    focal_px = float(np.mean([camera.K[[0, 1], [0, 1]] for camera in cameras]))
    gaps = []
    for pixels in _both(estimate):
        rays = [c.unproject(p) @ R.T for c, p, R in zip(cameras, pixels, rotations, strict=True)]
        left, right = (focal_px * ray[:, 1] / ray[:, 2] for ray in rays)
        gaps.append(np.abs(left - right))
    together = np.concatenate(gaps)
    kept: Array = together[np.isfinite(together)]
    return kept


def _both(estimate: RigEstimate) -> list[tuple[Array, Array]]:
    """Return the pixels (n, 2) of the corners that both cameras saw, of each view."""
    seen: dict[tuple[int, int], dict[bytes, Array]] = {}
    for sighting in estimate.sightings:
        places = {
            point.tobytes(): pixel
            for point, pixel in zip(sighting.points, sighting.pixels, strict=True)
        }
        seen[sighting.view, sighting.camera] = places
    pairs = []
    for view in range(len(estimate.names)):
        left, right = seen.get((view, 0), {}), seen.get((view, 1), {})
        common = [place for place in left if place in right]
        if common:
            pairs.append(
                (
                    np.array([left[place] for place in common]),
                    np.array([right[place] for place in common]),
                )
            )
    return pairs


def _coverage(estimate: RigEstimate, camera: int) -> npt.NDArray[np.int64]:
    """Return how many corners lie in each cell, (rows, columns)."""
    width, height = estimate.calibration.left.size
    pixels = np.concatenate([s.pixels for s in estimate.sightings if s.camera == camera])
    columns, rows = CELLS
    counts, _, _ = np.histogram2d(
        pixels[:, 1],
        pixels[:, 0],
        bins=(rows, columns),
        range=((-0.5, height - 0.5), (-0.5, width - 0.5)),
    )
    return np.asarray(counts, np.int64)


def _tilts(estimate: RigEstimate) -> Array:
    """Return (V,) degrees between the board's normal and the axis of the left camera."""
    along = np.array([pose.R[2, 2] for pose in estimate.board_poses])
    tilts: Array = np.degrees(np.arccos(np.clip(np.abs(along), 0, 1)))
    return tilts


def _uncertainty(estimate: RigEstimate) -> Uncertainty:
    covariance = estimate.adjusted.covariance
    sigma = np.sqrt(np.diag(covariance).clip(0))
    rig = estimate.calibration
    second = 4 + len(rig.left.distortion)
    focal, centre = [], []
    for start, camera in ((0, rig.left), (second, rig.right)):
        focal.append(float((sigma[start : start + 2] / camera.K[[0, 1], [0, 1]]).max()))
        centre.append(float(sigma[start + 2 : start + 4].max()))
    along = rig.right_from_left.t / rig.baseline_m
    baseline_m = float(np.sqrt(along @ covariance[-3:, -3:] @ along))
    turn = np.degrees(sigma[-6:-3])
    by_infinity = np.zeros(len(sigma))
    by_infinity[[2, second + 2, -5]] = 1, -1, -rig.right.K[0, 0]
    disparity_px = float(np.sqrt(by_infinity @ covariance @ by_infinity))
    return Uncertainty(
        (focal[0], focal[1]), (centre[0], centre[1]), baseline_m, (*turn.tolist(),), disparity_px
    )


def _check_rms(_estimate: RigEstimate, figures: Quality) -> list[Finding]:
    steps = (
        (2.0, "D", "the corners do not fit: check the form of the board, and that it is flat"),
        (1.0, "C", "look for blur, a bent board or another lens model (--model)"),
        (0.5, "B", "sharper photographs or a larger board in the image would help"),
    )
    return _first_over(steps, figures.rms_px, "corners lie {:.2f} px from their projections (RMS)")


def _check_rows(_estimate: RigEstimate, figures: Quality) -> list[Finding]:
    steps = (
        (1.5, "D", "rows do not agree: matching along them will fail"),
        (0.5, "C", "matches will be missed at fine texture; calibrate again with a rigid rig"),
        (0.25, "B", "good enough for most scenes; more views near the borders lower it"),
    )
    what = "rectified rows differ by {:.2f} px in the mean"
    return _first_over(steps, figures.vertical_px[0], what)


def _check_count(estimate: RigEstimate, _figures: Quality) -> list[Finding]:
    count = len(estimate.names)
    what = f"{count} views took part"
    if count < 5:
        return [Finding("D", what, "take 15 to 30 pairs")]
    if count < 10:
        return [Finding("C", what, "take 15 to 30 pairs")]
    return []


def _check_left_out(estimate: RigEstimate, _figures: Quality) -> list[Finding]:
    out, count = len(estimate.left_out), len(estimate.left_out) + len(estimate.names)
    if out <= 0.3 * count:
        return []
    return [
        Finding("C", f"{out} of {count} views had to be left out", "see the reasons of each below")
    ]


def _check_tilts(_estimate: RigEstimate, figures: Quality) -> list[Finding]:
    steepest = float(np.percentile(figures.tilts_deg, 90))
    what = f"the board was tilted by up to {steepest:.0f} degrees only"
    advice = "tilt it by 30 to 45 degrees about both axes: only that fixes the focal length"
    if steepest < 10:
        return [Finding("D", what, advice)]
    if steepest < 20:
        return [Finding("C", what, advice)]
    return []


def _check_coverage(_estimate: RigEstimate, figures: Quality) -> list[Finding]:
    findings = []
    for name, counts in zip(("left", "right"), figures.coverage, strict=True):
        share = float((counts > 0).mean())
        empty = _empty_parts(counts)
        if not empty:
            continue
        findings.append(
            Finding(
                "B" if share > 0.7 else "C",
                f"corners in {share:.0%} of the {name} image, none in its {_listed(empty)}",
                f"add views with the board in the {_listed(empty)} of the {name} image",
            )
        )
    return findings


def _check_uncertainty(estimate: RigEstimate, figures: Quality) -> list[Finding]:
    sure = figures.uncertainty
    focal = (
        (0.02, "D", "add tilted views, and views at other distances"),
        (0.005, "C", "add tilted views, and views at other distances"),
        (0.002, "B", "more tilted views would make it surer"),
    )
    relative = sure.baseline_m / estimate.calibration.baseline_m
    baseline = (
        (0.02, "D", "add views that both cameras see, nearer to the rig"),
        (0.01, "C", "add views that both cameras see, nearer to the rig"),
        (0.005, "B", "more views that both cameras see would make it surer"),
    )
    return [
        *_first_over(focal, max(sure.focal), "the focal length is uncertain by {:.2%}"),
        *_first_over(baseline, relative, "the baseline is uncertain by {:.2%}"),
    ]


def _check_lens(estimate: RigEstimate, _figures: Quality) -> list[Finding]:
    findings = []
    rig = estimate.calibration
    for name, camera in (("left", rig.left), ("right", rig.right)):
        width, height = camera.size
        corners = np.array(
            [[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], float
        )
        blind = int((~np.isfinite(camera.unproject(corners)).all(1)).sum())
        if blind:
            findings.append(
                Finding(
                    "C",
                    f"the lens model of the {name} camera turns back inside {blind} image corners",
                    "use another --model, or add views with the board in those corners",
                )
            )
    return findings


def _check_rectifiable(estimate: RigEstimate, _figures: Quality) -> list[Finding]:
    try:
        Rectifier(estimate.calibration)
    except ValueError as reason:
        advice = "add views with the board near the borders, or use another --model"
        return [Finding("D", f"photographs of this rig cannot be rectified: {reason}", advice)]
    return []


CHECKS = (
    _check_rms,
    _check_rows,
    _check_uncertainty,
    _check_tilts,
    _check_count,
    _check_left_out,
    _check_coverage,
    _check_lens,
    _check_rectifiable,
)


def _first_over(steps: Sequence[tuple[float, str, str]], value: float, what: str) -> list[Finding]:
    """Return the finding of the first limit that a value exceeds."""
    for limit, grade, advice in steps:
        if value > limit:
            return [Finding(grade, what.format(value), advice)]
    return []


def _empty_parts(counts: npt.NDArray[np.int64]) -> list[str]:
    """Return which thirds of the image, in words, hold no corner at all."""
    rows, columns = (
        np.array_split(np.arange(counts.shape[0]), 3),
        np.array_split(np.arange(counts.shape[1]), 3),
    )
    return [
        "centre" if (down, across) == ("middle", "centre") else f"{down} {across}"
        for down, row in zip(THIRDS[0], rows, strict=True)
        for across, column in zip(THIRDS[1], columns, strict=True)
        if counts[np.ix_(row, column)].sum() == 0
    ]


def _listed(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else ", ".join(parts[:-1]) + f" and {parts[-1]}"
