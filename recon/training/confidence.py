"""Fit the probabilities of a preset, and the errors they mean, on generated scenes.

No network was trained on these scenes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from calib.pair import RectifiedPair
from calib.rig import RectifiedGeometry
from recon.confidence import Confidence, evidence
from recon.disparity_noise import KNOTS, DisparityNoise, log_odds
from recon.matcher import Matcher
from recon.training.augmentation import Augmentation
from recon.training.pool import draw_pair
from recon.types import Array, PixelStatus

__all__ = ["Cases", "fitted", "fitted_noise", "match_generated"]

SIZE = (416, 256)
RIGHT_PX = 1.0
EVERY = 3
"""Neighbours say the same: so many pixels on each axis give one case."""
ROUNDS = 30
RIDGE = 1e-3
ONE_SIGMA = 0.6827
"""Share of normal errors within one standard deviation."""
LEAST_CASES = 1000
"""A knot with fewer says nothing."""
LEAST_PX = 0.02
PASSES = 3
UNKNOWN_PX = 2.0


@dataclass(frozen=True, eq=False)
class Cases:
    """What spoke for N disparities, and which were right.

    Attributes:
        evidence: (N, K), see `recon.confidence.evidence`.
        status: (N,), a `PixelStatus`.
        error_px: (N,), how far they are from the truth in pixels; NaN without a disparity.
    """

    evidence: Tensor
    status: Tensor
    error_px: Tensor

    @property
    def right(self) -> Tensor:
        """(N,) bool: within 1 px of the truth."""
        return self.error_px <= RIGHT_PX


def match_generated(matcher: Matcher, seeds: range) -> Cases:
    """Match generated pairs as two cameras would take them.

    Args:
        matcher: as it is used; its confidence bears on the refinements after it.
        seeds: of the pairs.
    """
    parts = [_match_one(matcher, seed) for seed in seeds]
    return Cases(
        torch.cat([part.evidence for part in parts]),
        torch.cat([part.status for part in parts]),
        torch.cat([part.error_px for part in parts]),
    )


@lru_cache(maxsize=128)
def _taken(seed: int) -> tuple[RectifiedPair, Tensor]:
    """Return the pair of one seed as two cameras would take it, and its disparities (H, W) px."""
    drawn = draw_pair(seed, SIZE)
    as_drawn = [
        torch.from_numpy(drawn[name]).permute(2, 0, 1)[None] / 255 for name in ("left", "right")
    ]
    taken = Augmentation()(as_drawn[0], as_drawn[1], torch.Generator().manual_seed(seed))
    left, right = ((255 * view[0].permute(1, 2, 0)).round().byte().numpy() for view in taken)
    middle = (SIZE[0] / 2, SIZE[1] / 2)
    pair = RectifiedPair(left, right, RectifiedGeometry(SIZE, SIZE[0], middle, middle, 0.1))
    return pair, torch.from_numpy(drawn["disparity"])


@torch.inference_mode()
def _match_one(matcher: Matcher, seed: int) -> Cases:
    """Match the pair of one seed."""
    pair, truth = _taken(seed)
    searched = range(max(0, int(truth.min()) - 2), int(truth.max()) + 3)
    stages: dict[str, object] = {}
    found = matcher(pair, searched, observe=stages.__setitem__)
    checked = stages.get("filling", stages["small_segments"])
    of_left, of_right = stages["disparity/left"], stages["disparity/right"]
    guide = torch.from_numpy(pair.left).float() / 255
    spoken = evidence(checked, of_left, of_right, guide)  # type: ignore[arg-type]
    error_px = (torch.from_numpy(found.values) - truth).abs()
    some = slice(None, None, EVERY), slice(None, None, EVERY)
    return Cases(
        spoken[some].flatten(0, 1),
        torch.from_numpy(found.status)[some].flatten(),
        error_px[some].flatten(),
    )


def fitted(cases: Cases) -> Confidence:
    """Return the weights that make what happened most likely, state by state."""
    weights = {}
    for entry in fields(Confidence):
        mine = cases.status == int(PixelStatus[entry.name.upper()])
        found = _regression(cases.evidence[mine].double(), cases.right[mine].double())
        weights[entry.name] = tuple(round(float(weight), 4) for weight in found)
    return Confidence(**weights)


def _regression(spoken: Tensor, right: Tensor) -> Tensor:
    """Fit a logistic regression by Newton's method, with a little ridge."""
    weights = spoken.new_zeros(spoken.shape[1])
    ridge = RIDGE * max(1, len(spoken)) * torch.eye(len(weights), dtype=spoken.dtype)
    for _ in range(ROUNDS):
        chance = torch.sigmoid(spoken @ weights)
        slope = spoken.T @ (right - chance) - ridge @ weights
        bend = (spoken * (chance * (1 - chance))[:, None]).T @ spoken + ridge
        weights = weights + torch.linalg.solve(bend, slope)
    return weights


def fitted_noise(cases: Cases, said: Tensor) -> DisparityNoise:
    """Return the standard deviations within which 68.27 % of the errors are, by confidence.

    At each knot it is the quantile of the errors, weighed by how near their confidence is: one at
    the knot, none from the next knots on. Where errors of a higher confidence are larger, both
    knots take what they are together. Where next to nothing was said the neighbour speaks.

    Args:
        cases: disparities and their errors.
        said: (N,) their confidence.
    """

    def row(state: PixelStatus) -> tuple[float, ...]:
        mine = cases.status == int(state)
        return _sigmas(cases.error_px[mine].double().numpy(), log_odds(said[mine].numpy()))

    return DisparityNoise(
        row(PixelStatus.MATCHED),
        row(PixelStatus.FILLED_OCCLUSION),
        row(PixelStatus.FILLED_MISMATCH),
    )


def _sigmas(error_px: Array, odds: Array) -> tuple[float, ...]:
    """Return what 68.27 % of the errors do not exceed at each knot.

    A quantile over a range of confidences is not that of the middle where errors fall steeply, so
    what is left of the errors, as multiples of what was found, is looked at again.
    """
    knots = log_odds(np.array(KNOTS))
    levels = np.zeros(len(knots))
    for _ in range(PASSES):
        left = np.maximum(error_px, LEAST_PX) / np.exp(np.interp(odds, knots, levels))
        levels = levels + np.log(_quantiles(left, np.interp(odds, knots, np.arange(len(knots)))))
    counts = _nearness(np.interp(odds, knots, np.arange(len(knots)))).sum(axis=1)
    known = counts >= LEAST_CASES
    if not known.any():
        return (UNKNOWN_PX,) * len(KNOTS)
    levels = np.interp(knots, knots[known], _falling(levels[known], counts[known]))
    return tuple(round(math.exp(level), 3) for level in levels)


def _nearness(between: Array) -> Array:
    """Return how near N places, in steps from knot to knot, are to each of the K knots, (K, N)."""
    nearness: Array = np.clip(1 - np.abs(np.arange(len(KNOTS))[:, None] - between), 0, None)
    return nearness


def _quantiles(values: Array, between: Array) -> Array:
    """Return what 68.27 % of N values do not exceed at each knot, 1 where too few are near."""
    order = np.argsort(values)
    masses = _nearness(between[order]).cumsum(axis=1)  # (K, N)
    return np.array(
        [
            values[order[np.searchsorted(mass, ONE_SIGMA * mass[-1])]]
            if len(mass) and mass[-1] >= LEAST_CASES
            else 1.0
            for mass in masses
        ]
    )


def _falling(values: Array, weights: Array) -> Array:
    """Return the nearest values that do not rise: what rises is averaged with what came before.

    Source: pool adjacent violators, Ayer et al., Ann. Math. Statist. 26(4) 1955.
    """
    pools: list[tuple[float, float, int]] = []
    for value, weight in zip(values, weights, strict=True):
        pool = (float(value), float(weight), 1)
        while pools and pools[-1][0] < pool[0]:
            mean, mass, count = pools.pop()
            whole = mass + pool[1]
            pool = ((mean * mass + pool[0] * pool[1]) / whole, whole, count + pool[2])
        pools.append(pool)
    return np.concatenate([[mean] * count for mean, _, count in pools])
