"""Fit the confidence of a preset on generated pairs, and see whether it comes true on others.

python benchmarks/confidence.py PRESET... [--pairs 48] [--kept 24] [--as-it-is]

Prints the sections `[confidence]` and `[disparity_noise]` for the preset's file: how likely a
disparity is right, and how far off it is if it is that likely. Then, of the pairs that were kept:
how often it was right, by what was said; and how many of the errors are within 1 and 3 of the
standard deviation that was stated, by confidence (normal errors: 68.3 % and 99.7 %).
With --as-it-is the confidence stays that of the file, and only the noise is fitted.
Seeds are far above those of any training.
"""

from __future__ import annotations

import argparse
from dataclasses import fields
from itertools import pairwise

import numpy as np

from recon.confidence import Confidence
from recon.disparity_noise import DisparityNoise
from recon.evaluation.metrics import reliability_curve
from recon.matcher import Matcher
from recon.settings import load_preset
from recon.training.confidence import Cases, fitted, fitted_noise, match_generated
from recon.types import Array, PixelStatus

FIRST_SEED = 10_000_000
EDGES = (0.0, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95, 0.98, 0.99, 1.0)
FEWEST = 200


def section(values: Confidence | DisparityNoise, name: str) -> str:
    """Return the laws of a dataclass as a preset holds them."""
    laws = {f.name: getattr(values, f.name) for f in fields(values)}
    lines = [f"{key} = {list(law)}" for key, law in laws.items() if isinstance(law, tuple)]
    return "\n".join([f"[{name}]", *lines])


def main() -> None:
    """Fit on some pairs and judge on others."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("presets", nargs="+")
    parser.add_argument("--pairs", type=int, default=48)
    parser.add_argument("--kept", type=int, default=24)
    parser.add_argument("--as-it-is", action="store_true", help="keep the preset's confidence")
    options = parser.parse_args()
    seeds = range(FIRST_SEED, FIRST_SEED + options.pairs)
    for name in options.presets:
        matcher = load_preset(name).matcher
        if options.as_it_is and matcher.confidence is None:
            parser.error(f"the preset {name} has no confidence to keep")
        print(f"\n# {name}")
        fit_and_judge(
            matcher,
            matcher.confidence if options.as_it_is else None,
            seeds,
            range(seeds.stop, seeds.stop + options.kept),
        )


def fit_and_judge(
    matcher: Matcher, confidence: Confidence | None, seeds: range, others: range
) -> None:
    """Fit on the pairs of some seeds, the confidence too if there is none, judge on others."""
    cases = match_generated(matcher, seeds)
    if confidence is None:
        confidence = fitted(cases)
        print(section(confidence, "confidence"))
    noise = fitted_noise(cases, confidence.probability(cases.evidence, cases.status))
    print(section(noise, "disparity_noise"), flush=True)

    kept = match_generated(matcher, others)
    said = confidence.probability(kept.evidence, kept.status).numpy()
    say_reliability(kept, said)
    say_sigmas(kept, said, noise(said, kept.status.numpy()))


def say_reliability(kept: Cases, said: Array) -> None:
    """Print how often disparities were right, by the probability that was said."""
    curve = reliability_curve(kept.right.numpy(), said, kept.status.numpy() > 0)
    print("\nshare of pixels, probability said, share within 1 px")
    gap = 0.0
    for pixels, chances, right in zip(*curve.values(), strict=True):
        share, count = pixels / sum(curve["pixels"]), max(pixels, 1)
        print(f"{share:6.3f} {chances / count:6.3f} {right / count:6.3f}")
        gap += share * abs(chances - right) / count
    print(f"mean gap {gap:.3f}")


def say_sigmas(kept: Cases, said: Array, sigma_px: Array) -> None:
    """Print how many of the errors are within what was stated, by state and confidence."""
    error_px, status = kept.error_px.numpy(), kept.status.numpy()
    for state in PixelStatus.with_disparity():
        mine = status == state
        print(f"\n{state.name.lower()}: {mine.mean():.1%} of the pixels")
        print("  confidence   share  stated px  68 % px  within 1  within 3 sigma")
        for low, high in (*pairwise(EDGES), (0.0, 1.0)):
            here = mine & (said >= low) & ((said < high) | (high == EDGES[-1]))
            if here.sum() < FEWEST:
                continue
            off, stated = error_px[here], sigma_px[here]
            print(
                f"  {low:4.2f} - {high:4.2f} {here.sum() / mine.sum():6.1%} "
                f"{np.median(stated):9.3f} {np.quantile(off, 0.6827):8.3f} "
                f"{(off <= stated).mean():9.1%} {(off <= 3 * stated).mean():9.1%}"
            )


if __name__ == "__main__":
    main()
