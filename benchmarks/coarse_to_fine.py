"""Match a drawn pair of 6 MP with 760 candidates coarse to fine and directly.

python benchmarks/coarse_to_fine.py [--preset fast] [--scale 1] [--direct-limit-mb 3000]
    [--set coarse_to_fine.shrink=2 ...] [--skip-direct] [--json FILE]

The truth is exact: a slanted wall, a ball, a box and two rods before it. Says time, peak memory of
the process, errors of both and how far they agree. Strips of 768 MB would be 16 rows high at this
size, and semi-global paths would begin nine times as often as rows: directly the limit is higher.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch

from calib import RectifiedGeometry, RectifiedPair
from recon import load_preset
from recon.evaluation.memory import forget_peak, peak_mb
from recon.settings import overrides_from
from recon.training.composition import Coat, Thing, View, assemble, rotation_about
from recon.training.furnishing import rod
from recon.training.scenes import render
from recon.training.textures import noise_table
from recon.types import Array, CostVolume, DisparityMap

WIDTH, HEIGHT, CANDIDATES = 2900, 2000, 760
FOCAL_SHARE, BASELINE_M = 0.8, 0.5
THIN_ROD_PX, THICK_ROD_PX = 4, 40
"""Widths in an image of `WIDTH`: one coarse pixel, and ten."""


def drawn(scale: float) -> tuple[RectifiedPair, Array, Array]:
    """Return a pair of `scale` times the size, its disparity, and what both cameras see."""
    width, height = round(WIDTH * scale), round(HEIGHT * scale)
    view = View(width, height, FOCAL_SHARE * width, BASELINE_M)
    axes = torch.eye(3)
    fine = scale  # detail of a few pixels at every size
    wall = rotation_about(axes[1], 0.35)
    box = rotation_about(axes[0], 0.5) @ rotation_about(axes[1], 0.6)
    things = [
        Thing("rectangle", (0, 0, 4.5), (20, 20, 1), wall, _coat(50 * fine, (0.0, 0.0))),
        Thing("ellipsoid", (-0.1, 0.2, 2.2), (0.35, 0.3, 0.3), axes, _coat(100 * fine, (9.0, 1.0))),
        Thing("box", (0.8, -0.1, 2.0), (0.25, 0.25, 0.25), box, _coat(100 * fine, (200.0, 50.0))),
        *(
            rod((x, -3.0, 2.5), (x, 3.0, 2.5), pixels / WIDTH * 2.5 / FOCAL_SHARE / 2,
                _coat(100 * fine, (80.0, x)))
            for x, pixels in ((0.35, THIN_ROD_PX), (-0.6, THICK_ROD_PX))
        ),
    ]  # fmt: skip
    table = noise_table(torch.Generator().manual_seed(3))
    light = torch.tensor([0.3, -1.0, -0.6])
    scene = assemble(things, table, light / light.norm(), shadows=False)
    sample = render(scene, view, samples=1)
    left, right = ((255 * image).round().byte().numpy() for image in (sample.left, sample.right))
    geometry = RectifiedGeometry(
        (width, height), view.focal_px, view.centre, view.centre, BASELINE_M
    )
    pair = RectifiedPair(left, right, geometry)
    return pair, sample.disparity_left.numpy(), sample.visible.numpy()


def _coat(frequency: float, offset: tuple[float, float]) -> Coat:
    colours = torch.tensor([[0.05, 0.1, 0.15], [0.9, 0.8, 0.6]])
    return Coat("noise", colours, frequency, slope=0.3, grain=0.3, offset=offset)


def measured(
    preset: str, overrides: Mapping[str, object], pair: RectifiedPair, searched: range
) -> tuple[DisparityMap[Array], dict[str, float]]:
    """Match once; return the map, and seconds, memory and how many candidates were compared."""
    compared = 0

    def count(stage: str, result: object) -> None:
        nonlocal compared
        if stage.startswith("matching_cost") and isinstance(result, CostVolume):
            compared += result.cost.numel()

    matcher = load_preset(preset, overrides).matcher
    forget_peak()
    started = time.perf_counter(), time.process_time()
    found = matcher(pair, searched, observe=count)
    figures = {
        "seconds": time.perf_counter() - started[0],
        "cpu_seconds": time.process_time() - started[1],
        "peak_mb": peak_mb(),
        "candidates_compared": compared / 1e6,
    }
    return found, figures


def errors(found: DisparityMap[Array], truth: Array, visible: Array) -> dict[str, float]:
    """Return shares of the pixels that both cameras see, in %, and the mean error in px."""
    error = np.abs(found.values - truth)[visible]
    return {
        "bad1": 100 * float((~(error <= 1)).mean()),
        "bad4": 100 * float((~(error <= 4)).mean()),
        "avgerr": float(np.nanmean(error)),
    }


def main() -> None:
    """Print both rows, and write the same as JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--preset", default="fast")
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--direct-limit-mb", type=float, default=3000.0)
    parser.add_argument("--set", action="append", default=[], metavar="SETTING=VALUE")
    parser.add_argument("--skip-direct", action="store_true")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    pair, truth, visible = drawn(options.scale)
    searched = range(round(CANDIDATES * options.scale))
    print(f"{pair.left.shape[1]} x {pair.left.shape[0]} x {len(searched)}, {options.preset};")
    print(f"true disparities {truth.min():.0f} to {truth.max():.0f} px", flush=True)
    small, *_ = drawn(0.1)
    measured(options.preset, {}, small, range(CANDIDATES // 10))  # compiles, which must not count
    settings = {
        "coarse to fine": ["coarse_to_fine=true", *options.set],
        "directly": [f"volume_limit_mb={options.direct_limit_mb}"],
    }
    results: dict[str, dict[str, float]] = {}
    maps = []
    for name, texts in list(settings.items())[: 1 if options.skip_direct else 2]:
        found, figures = measured(options.preset, overrides_from(None, texts), pair, searched)
        maps.append(found.values)
        results[name] = {**figures, **errors(found, truth, visible)}
        print(f"{name:15}", *(f"{key} {value:.2f}" for key, value in results[name].items()),
              flush=True)  # fmt: skip
    if len(maps) == 2:
        agree = 100 * float((np.abs(maps[0] - maps[1]) <= 1).mean())
        print(f"within 1 px of each other: {agree:.2f} %")
        results["agreement"] = {"within_1px": agree}
    if options.json:
        options.json.write_text(json.dumps(results, indent=2))


if __name__ == "__main__":
    main()
