"""What each filter of the cloud takes away: wrong points, or right ones?

    python benchmarks/cloud_filters.py data DATASETS/middlebury-2003 DATASETS/middlebury-2005

Each pair with truth below the folders is matched and triangulated; a point is wrong if its
disparity is more than a pixel from the truth, and where the truth is unknown it is not counted.
Of each filter alone, on the points that are kept: the share of the wrong points that it takes, the
share of the right ones, and how many of the points that it takes are wrong. A filter is worth
having if the last is well above one half.
"""

from __future__ import annotations

import sys
from argparse import ArgumentParser
from collections.abc import Callable
from pathlib import Path

import numpy as np

from recon.cloud_filters import radius_inliers, statistical_inliers, uniform_positions
from recon.evaluation.layouts import find_scenes, read_scene
from recon.evaluation.scene import Scene
from recon.settings import load_preset
from recon.triangulation import Triangulation, flying_pixels
from recon.types import Array, DisparityMap, PointCloud

WRONG_PX = 1.0
STATISTICAL = [(20, 1.0), (20, 2.0), (20, 3.0)]
RADIUS = [(2.0, 4), (4.0, 12), (4.0, 20)]
CONFIDENCE = [0.1, 0.3, 0.5]


def removed_by_filters(disparity: DisparityMap[Array], scene: Scene) -> dict[str, Array]:
    """Return which points (N,) bool each filter takes, by name, and under "wrong" the wrong ones.

    Points without known truth are left out of the answer.
    """
    pair, points = scene.pair, Triangulation(remove_flying_pixels=False)
    kept = points.kept_pixels(disparity, pair.geometry)
    truth, values = scene.truth.disparity, disparity.values[kept]
    if truth.shape != disparity.values.shape:
        raise ValueError(f"{scene.name}: the truth is of another size than the pair")
    flies = flying_pixels(disparity.values)[kept]
    firm = ~flies
    taken = {"wrong": np.abs(values - truth[kept]) > WRONG_PX, "flying pixels": flies}
    cloud = points(disparity, pair, kept=kept).chosen(firm)

    def among_firm(stay: Array) -> Array:
        gone = np.zeros(len(values), bool)
        gone[np.flatnonzero(firm)] = True
        gone[np.flatnonzero(firm)[stay]] = False
        return gone

    for name, inliers in _filters(cloud, pair.geometry.focal_px).items():
        taken[name] = among_firm(inliers())
    known = np.isfinite(truth[kept])
    return {name: which[known] for name, which in taken.items()}


def _filters(cloud: PointCloud, focal_px: float) -> dict[str, Callable[[], Array]]:
    """Return every setting that is tried, by name, as what gives the indices that stay."""
    at = uniform_positions(cloud, focal_px)
    return {
        **{
            f"confidence {least}": lambda c=least: np.flatnonzero(cloud.confidence >= c)
            for least in CONFIDENCE
        },
        **{
            f"statistical {k} {ratio}": lambda k=k, r=ratio: statistical_inliers(at, k, r)
            for k, ratio in STATISTICAL
        },
        **{
            f"radius {radius} {k}": lambda r=radius, k=k: radius_inliers(at, r, k)
            for radius, k in RADIUS
        },
    }


def report(results: list[dict[str, Array]]) -> None:
    """Print one row a filter over all pairs together."""
    wrong = np.concatenate([taken["wrong"] for taken in results])
    print(f"{len(results)} pairs, {len(wrong):,} points with truth, {wrong.mean():.2%} wrong")
    print(f"{'filter':<20} {'of all':>8} {'of wrong':>9} {'of right':>9} {'wrong of taken':>15}")
    for name in results[0]:
        if name != "wrong":
            gone = np.concatenate([taken[name] for taken in results])
            print(
                f"{name:<20} {gone.mean():8.2%} {gone[wrong].mean():9.2%} "
                f"{gone[~wrong].mean():9.2%} {wrong[gone].mean() if gone.any() else 0:15.1%}"
            )


def main(arguments: list[str] | None = None) -> None:
    """Match, filter, compare, print."""
    parser = ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--preset", default="fast")
    parser.add_argument("--names", default="", help="of scenes, with commas; all if not given")
    asked = parser.parse_args(arguments)
    matcher, names = load_preset(asked.preset).matcher, set(asked.names.split(",")) - {""}
    results = []
    for files in (files for folder in asked.folders for files in find_scenes(folder)):
        if names and files.name not in names:
            continue
        scene = read_scene(files)
        disparity = matcher(scene.pair, scene.disparities)
        results.append(removed_by_filters(disparity, scene))
        print(f"{files.dataset} {files.name}", file=sys.stderr)
    report(results)


if __name__ == "__main__":
    main()
