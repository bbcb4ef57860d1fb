"""Fit the confidence of a preset on generated pairs, and see whether it comes true on others.

python benchmarks/confidence.py PRESET [--pairs 48] [--kept 24]

Prints the `[confidence]` section for the preset's file. Seeds are far above those of any training.
"""

from __future__ import annotations

import argparse
from dataclasses import fields

from recon.confidence import Confidence
from recon.settings import load_preset
from recon.training.confidence import fitted, match_generated, probabilities, reliability

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
    said = probabilities(confidence, kept)
    print("\nshare of pixels, probability said, share within 1 px")
    gap = 0.0
    for share, chance, truth in reliability(said, kept.right):
        print(f"{share:6.3f} {chance:6.3f} {truth:6.3f}")
        gap += share * abs(chance - truth)
    print(f"mean gap {gap:.3f}")


if __name__ == "__main__":
    main()
