"""How far the normals of a cloud are from those of the true surface, in degrees.

    python benchmarks/normals.py data --preset best

Each calibrated pair with truth below the folder is matched; where the truth is dense and the
disparity within a pixel of it, its normal is compared with one fitted to the true disparities in a
window of 5 x 5 pixels. Printed for the windows in use, for windows of one size, and, for what a
bend costs, the same fits on the true disparities.
"""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path

import numpy as np

import recon.normals
from recon.evaluation.layouts import find_scenes, read_scene
from recon.settings import load_preset
from recon.triangulation import Triangulation
from recon.types import Array

REFERENCE = (2,)
WINDOWS = (recon.normals.RADII_PX, (5,), (10,), (15,))
WRONG_PX = 1.0


def fitted(values: Array, geometry: object, radii: tuple[int, ...]) -> Array:
    """Return the normals (H, W, 3) that windows of other sizes give."""
    kept, recon.normals.RADII_PX = recon.normals.RADII_PX, radii
    try:
        return recon.normals.surface_normals(values, geometry)
    finally:
        recon.normals.RADII_PX = kept


def told(normals: Array, expected: Array) -> str:
    """Return median, mean and 90th percentile of the angles between normals (N, 3)."""
    degrees = np.degrees(np.arccos(np.clip((normals * expected).sum(axis=1), -1, 1)))
    median, p90 = np.percentile(degrees, (50, 90))
    return f"median {median:5.2f}  mean {degrees.mean():5.2f}  90 % {p90:5.1f}"


def main(arguments: list[str] | None = None) -> None:
    """Match, fit, compare, print."""
    parser = ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--preset", default="fast")
    asked = parser.parse_args(arguments)
    matcher = load_preset(asked.preset).matcher
    for files in find_scenes(asked.folder):
        scene = read_scene(files)
        geometry, truth = scene.pair.geometry, scene.truth.disparity
        disparity = matcher(scene.pair, scene.disparities)
        kept = Triangulation().kept_pixels(disparity, geometry)
        good = kept & (np.abs(disparity.values - truth) < WRONG_PX)
        expected = fitted(truth, geometry, REFERENCE)[good]
        print(f"{files.dataset} {files.name}, {good.sum():,} points, degrees")
        for radii in WINDOWS:
            found = fitted(np.where(kept, disparity.values, np.nan), geometry, radii)[good]
            exact = fitted(truth, geometry, radii)[good]
            print(f"  {radii!s:<12} {told(found, expected)}   of truth: {told(exact, expected)}")


if __name__ == "__main__":
    main()
