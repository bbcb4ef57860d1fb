"""How far to trust a disparity."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from itertools import product

import torch
import torch.nn.functional as F
from torch import Tensor

from recon.kernels.colour import luminance
from recon.kernels.minimum import Minimum
from recon.types import DisparityMap, PixelStatus

__all__ = ["EVIDENCE", "Confidence", "evidence", "peak_margin"]

SMALLEST_COST = 1e-6
"""Costs below this are equal to zero but for rounding."""

EVIDENCE = (
    "always",
    "margin",
    "partner",
    "difference",
    "agreement",
    "matched",
    "texture",
    "certainty",
    "plain_margin",
    "plain_partner",
)
"""What speaks for a disparity or against it, see `evidence`."""

LARGEST_DIFFERENCE_PX = 3.0
AGREEING_PX = 1.0
SPACING_PX = 3
AROUND = tuple(
    (SPACING_PX * y, SPACING_PX * x) for y, x in product(range(-2, 3), repeat=2) if (y, x) != (0, 0)
)
"""24 places up to 6 px away."""
FAINT = 1 / 255
LEAST_MARGIN = 1e-3


def peak_margin(minimum: Minimum) -> Tensor:
    """Return how clearly the winner beats its rival: (c_2 - c_1) / c_2.

    c_1 is the lowest cost and c_2 the lowest at least two candidates away. It is 1 - 1 / PKR, with
    PKR the peak ratio c_2 / c_1; unlike that it stays within [0, 1].

    Source: Hu & Mordohai, A Quantitative Evaluation of Confidence Measures for Stereo Vision,
    PAMI 34(11) 2012, section 3.3.

    Args:
        minimum: the winners, of costs that are not negative, and their rivals.

    Returns:
        (H, W) float32 in [0, 1]; 0 without a rival, and without a winner.
    """
    margin = (minimum.rival - minimum.value) / minimum.rival.clamp(min=SMALLEST_COST)
    return torch.where(minimum.rival.isfinite(), margin, 0.0).clamp(0.0, 1.0)


def evidence(
    disparity: DisparityMap[Tensor],
    of_left: DisparityMap[Tensor],
    of_right: DisparityMap[Tensor],
    guide: Tensor,
) -> Tensor:
    """Return what speaks for each disparity.

    Cost curve, consistency, neighbourhood and texture are the kinds of evidence that Park & Yoon,
    Learning and Selecting Confidence Measures for Robust Stereo Matching, PAMI 41(6) 2019, section
    3, find to complete each other.

    Args:
        disparity: (H, W), checked and perhaps filled.
        of_left: (H, W), before the check, with the peak margins.
        of_right: (H, W), the same of the right view, indexed by its pixels.
        guide: (H, W, 3) in [0, 1].

    Returns:
        (H, W, 10) float32, in the order of `EVIDENCE`: 1; log of the peak margin, or of the
        probability that the optimisation stated; log of that of the partner in the right view; how
        far the partner's disparity differs, at most 3 px, 3 without one; share of 24 pixels around
        that are within 1 px of this disparity; share of these that are matched; log of how much
        luminance varies around; minus the log of what the margin lacks to 1, for
        probabilities near 1 differ in that alone; and margin and partner without the logarithm,
        for what they say falls faster than that where they are small.
    """
    values = torch.nan_to_num(disparity.values)
    columns = torch.arange(values.shape[1], device=values.device) - values
    partner = columns.round().long()
    inside = (partner >= 0) & (partner < values.shape[1])
    partner = partner.clamp(0, values.shape[1] - 1)
    theirs = of_right.values.gather(1, partner)
    theirs = torch.where(inside, theirs, torch.nan)
    difference = (values - theirs).abs().nan_to_num(LARGEST_DIFFERENCE_PX)
    margin_there = torch.where(inside, of_right.confidence.gather(1, partner), 0.0)

    matched = disparity.status == int(PixelStatus.MATCHED)
    known = torch.where(disparity.valid, disparity.values, torch.inf)
    agreement, measured = torch.zeros_like(values), torch.zeros_like(values)
    reach = 2 * SPACING_PX
    around = F.pad(known[None, None], (reach,) * 4, mode="replicate")[0, 0]
    matched_around = F.pad(matched[None, None].float(), (reach,) * 4, mode="replicate")[0, 0]
    height, width = values.shape
    for y, x in AROUND:
        window = slice(reach + y, reach + y + height), slice(reach + x, reach + x + width)
        agreement += (around[window] - values).abs() <= AGREEING_PX
        measured += matched_around[window]

    light = luminance(guide)[None, None]
    mean, square = (
        F.avg_pool2d(F.pad(each, (2,) * 4, mode="replicate"), 5, stride=1)[0, 0]
        for each in (light, light.square())
    )
    texture = (square - mean.square()).clamp(min=0).sqrt()
    return torch.stack(
        (
            torch.ones_like(values),
            (of_left.confidence + LEAST_MARGIN).log(),
            (margin_there + LEAST_MARGIN).log(),
            difference.clamp(max=LARGEST_DIFFERENCE_PX),
            agreement / len(AROUND),
            measured / len(AROUND),
            (texture + FAINT).log(),
            -(1 - of_left.confidence + LEAST_MARGIN).log(),
            of_left.confidence,
            margin_there,
        ),
        -1,
    )


Weights = tuple[float, ...]


@dataclass(frozen=True)
class Confidence:
    """The probability that a disparity is within 1 px of the truth: 1 / (1 + exp(-w . evidence)).

    A logistic regression for each way in which a pixel came by its disparity. Weights belong to
    the stages before; `benchmarks/confidence.py` fits them on generated scenes.

    Attributes:
        matched: weights of what was measured, in the order of `EVIDENCE`.
        filled_occlusion: of what was filled as background.
        filled_mismatch: of what was filled between neighbours.
    """

    matched: Weights
    filled_occlusion: Weights
    filled_mismatch: Weights

    def __post_init__(self) -> None:
        for entry in fields(self):
            weights = getattr(self, entry.name)
            if len(weights) != len(EVIDENCE) or not all(map(math.isfinite, weights)):
                raise ValueError(
                    f"{entry.name} must be {len(EVIDENCE)} finite weights "
                    f"({', '.join(EVIDENCE)}), got {weights}"
                )

    def __call__(
        self,
        disparity: DisparityMap[Tensor],
        of_left: DisparityMap[Tensor],
        of_right: DisparityMap[Tensor],
        *,
        guide: Tensor,
    ) -> DisparityMap[Tensor]:
        """Return the same disparities with their probabilities; see `evidence`."""
        found = evidence(disparity, of_left, of_right, guide)
        confidence = self.probability(found, disparity.status)
        return DisparityMap(disparity.values, disparity.status, confidence)

    def probability(self, found: Tensor, status: Tensor) -> Tensor:
        """Return how likely disparities are right.

        Args:
            found: (..., K), see `evidence`.
            status: (...), a `PixelStatus`.

        Returns:
            (...) in [0, 1]; 0 where there is no disparity.
        """
        result = torch.zeros(status.shape, device=status.device)
        for state, weights in (
            (PixelStatus.MATCHED, self.matched),
            (PixelStatus.FILLED_OCCLUSION, self.filled_occlusion),
            (PixelStatus.FILLED_MISMATCH, self.filled_mismatch),
        ):
            probability = torch.sigmoid(found @ found.new_tensor(weights))
            result = torch.where(status == int(state), probability, result)
        return result
