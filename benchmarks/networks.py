"""What the networks cost: weights, operations, and seconds beside this machine's best.

python benchmarks/networks.py [--networks fast wide regulariser] [--types float32 bfloat16]
    [--repeats 3] [--device cpu] [--json FILE]

A pair is two images of 720 x 500, for the regulariser with 75 candidates a pixel, in float32 and
under autocast to bfloat16. Operations are those of convolutions and matrix products, as torch
counts them. The peak is a product of two 2048 x 2048 matrices of the same type, timed in turn with
the networks: machines are noisy, so the fastest of the repeats counts, and shares are what to
compare.
"""

from __future__ import annotations

import argparse
import json
import platform
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import torch
from torch import nn
from torch.utils.flop_counter import FlopCounterMode

from recon.networks import Architecture, FeatureNetwork, Regulariser
from recon.networks.architecture import VARIANTS
from recon.report import versions

WIDTH, HEIGHT, CANDIDATES = 720, 500, 75
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


Work = tuple[nn.Module, Callable[[], object]]
"""A network, and what it does for a pair."""


def of_features(shape: Architecture, device: torch.device) -> Work:
    """Return a network with random weights, laid out as loaded ones are, and both its views."""
    network = FeatureNetwork(shape).eval().requires_grad_(requires_grad=False).to(device)
    network = network.to(memory_format=torch.channels_last)
    views = torch.rand(2, 1, 3, HEIGHT, WIDTH, device=device)
    return network, lambda: [network(view) for view in views]


def of_regulariser(device: torch.device) -> Work:
    """Return the same for the network that looks around among costs, one view after the other."""
    network = Regulariser().fused().requires_grad_(requires_grad=False).laid_out().to(device)
    volume = torch.rand(1, HEIGHT, WIDTH, CANDIDATES, device=device)
    winner = volume.argmin(-1).float()
    guide = torch.rand(1, 3, HEIGHT, WIDTH, device=device)
    return network, lambda: [network(volume, volume, winner, guide) for _ in range(2)]


@torch.inference_mode()
def gflop_of(run: Callable[[], object]) -> float:
    """Return the 10^9 operations of convolutions and matrix products, 2 a product."""
    with FlopCounterMode(display=False) as counter:
        run()
    return float(counter.get_total_flops()) / 1e9


@torch.inference_mode()
def measured(
    run: Callable[[], object],
    gflop: float,
    kind: torch.dtype,
    device: torch.device,
    repeats: int,
) -> dict[str, float]:
    """Return the fewest seconds of a pair, and the rate as a share of that of matrix products."""
    factors = torch.rand(2, SIDE, SIDE, device=device).to(kind)

    def pair() -> object:
        with torch.autocast(device.type, torch.bfloat16, enabled=kind is torch.bfloat16):
            return run()

    runs = [
        (seconds_of(pair, device), seconds_of(lambda: torch.mm(*factors), device))
        for _ in range(repeats + 1)
    ]
    seconds, product = (min(column) for column in zip(*runs[1:], strict=True))
    rate = gflop / seconds
    peak = 2 * SIDE**3 / 1e9 / product
    return {"seconds": seconds, "GFLOP/s": rate, "peak GFLOP/s": peak, "share": rate / peak}


def main() -> None:
    """Print a table and write the same as JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    shapes = {**VARIANTS, **TRIALS}
    works: dict[str, Callable[[torch.device], Work]] = {
        **{name: partial(of_features, shape) for name, shape in shapes.items()},
        "regulariser": of_regulariser,
    }
    usual = [*VARIANTS, "regulariser"]
    parser.add_argument("--networks", nargs="*", default=usual, choices=list(works))
    parser.add_argument("--types", nargs="*", default=list(TYPES), choices=list(TYPES))
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
    print("network            weights  GFLOP a pair  type      seconds  GFLOP/s  of peak")
    for name in options.networks:
        network, run = works[name](device)
        weights, gflop = sum(value.numel() for value in network.parameters()), gflop_of(run)
        for kind in options.types:
            found = measured(run, gflop, TYPES[kind], device, options.repeats)
            results[f"{name}, {kind}"] = {"weights": weights, "GFLOP": gflop, **found}
            print(
                f"{name:16} {weights:9,} {gflop:13.0f}  {kind:8} {found['seconds']:8.2f} "
                f"{found['GFLOP/s']:8.0f} {found['share']:8.0%}"
            )
    if options.json:
        options.json.write_text(json.dumps(results, indent=2))


if __name__ == "__main__":
    main()
