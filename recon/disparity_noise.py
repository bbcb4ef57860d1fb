"""How far a disparity may be off, from the probability that it is right."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from recon.types import Array, PixelStatus

__all__ = ["KNOTS", "DisparityNoise", "log_odds"]

KNOTS = (0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995)
"""Confidences at which a standard deviation is told."""

LEAST_DOUBT = 1e-6
Sigmas = tuple[float, ...]


def log_odds(confidence: Array) -> Array:
    """Return log(c / (1 - c)) in float64; finite for 0 and 1 too, where it is about -14 and 14."""
    c = np.clip(confidence.astype(np.float64), LEAST_DOUBT, 1 - LEAST_DOUBT)
    odds: Array = np.log(c / (1 - c))
    return odds


@dataclass(frozen=True)
class DisparityNoise:
    """The standard deviation of a disparity, in pixels, by its confidence.

    The confidence c is the probability that the disparity is within 1 px of the truth. sigma is
    what 68.27 % of the errors of disparities that are as likely to be right do not exceed: for
    normal errors the standard deviation, and for others still what a person expects of it. Errors
    of stereo are not normal: what is right is off by tenths of a pixel, and what is wrong by
    anything, so that sigma rises steeply where c falls below 0.7. Between the `KNOTS`, log sigma is
    interpolated over log(c / (1 - c)); beyond the outer ones it stays, so that it has a least and
    a most. There is a row for each way in which a pixel came by its disparity. The rows belong to
    the confidence of a preset and to the stages before it; `benchmarks/confidence.py` fits them
    on generated scenes.

    Attributes:
        matched: sigma in pixels at each of the knots, of what was measured.
        filled_occlusion: of what was filled as background.
        filled_mismatch: of what was filled between neighbours.

    Raises:
        ValueError: if a sigma is not positive, or rises with c.
    """

    matched: Sigmas
    filled_occlusion: Sigmas
    filled_mismatch: Sigmas

    def __post_init__(self) -> None:
        for name in ("matched", "filled_occlusion", "filled_mismatch"):
            sigmas = getattr(self, name)
            if len(sigmas) != len(KNOTS) or not all(0 < sigma < math.inf for sigma in sigmas):
                raise ValueError(
                    f"{name} must be {len(KNOTS)} positive numbers of pixels, for the confidences "
                    f"{', '.join(map(str, KNOTS))}; got {list(sigmas)}"
                )
            if any(after > before for before, after in pairwise(sigmas)):
                raise ValueError(
                    f"{name} must not rise: what is more likely right is not farther off; "
                    f"got {list(sigmas)}"
                )

    def __call__(self, confidence: Array, status: Array) -> Array:
        """Return the standard deviation of each disparity.

        Args:
            confidence: any shape, in [0, 1].
            status: the same shape, a `PixelStatus`.

        Returns:
            float32 pixels of the same shape; NaN where there is no disparity.
        """
        sigma: Array = np.full(confidence.shape, np.nan, np.float32)
        knots = log_odds(np.array(KNOTS))
        for state, sigmas in (
            (PixelStatus.MATCHED, self.matched),
            (PixelStatus.FILLED_OCCLUSION, self.filled_occlusion),
            (PixelStatus.FILLED_MISMATCH, self.filled_mismatch),
        ):
            mine = status == int(state)
            sigma[mine] = np.exp(np.interp(log_odds(confidence[mine]), knots, np.log(sigmas)))
        return sigma
