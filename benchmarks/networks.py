"""What the feature networks cost: weights, operations, and seconds beside this machine's best.

python benchmarks/networks.py [--variants fast wide] [--repeats 3] [--device cpu] [--json FILE]

A pair is two images of 720 x 500, in float32 and under autocast to bfloat16. The peak is a product
of two 2048 x 2048 matrices of the same type, timed in turn with the networks: machines are noisy,
so the fastest of the repeats counts, and shares are what to compare.
"""

from __future__ import annotations

import argparse
import json
import platform
import time
from collections.abc import Callable
from pathlib import Path

import torch
from torch import Tensor

from recon.networks import Architecture, FeatureNetwork
from recon.networks.architecture import VARIANTS
from recon.report import versions

WIDTH, HEIGHT = 720, 500
SIDE = 2048
TYPES = {"float32": torch.float32, "bfloat16": torch.bfloat16}
TRIALS = {
    "plain 12": Architecture(depth=12),
    "dilated 10": Architecture(depth=10, dilations=(1, 1, 2, 2, 4, 4, 8, 8, 4, 1)),
    "pooled 64 64": Architecture(channels=(64, 64), depth=4),
    "pooled 64 64 96": Architecture(channels=(64, 64, 96), depth=3),
    "pooled 64 96 128": Architecture(channels=(64, 96, 128), depth=3),
}
"""Others that were considered."""


def seconds_of(work: Callable[[], object], device: torch.device) -> float:
    """Run once and wait for the device."""
    started = time.perf_counter()
    work()
    if device.type != "cpu":
        torch.get_device_module(device).synchronize(device)
    return time.perf_counter() - started


def ready(shape: Architecture, device: torch.device) -> FeatureNetwork:
    """Return a network with random weights, laid out as loaded ones are."""
    network = FeatureNetwork(shape).eval().requires_grad_(requires_grad=False).to(device)
    return network.to(memory_format=torch.channels_last)


@torch.inference_mode()
def measured(
    shape: Architecture, kind: torch.dtype, device: torch.device, repeats: int
) -> dict[str, float]:
    """Return the fewest seconds of a pair, and the rate as a share of that of matrix products."""
    network = ready(shape, device)
    views = torch.rand(2, 1, 3, HEIGHT, WIDTH, device=device)
    factors = torch.rand(2, SIDE, SIDE, device=device).to(kind)

    def pair() -> list[Tensor]:
        with torch.autocast(device.type, torch.bfloat16, enabled=kind is torch.bfloat16):
            return [network(view) for view in views]

    runs = [
        (seconds_of(pair, device), seconds_of(lambda: torch.mm(*factors), device))
        for _ in range(repeats + 1)
    ]
    seconds, product = (min(column) for column in zip(*runs[1:], strict=True))
    rate = shape.gflop_per_megapixel_pair * WIDTH * HEIGHT / 1e6 / seconds
    peak = 2 * SIDE**3 / 1e9 / product
    return {"seconds": seconds, "GFLOP/s": rate, "peak GFLOP/s": peak, "share": rate / peak}


def main() -> None:
    """Print a table and write the same as JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    known = {**VARIANTS, **TRIALS}
    parser.add_argument("--variants", nargs="*", default=list(VARIANTS), choices=list(known))
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    device = torch.device(options.device)
    results: dict[str, object] = {
        "machine": platform.processor() or platform.machine(),
        "threads": torch.get_num_threads(),
        "versions": versions(),
    }
    print("network            weights  GFLOP/MP  margin px  type      seconds  GFLOP/s  of peak")
    for name in options.variants:
        shape = known[name]
        weights = sum(value.numel() for value in FeatureNetwork(shape).parameters())
        for kind, dtype in TYPES.items():
            found = measured(shape, dtype, device, options.repeats)
            results[f"{name}, {kind}"] = {"weights": weights, **found}
            print(
                f"{name:16} {weights:9,} {shape.gflop_per_megapixel_pair:9.0f} "
                f"{shape.margin_px:10}  {kind:8} {found['seconds']:8.2f} "
                f"{found['GFLOP/s']:8.0f} {found['share']:8.0%}"
            )
    if options.json:
        options.json.write_text(json.dumps(results, indent=2))


if __name__ == "__main__":
    main()
