"""Time every stage on the sample pair at three sizes, beside OpenCV's SGBM in the same run.

python benchmarks/speed.py [--presets paper ...] [--sizes "0.35 MP x 75" ...]
    [--repeats 3] [--device cpu] [--json FILE]

One run of each size warms up (compiles, loads weights) and is not counted. Machines differ and
are noisy: compare the ratio to SGBM.
"""

from __future__ import annotations

import argparse
import json
import platform
import resource
import statistics
import time
from pathlib import Path

import torch

from calib import RectifiedPair
from recon import load_preset, read_pair
from recon.evaluation import OPENCV_MATCHERS
from recon.report import versions
from recon.sample_pairs import sample_folder
from recon.timing import Stopwatch

SIZES = {"0.09 MP x 38": (0.5, 38), "0.35 MP x 75": (1.0, 75), "1.4 MP x 150": (2.0, 150)}
BASE_WIDTH = 700


def sized_pair(scale: float) -> RectifiedPair:
    """Return the sample pair, 700 pixels wide times `scale`."""
    folder = sample_folder() / "workshop"
    files = (folder / "left.png", folder / "right.png", folder / "rig.json")
    width = read_pair(*files).pair.left.shape[1]
    return read_pair(*files, scale=scale * BASE_WIDTH / width).pair


def seconds_of(pair: RectifiedPair, preset: str, candidates: int, device: str) -> dict[str, float]:
    """Match once; return the seconds of each stage, and their sum as `total`."""
    watch = Stopwatch()
    matcher = load_preset(preset).matcher
    started = time.perf_counter()
    matcher(pair, range(candidates), device=device, observe=watch)
    return {**watch.seconds, "total": time.perf_counter() - started}


def medians(runs: list[dict[str, float]]) -> dict[str, float]:
    """Return the median of each stage over runs."""
    return {stage: statistics.median(run[stage] for run in runs) for stage in runs[0]}


def main() -> None:
    """Print a table and write the same as JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--presets", nargs="*", default=["paper"])
    parser.add_argument("--sizes", nargs="*", default=list(SIZES), choices=list(SIZES))
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    results: dict[str, object] = {
        "machine": platform.processor() or platform.machine(),
        "threads": torch.get_num_threads(),
        "versions": versions(),
    }
    for name in options.sizes:
        scale, candidates = SIZES[name]
        pair = sized_pair(scale)
        rival = []
        for _ in range(options.repeats + 1):
            started = time.perf_counter()
            OPENCV_MATCHERS["opencv-sgbm-rows"](pair, range(candidates))
            rival.append(time.perf_counter() - started)
        sgbm = statistics.median(rival[1:])
        print(f"\n{name} ({pair.left.shape[1]} x {pair.left.shape[0]}): SGBM {sgbm:.3f} s")
        for preset in options.presets:
            runs = [
                seconds_of(pair, preset, candidates, options.device)
                for _ in range(options.repeats + 1)
            ]
            stages = medians(runs[1:])
            results[f"{name}, {preset}"] = {"sgbm": sgbm, "first": runs[0]["total"], **stages}
            for stage, value in stages.items():
                print(f"  {preset:8} {stage:28} {value:8.3f} s {value / sgbm:8.1f} x SGBM")
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"\npeak memory of the whole run {peak_mb:.0f} MB")
    results["peak_mb"] = peak_mb
    if options.json:
        options.json.write_text(json.dumps(results, indent=2))


if __name__ == "__main__":
    main()
