"""See whether calibrations of generated rigs are right, and whether they know how right they are.

python benchmarks/calibration.py [--rigs 100] [--views 12] [--model pinhole] [--corners]

Each rig photographs a chessboard; with `--corners` its corners are known but for normal noise,
which is quicker. Prints, for each quantity, the root mean square error in its own unit and in
stated deviations, and the share of rigs within three of them; then how far from each other's row
the two views show points anywhere in the scene, once they are rectified by the estimate.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import cast

import cv2
import numpy as np
import numpy.typing as npt

from calib.boards.chessboard import Chessboard
from calib.boards.generated import (
    photograph,
    photograph_room,
    poses_for_one,
    random_poses,
    random_rig,
    seen_corners,
)
from calib.camera import LENSES, LensName
from calib.epipolar import match_views
from calib.estimation import BoardView, RigEstimate, estimate_rig, judge
from calib.pair import StereoPair
from calib.rectify import Rectifier
from calib.rig import StereoCalibration

Array = npt.NDArray[np.float64]

BOARD = Chessboard(9, 6, 0.03)
CORNER_NOISE_PX = 0.1
POINTS = 20_000
NEAREST, FURTHEST = 5, 100  # baselines, along the line of sight
UNITS = {"focal length": "px", "principal point": "px", "baseline": "mm", "rotation": "deg"}


@dataclass(frozen=True)
class Rigs:
    """What is generated."""

    lens: LensName
    views: int
    alone: int
    size: tuple[int, int]
    corners: bool


@dataclass(frozen=True, eq=False)
class Trial:
    """What came of one rig.

    Attributes:
        off: of each quantity, the errors.
        sigma: of each quantity, the deviations that were stated for them.
        rows_px: (n,) |y_left - y_right| of points that both rectified views show.
        rms_px: of the corners.
        seconds: of one processor, to find the corners and to estimate the rig.
    """

    off: dict[str, Array]
    sigma: dict[str, Array]
    rows_px: Array
    matched_px: Array
    rms_px: float
    seconds: tuple[float, float]


def calibrated(rigs: Rigs, number: int) -> Trial:
    """Generate one rig and its photographs, and calibrate it."""
    cv2.setNumThreads(1)  # rigs run side by side
    rig = random_rig(rigs.size, rigs.lens, seed=number)
    poses = [
        *random_poses(BOARD, rig, rigs.views, seed=number + 1000),
        *poses_for_one(BOARD, rig, rigs.alone, seed=number + 2000),
    ]
    views, finding = [], 0.0
    for index, pose in enumerate(poses):
        cameras = (rig.left, pose), (rig.right, rig.right_from_left @ pose)
        corners = []
        for side, (camera, at) in enumerate(cameras):
            seed = 10_000 * number + 2 * index + side
            if rigs.corners:
                noise_px = CORNER_NOISE_PX
                corners.append(seen_corners(BOARD, camera, at, noise_px=noise_px, seed=seed))
                continue
            image = photograph(BOARD, camera, at, seed=seed)
            began = time.process_time()
            corners.append(BOARD.find(image))
            finding += time.process_time() - began
        views.append(BoardView(f"{index}", *corners))
    began = time.process_time()
    estimate = estimate_rig(BOARD, views, rigs.size, rigs.lens)
    seconds = finding, time.process_time() - began
    off, sigma = errors(estimate, rig)
    true_rows = rows_px(estimate.calibration, rig, seed=number)
    matched = np.zeros(0) if rigs.corners else matched_rows_px(estimate.calibration, rig, number)
    return Trial(off, sigma, true_rows, matched, estimate.adjusted.rms_px, seconds)


def errors(
    estimate: RigEstimate, truth: StereoCalibration
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return the errors of each quantity, and the deviations that were stated for them."""
    found, sure = estimate.calibration, judge(estimate).uncertainty
    sigma = np.sqrt(np.diag(estimate.adjusted.covariance))
    of_right = 4 + len(found.left.distortion)
    focal, centre = ([part, part + 1, of_right + part, of_right + part + 1] for part in (0, 2))
    turn = (found.right_from_left @ truth.right_from_left.inverse()).values[:3]
    ours, theirs = (
        np.concatenate(
            [[c.K[0, 0], c.K[1, 1], c.K[0, 2], c.K[1, 2]] for c in (rig.left, rig.right)]
        )
        for rig in (found, truth)
    )
    off = ours - theirs
    return (
        {
            "focal length": off[[0, 1, 4, 5]],
            "principal point": off[[2, 3, 6, 7]],
            "baseline": np.array([1e3 * (found.baseline_m - truth.baseline_m)]),
            "rotation": np.degrees(turn),
        },
        {
            "focal length": sigma[focal],
            "principal point": sigma[centre],
            "baseline": np.array([1e3 * sure.baseline_m]),
            "rotation": np.array(sure.turn_deg),
        },
    )


def rows_px(found: StereoCalibration, truth: StereoCalibration, *, seed: int) -> Array:
    """Return |y_left - y_right| (n,) of points at random places that both rectified views show.

    Args:
        found: what the views are rectified by.
        truth: where the cameras show the points.
        seed: of the points.
    """
    draw = np.random.default_rng(seed)
    pixels = draw.uniform(0, np.array(truth.left.size) - 1, (POINTS, 2))
    rays = truth.left.unproject(pixels)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    far = truth.baseline_m / draw.uniform(1 / FURTHEST, 1 / NEAREST, (POINTS, 1))
    at_right = truth.right.project(truth.right_from_left.apply(rays * far))
    kept = np.isfinite(at_right).all(1)
    kept &= ((at_right >= 0) & (at_right <= np.array(truth.right.size) - 1)).all(1)
    try:
        rectifier = Rectifier(found)
    except ValueError:  # the lens turns back before the border
        return np.zeros(0)
    left = rectifier.points(pixels[kept], "left")
    right = rectifier.points(at_right[kept], "right")
    last = np.array(rectifier.geometry.size) - 1
    both = np.hstack([left, right])
    shown = ((both >= 0) & (both <= np.tile(last, 2))).all(1)
    gaps: Array = np.abs(left - right)[shown, 1]
    return gaps


def matched_rows_px(found: StereoCalibration, truth: StereoCalibration, seed: int) -> Array:
    """Return |y_left - y_right| (n,) of matches in photographs, rectified by an estimate."""
    raw = photograph_room(truth, seed=seed)
    try:
        rectified = Rectifier(found)(StereoPair(raw.left, raw.right, found))
    except ValueError:
        return np.zeros(0)
    return np.abs(match_views(rectified.left, rectified.right).offsets)


def table(trials: Sequence[Trial]) -> str:
    """Return the figures of many rigs."""
    finding, estimating = np.mean([one.seconds for one in trials], axis=0)
    rms = np.mean([one.rms_px for one in trials])
    lines = [
        f"{len(trials)} rigs, {rms:.3f} px RMS; corners found in {finding:.2f} s, "
        f"rig estimated in {estimating:.2f} s of one processor",
        "quantity          RMS error      in deviations  within three",
    ]
    for name, unit in UNITS.items():
        off, sigma = (
            np.concatenate([getattr(one, part)[name] for one in trials])
            for part in ("off", "sigma")
        )
        ratio = np.abs(off / sigma)
        lines.append(
            f"{name:16s} {np.sqrt((off**2).mean()):9.4f} {unit:4s} "
            f"{np.sqrt((ratio**2).mean()):9.2f} {(ratio < 3).mean():14.1%}"
        )
    lines += [
        _rows("rows of points differ by", [one.rows_px for one in trials]),
        _rows("rows of photographs differ by", [one.matched_px for one in trials]),
    ]
    return "\n".join(lines)


def _rows(what: str, offsets: Sequence[Array]) -> str:
    """Return mean and 95th percentile of the rigs that could be rectified."""
    some = [part for part in offsets if len(part)]
    if not some:
        return f"{what}: not measured"
    means, p95 = [part.mean() for part in some], [np.percentile(part, 95) for part in some]
    return (
        f"{what} {np.mean(means):.4f} px in the mean, {np.mean(p95):.4f} px at the 95th percentile;"
        f" of the worst of {len(some)} rigs by {max(means):.4f} and {max(p95):.4f} px"
    )


def main() -> None:
    """Calibrate many rigs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--rigs", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="number of the first rig")
    parser.add_argument("--views", type=int, default=12)
    parser.add_argument("--alone", type=int, default=4, help="more views, for one camera each")
    parser.add_argument("--model", choices=tuple(LENSES), default="pinhole")
    parser.add_argument("--corners", action="store_true")
    parser.add_argument("--size", type=int, nargs=2, default=(640, 480))
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    options = parser.parse_args()
    size = cast(tuple[int, int], tuple(options.size))
    rigs = Rigs(options.model, options.views, options.alone, size, options.corners)
    numbers = range(options.first, options.first + options.rigs)
    with ProcessPoolExecutor(options.processes) as pool:
        trials = list(pool.map(partial(calibrated, rigs), numbers))
    print(table(trials))


if __name__ == "__main__":
    main()
