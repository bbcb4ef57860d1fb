"""Steps to the neighbours, none of which counts for much more than the others."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from recon.kernels.shifts import cosine_distances
from recon.matching_cost.protocol import ALL_ROWS
from recon.networks import LEAST_LENGTH, STEP_REACH_PX, saturated_steps
from recon.types import CostVolume

__all__ = ["SoftCensus"]


@dataclass(frozen=True)
class SoftCensus:
    """C(x, d) = 1 - <s_L(x), s_R(x - d)>, in [0, 2], with s the steps of grey to 24 neighbours.

    A step t counts as t / (|t| + faint_step), and the 24 have length 1 together: a census
    transform in which a step near zero, whose sign is noise, says little. It is what the weights
    of `cnn` begin with. Steps to nearer neighbours can count more, by a Gaussian.

    Source: the idea of more than two levels from Stein, Efficient Computation of Optical Flow Using
    the Census Transform, DAGM 2004.

    Attributes:
        faint_step: difference of grey in [0, 1] that counts half; a few times the noise.
        sigma_px: of the Gaussian; smaller is sharper and noisier; all count alike if not given.
    """

    faint_step: float = 0.004
    sigma_px: float | None = None

    def __post_init__(self) -> None:
        if not self.faint_step > 0:
            raise ValueError(f"faint_step must be positive, got {self.faint_step}")
        if self.sigma_px is not None and not self.sigma_px > 0:
            raise ValueError(f"sigma_px must be positive, got {self.sigma_px}")

    @property
    def margin_px(self) -> int:
        """Half the window."""
        return STEP_REACH_PX

    def __call__(
        self, left: Tensor, right: Tensor, disparities: range, *, rows: slice = ALL_ROWS
    ) -> CostVolume:
        """Compare the steps of pixels."""
        of_left, of_right = (
            self.vectors(image, rows=rows).permute(2, 0, 1) for image in (left, right)
        )
        return CostVolume(cosine_distances(of_left, of_right, disparities), disparities)

    def vectors(self, image: Tensor, *, rows: slice = ALL_ROWS) -> Tensor:
        """Describe pixels; see `VectorCost`."""
        steps = saturated_steps(image.permute(2, 0, 1)[None], self.faint_step)[0, :, rows]
        if self.sigma_px is not None:
            steps = steps * torch.exp(-_squared_distances(steps) / (2 * self.sigma_px**2))
        return F.normalize(steps, dim=0, eps=LEAST_LENGTH).permute(1, 2, 0)


def _squared_distances(steps: Tensor) -> Tensor:
    """Return how far the neighbours of steps (24, H, W) are, squared pixels, (24, 1, 1)."""
    along = torch.arange(-STEP_REACH_PX, STEP_REACH_PX + 1, device=steps.device).square()
    of_window = (along[:, None] + along).flatten()
    return of_window[of_window > 0][:, None, None]
