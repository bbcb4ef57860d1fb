"""Fit the probabilities of a preset on generated scenes that no network was trained on."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import torch
from torch import Tensor

from calib.pair import RectifiedPair
from calib.rig import RectifiedGeometry
from recon.confidence import Confidence, evidence
from recon.matcher import Matcher
from recon.training.augmentation import Augmentation
from recon.training.pool import draw_pair
from recon.types import PixelStatus

__all__ = ["Cases", "fitted", "match_generated"]

SIZE = (416, 256)
RIGHT_PX = 1.0
EVERY = 3
"""Neighbours say the same: so many pixels on each axis give one case."""
ROUNDS = 30
RIDGE = 1e-3


@dataclass(frozen=True, eq=False)
class Cases:
    """What spoke for N disparities, and which were right.

    Attributes:
        evidence: (N, K), see `recon.confidence.evidence`.
        status: (N,), a `PixelStatus`.
        right: (N,) bool, within 1 px of the truth.
    """

    evidence: Tensor
    status: Tensor
    right: Tensor


def match_generated(matcher: Matcher, seeds: range) -> Cases:
    """Match generated pairs as two cameras would take them.

    Args:
        matcher: without probabilities of its own.
        seeds: of the pairs.
    """
    matcher = replace(matcher, confidence=None)
    parts = [_match_one(matcher, seed) for seed in seeds]
    return Cases(
        torch.cat([part.evidence for part in parts]),
        torch.cat([part.status for part in parts]),
        torch.cat([part.right for part in parts]),
    )


@torch.inference_mode()
def _match_one(matcher: Matcher, seed: int) -> Cases:
    """Match the pair of one seed."""
    drawn = draw_pair(seed, SIZE)
    as_drawn = [
        torch.from_numpy(drawn[name]).permute(2, 0, 1)[None] / 255 for name in ("left", "right")
    ]
    taken = Augmentation()(as_drawn[0], as_drawn[1], torch.Generator().manual_seed(seed))
    left, right = ((255 * view[0].permute(1, 2, 0)).round().byte().numpy() for view in taken)
    middle = (SIZE[0] / 2, SIZE[1] / 2)
    pair = RectifiedPair(left, right, RectifiedGeometry(SIZE, SIZE[0], middle, middle, 0.1))

    truth = torch.from_numpy(drawn["disparity"])
    searched = range(max(0, int(truth.min()) - 2), int(truth.max()) + 3)
    stages: dict[str, object] = {}
    found = matcher(pair, searched, observe=stages.__setitem__)
    checked = stages.get("filling", stages["small_segments"])
    of_left, of_right = stages["disparity/left"], stages["disparity/right"]
    guide = torch.from_numpy(left).float() / 255
    spoken = evidence(checked, of_left, of_right, guide)  # type: ignore[arg-type]
    close = (torch.from_numpy(found.values) - truth).abs() <= RIGHT_PX
    some = slice(None, None, EVERY), slice(None, None, EVERY)
    return Cases(
        spoken[some].flatten(0, 1),
        torch.from_numpy(found.status)[some].flatten(),
        close[some].flatten(),
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
