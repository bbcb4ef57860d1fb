"""Say how far fused surfaces lie from generated ones, and which correlation of errors explains it.

python benchmarks/fused_errors.py [--preset fast] [--scenes 6] [--first-seed 40] [--out FILE.json]

Three walks of eight pairs (ahead, aside and round) through random scenes with exact poses. At every
vertex that a camera sees stand the views n that saw it, what independent errors would leave,
1 / sqrt(W), and how far it lies from the true surface. If the errors of two views at a place have
the correlation r, they leave sqrt((1 + (n - 1) r) / W).
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from sequence import depth_seen, drawn_pairs

from calib import Pose
from recon.sequence import StereoSource, fuse_sequence
from recon.sequence.sources import looked_at_first
from recon.settings import load_preset
from recon.training.composition import Scene, View
from recon.training.recipe import Recipe
from recon.training.scenery import compose
from recon.training.walks import off_surface, seen_from
from recon.types import Array

SCENES = ("room", "clutter", "bare_room", "relief", "close_up", "colonnade")
SIZE = (360, 270)
STEPS = 8
PER_WALK = 5000
ONE_SIGMA, TWO_SIGMA = 0.6827, 0.9545
WALKS = {  # a turn in radians and a way in baselines, for each step
    "ahead": (0.0, -0.01, 0.0, 0.3, 0.07, 0.7),
    "aside": (0.0, -0.012, 0.0, 0.6, 0.0, 0.0),
    "round": (0.006, 0.0, 0.0, 0.0, -0.45, 0.15),
}
CORRELATIONS = tuple(n / 20 for n in range(21))


class Vertices(NamedTuple):
    """What is known of N vertices of a fused surface, (N,) each: views, and metres."""

    views: Array
    independent_m: Array
    off_m: Array


def fused_errors(scene: Scene, view: View, poses: tuple[Pose, ...], preset: str) -> Vertices:
    """Fuse pairs seen from poses, and measure every vertex from the first pose that sees it."""
    with tempfile.TemporaryDirectory() as place:
        frames, rig = drawn_pairs(scene, view, poses, Path(place))
        look = looked_at_first(frames, rig)
        source = StereoSource(rig, load_preset(preset), look.disparities, look.pair.geometry)
        fused = fuse_sequence(frames, source, poses)
        views = [source.view(source.see(frame), Pose.identity()) for frame in frames]
    surface = fused.surface
    off = np.full(len(surface.vertices), np.nan)
    for seen, pose in zip(views, poses, strict=True):
        cast = depth_seen(surface, seen, pose)
        x, y, z = pose.inverse().apply(surface.vertices.astype(np.float64)).T
        column = np.rint(x / z * seen.K[0, 0] + seen.K[0, 2])
        row = np.rint(y / z * seen.K[1, 1] + seen.K[1, 2])
        height, width = cast.shape
        sees = np.isnan(off) & (z > 0) & (column >= 0) & (column < width)
        sees &= (row >= 0) & (row < height)
        depth = cast[row[sees].astype(int), column[sees].astype(int)]
        sees[sees] = np.abs(z[sees] - depth) < 3 * fused.fusion.voxel_m
        off[sees] = off_surface(seen_from(scene, pose), np.stack((x, y, z), 1)[sees])
    known = np.isfinite(off)
    n, stated = surface.views[known], surface.sigma_m[known]
    alike = np.sqrt(1 + (n - 1) * fused.fusion.correlation)
    return Vertices(n, stated / alike, off[known])


def times_stated(found: Vertices, correlation: float, share: float = ONE_SIGMA) -> float:
    """Return within how many stated deviations a share of the vertices lies."""
    stated = found.independent_m * np.sqrt(1 + (found.views - 1) * correlation)
    return float(np.quantile(found.off_m / stated, share))


def main() -> None:
    """Walk through every scene, then say what explains the errors."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--preset", default="fast")
    parser.add_argument("--scenes", type=int, default=6)
    parser.add_argument("--first-seed", type=int, default=40)
    parser.add_argument("--out", type=Path, help="write the figures there, as JSON")
    options = parser.parse_args()
    dice, walks = np.random.default_rng(0), {}
    for seed in range(options.first_seed, options.first_seed + options.scenes):
        generator = torch.Generator().manual_seed(seed)
        scene, view = compose(generator, SIZE, Recipe(scenes=SCENES))
        for name, step in WALKS.items():
            metres = np.array(step) * ([1] * 3 + [view.baseline_m] * 3)
            poses = tuple(Pose.from_values(n * metres) for n in range(STEPS))
            found = fused_errors(scene, view, poses, options.preset)
            some = dice.choice(len(found.views), min(PER_WALK, len(found.views)), replace=False)
            walks[f"{seed} {name}"] = Vertices(*(part[some] for part in found))
            print(
                f"seed {seed}, {name}: {len(found.views):,} vertices, {found.views.mean():.1f} "
                f"views, {np.median(found.off_m) * 1000:.2f} mm off in the median, 68 % within "
                f"{times_stated(found, 0.0):.2f} of what independent errors would leave",
                flush=True,
            )
    everything = Vertices(*(np.concatenate(part) for part in zip(*walks.values(), strict=True)))
    fits = {r: times_stated(everything, r) for r in CORRELATIONS}
    best = min(fits, key=lambda r: abs(fits[r] - 1))
    apart = np.quantile([times_stated(walk, best) for walk in walks.values()], (0, 0.5, 1))
    print(
        f"correlation {best:g}: 68 % within {fits[best]:.2f} stated deviations, 95 % within "
        f"{times_stated(everything, best, TWO_SIGMA):.2f}; of single walks 68 % within "
        f"{apart[0]:.2f} to {apart[2]:.2f}, {apart[1]:.2f} in the median"
    )
    if options.out:
        figures = {"correlation": best, "68 % within": {str(r): fits[r] for r in fits}}
        options.out.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
