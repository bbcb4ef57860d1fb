"""Fit the confidence of a preset on generated pairs, and see whether it comes true on others.

python benchmarks/confidence.py PRESET [--pairs 48] [--kept 24]

Prints the `[confidence]` section for the preset's file. Seeds are far above those of any training.
"""

from __future__ import annotations

import argparse
from dataclasses import fields

from recon.confidence import Confidence
from recon.evaluation.metrics import reliability_curve
from recon.settings import load_preset
from recon.training.confidence import fitted, match_generated

FIRST_SEED = 10_000_000


def section(confidence: Confidence) -> str:
    """Return the weights as a preset holds them."""
    lines = [f"{f.name} = {list(getattr(confidence, f.name))}" for f in fields(confidence)]
    return "\n".join(["[confidence]", *lines])


def main() -> None:
    """Fit on some pairs and judge on others."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("preset")
    parser.add_argument("--pairs", type=int, default=48)
    parser.add_argument("--kept", type=int, default=24)
    options = parser.parse_args()
    matcher = load_preset(options.preset).matcher
    seeds = range(FIRST_SEED, FIRST_SEED + options.pairs)
    confidence = fitted(match_generated(matcher, seeds))
    print(section(confidence))

    kept = match_generated(matcher, range(seeds.stop, seeds.stop + options.kept))
    said = confidence.probability(kept.evidence, kept.status).numpy()
    curve = reliability_curve(kept.right.numpy(), said, kept.status.numpy() > 0)
    print("\nshare of pixels, probability said, share within 1 px")
    gap = 0.0
    for pixels, chances, right in zip(*curve.values(), strict=True):
        share, count = pixels / sum(curve["pixels"]), max(pixels, 1)
        print(f"{share:6.3f} {chances / count:6.3f} {right / count:6.3f}")
        gap += share * abs(chances - right) / count
    print(f"mean gap {gap:.3f}")


if __name__ == "__main__":
    main()
