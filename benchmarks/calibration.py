"""See whether calibrations of generated rigs are right, and whether they know how right they are.

python benchmarks/calibration.py [--rigs 100] [--views 12] [--model pinhole] [--corners]

Each rig photographs a chessboard; with `--corners` its corners are known but for normal noise,
which is quicker. Prints, for each quantity, the root mean square error in its own unit and in
stated deviations, and the share of rigs within three of them.
"""

from __future__ import annotations

import argparse
import time
from typing import cast

import numpy as np

from calib.boards import Corners
from calib.boards.chessboard import Chessboard
from calib.boards.generated import photograph, random_poses, random_rig, seen_corners
from calib.camera import Camera
from calib.estimation import BoardView, LensName, RigEstimate, estimate_rig, judge
from calib.pose import Pose
from calib.rig import StereoCalibration

BOARD = Chessboard(9, 6, 0.03)
CORNER_NOISE_PX = 0.1
QUANTITIES = {
    "focal length": "px",
    "principal point": "px",
    "baseline": "mm",
    "rotation": "deg",
}


def seen(camera: Camera, pose: Pose, seed: int, *, corners: bool) -> Corners | None:
    """Return what a camera finds of the board."""
    if corners:
        return seen_corners(BOARD, camera, pose, noise_px=CORNER_NOISE_PX, seed=seed)
    return BOARD.find(photograph(BOARD, camera, pose, seed=seed))


def errors(
    estimate: RigEstimate, truth: StereoCalibration
) -> dict[str, tuple[list[float], list[float]]]:
    """Return errors of each quantity, and the deviations that were stated for them."""
    found, sure = estimate.calibration, judge(estimate).uncertainty
    sigma = np.sqrt(np.diag(estimate.adjusted.covariance))
    starts = 0, 4 + len(found.left.distortion)
    cameras = list(zip(starts, (found.left, found.right), (truth.left, truth.right), strict=True))
    focal = [list(ours.K[[0, 1], [0, 1]] - theirs.K[[0, 1], [0, 1]]) for _, ours, theirs in cameras]
    centre = [list(ours.K[:2, 2] - theirs.K[:2, 2]) for _, ours, theirs in cameras]
    turn = (found.right_from_left @ truth.right_from_left.inverse()).values[:3]
    return {
        "focal length": (
            [*focal[0], *focal[1]],
            [s for at, *_ in cameras for s in sigma[at : at + 2]],
        ),
        "principal point": (
            [*centre[0], *centre[1]],
            [s for at, *_ in cameras for s in sigma[at + 2 : at + 4]],
        ),
        "baseline": ([1e3 * (found.baseline_m - truth.baseline_m)], [1e3 * sure.baseline_m]),
        "rotation": (list(np.degrees(turn)), list(sure.turn_deg)),
    }


def main() -> None:
    """Calibrate many rigs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--rigs", type=int, default=100)
    parser.add_argument("--views", type=int, default=12)
    parser.add_argument("--model", choices=("pinhole", "fisheye"), default="pinhole")
    parser.add_argument("--corners", action="store_true")
    parser.add_argument("--size", type=int, nargs=2, default=(640, 480))
    options = parser.parse_args()
    size = cast(tuple[int, int], tuple(options.size))
    together: dict[str, tuple[list[float], list[float]]] = {name: ([], []) for name in QUANTITIES}
    rms, seconds = [], 0.0
    for number in range(options.rigs):
        rig = random_rig(size, options.model, seed=number)
        poses = random_poses(BOARD, rig, options.views, seed=number + options.rigs)
        views = []
        for index, pose in enumerate(poses):
            cameras = (rig.left, pose), (rig.right, rig.right_from_left @ pose)
            left, right = (
                seen(camera, at, 10_000 * number + 2 * index + side, corners=options.corners)
                for side, (camera, at) in enumerate(cameras)
            )
            views.append(BoardView(f"{index}", left, right))
        began = time.perf_counter()
        estimate = estimate_rig(BOARD, views, size, cast(LensName, options.model))
        seconds += time.perf_counter() - began
        rms.append(estimate.adjusted.rms_px)
        for name, (off, sigma) in errors(estimate, rig).items():
            together[name][0].extend(off)
            together[name][1].extend(sigma)
    print(f"{options.rigs} rigs, {np.mean(rms):.3f} px RMS, {seconds / options.rigs:.2f} s each")
    print("quantity          RMS error      in deviations  within three")
    for name, (off, sigma) in together.items():
        error, ratio = np.array(off), np.abs(np.array(off) / np.array(sigma))
        print(
            f"{name:16s} {np.sqrt((error**2).mean()):9.4f} {QUANTITIES[name]:4s} "
            f"{np.sqrt((ratio**2).mean()):9.2f} {(ratio < 3).mean():14.1%}"
        )


if __name__ == "__main__":
    main()
