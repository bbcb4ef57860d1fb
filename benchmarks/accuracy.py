"""Compare presets with OpenCV's SGBM on Middlebury v3 at quarter size.

python benchmarks/accuracy.py DATASETS [--presets paper ...] [--scenes Teddy ...]

Protocol `official@Q`: truth at quarter size, errors times 4 (full-size pixels), dense maps clipped
to [0, ndisp], official weights (1, and 1/2 for PianoL, Playroom, Playtable, Shelves, Vintage).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from recon import load_preset, read_pair
from recon.files import read_pfm

FULL_PX_PER_Q_PX = 4
HALF_WEIGHT = {"PianoL", "Playroom", "Playtable", "Shelves", "Vintage"}
COLUMNS = ("nonocc avgerr", "nonocc bad2", "nonocc bad4", "all avgerr", "all bad2", "seconds")


def sgbm_with_row_fill(left: np.ndarray, right: np.ndarray, candidates: int) -> np.ndarray:
    """Match with OpenCV's SGBM, mode HH, blocks of 3; holes take the farther neighbour of the row.

    Args:
        left: (H, W, 3) uint8 RGB.
        right: (H, W, 3), likewise.
        candidates: disparities 0 to candidates - 1 are searched.

    Returns:
        (H, W) float32 disparities.
    """
    count = -(-candidates // 16) * 16
    padded = (
        cv2.copyMakeBorder(
            np.ascontiguousarray(image[..., ::-1]), 0, 0, count, 0, cv2.BORDER_REPLICATE
        )
        for image in (left, right)
    )
    matcher = cv2.StereoSGBM_create(
        minDisparity=0, numDisparities=count, blockSize=3, P1=8 * 3 * 9, P2=32 * 3 * 9,
        disp12MaxDiff=1, preFilterCap=63, uniquenessRatio=0, speckleWindowSize=0, speckleRange=0,
        mode=cv2.STEREO_SGBM_MODE_HH,
    )  # fmt: skip
    values = matcher.compute(*padded)[:, count:].astype(np.float32) / 16
    for row in values:
        known = np.flatnonzero(row >= 0)
        columns = np.arange(len(row))
        after = np.searchsorted(known, columns).clip(0, len(known) - 1)
        before = (np.searchsorted(known, columns, side="right") - 1).clip(0)
        row[:] = np.where(row >= 0, row, np.minimum(row[known[before]], row[known[after]]))
    return values


def errors(values: np.ndarray, folder: Path, candidates: int) -> list[float]:
    """Return the figures of `COLUMNS` but the time, of one scene."""
    truth = read_pfm(folder / "disp0GT.pfm")
    visible = cv2.imread(str(folder / "mask0nocc.png"), cv2.IMREAD_GRAYSCALE) == 255
    error = FULL_PX_PER_Q_PX * np.abs(np.clip(values, 0, candidates) - truth)
    seen, known = error[visible & np.isfinite(truth)], error[np.isfinite(truth)]
    return [
        seen.mean(), 100 * (seen > 2).mean(), 100 * (seen > 4).mean(),
        known.mean(), 100 * (known > 2).mean(),
    ]  # fmt: skip


def row(match: Callable[[], np.ndarray], folder: Path, candidates: int) -> list[float]:
    """Match one scene and return the figures of `COLUMNS`."""
    started = time.perf_counter()
    values = match()
    seconds = time.perf_counter() - started
    return [*errors(values, folder, candidates), seconds]


def table(datasets: Path, method: str, scenes: list[str]) -> dict[str, list[float]]:
    """Return one row a scene, and the weighted mean."""
    rows = {}
    for scene in scenes:
        folder = datasets / "middlebury-v3" / "Q" / scene
        source = read_pair(folder / "im0.png", folder / "im1.png", folder / "calib.txt")
        pair, disparities = source.pair, source.disparities
        if method == "opencv-sgbm":
            match = lambda: sgbm_with_row_fill(pair.left, pair.right, disparities.stop)  # noqa: E731, B023
        else:
            preset = load_preset(method)
            match = lambda: preset.matcher(pair, disparities).values  # noqa: E731, B023
        rows[scene] = row(match, folder, disparities.stop)
    weights = [0.5 if scene in HALF_WEIGHT else 1.0 for scene in scenes]
    rows["weighted mean"] = list(np.average(list(rows.values()), axis=0, weights=weights))
    return rows


def main() -> None:
    """Print one table a method."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("datasets", type=Path)
    parser.add_argument("--presets", nargs="*", default=["opencv-sgbm", "paper"])
    parser.add_argument("--scenes", nargs="*")
    options = parser.parse_args()
    folders = sorted((options.datasets / "middlebury-v3" / "Q").iterdir())
    scenes = options.scenes or [folder.name for folder in folders]
    for method in options.presets:
        print(f"\n{method}, official@Q".ljust(24), *(f"{name:>14}" for name in COLUMNS))
        for scene, figures in table(options.datasets, method, scenes).items():
            print(scene.ljust(22), *(f"{figure:14.2f}" for figure in figures))


if __name__ == "__main__":
    main()
