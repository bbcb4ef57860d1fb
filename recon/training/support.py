"""What the pixels around say of a candidate, as the matcher will ask them, with a gradient."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import lru_cache

import torch
import torch.nn.functional as F
from torch import Tensor

__all__ = ["Support"]

SPACE = 0.8
"""Standard deviation of nearness, as a share of the radius."""
COLOUR = 0.04
"""Standard deviation of likeness, Euclidean distance of RGB in [0, 1]."""


@dataclass(frozen=True)
class Support:
    """Bilateral means of costs, weighted by the left view.

    The matcher aggregates costs before it chooses; a network that is to serve it must be good
    after that, not before. With w as in `BilateralAggregation`, the mean is D^-1 W c, where W
    holds w(p, q) and D = diag(W 1); W is symmetric, so the gradient of c is W D^-1 g.

    Source: Yoon & Kweon, PAMI 28(4) 2006, section 3.

    Attributes:
        radius_px: neighbours up to this far in x and in y.
    """

    radius_px: int

    def __call__(self, volumes: Tensor, guides: Tensor) -> Tensor:
        """Return the means.

        Args:
            volumes: (N, H, W, D) float32, all finite.
            guides: (N, 3, H, W) in [0, 1], without gradient.

        Returns:
            (N, H, W, D).
        """
        pairs = zip(volumes, guides, strict=True)
        return torch.stack([_mean(volume, self._weights(guide)) for volume, guide in pairs])

    def _weights(self, guide: Tensor) -> Tensor:
        """Return W as a sparse matrix (H W, H W) for a guide (3, H, W)."""
        radius, count = self.radius_px, guide[0].numel()
        neighbour, distance = _window(*guide.shape[1:], radius, guide.device)
        padded = F.pad(guide[None], (radius,) * 4, mode="replicate")
        around = F.unfold(padded, 2 * radius + 1).reshape(len(guide), -1, count)
        unlike = (around - guide.reshape(len(guide), 1, count)).square().sum(0)
        weights = torch.exp(-distance / (2 * (SPACE * radius) ** 2) - unlike.T / (2 * COLOUR**2))
        start = torch.arange(count + 1, device=guide.device) * distance.shape[1]
        return _sparse(start, neighbour.flatten(), weights.flatten(), count)


@lru_cache(maxsize=4)
def _window(height: int, width: int, radius: int, device: torch.device) -> tuple[Tensor, Tensor]:
    """Return the neighbours of all pixels, (H W, K) each.

    Returns:
        Which pixels they are, and the squares of their distances; infinite for those outside,
        which stand at the border.
    """
    offsets = torch.arange(-radius, radius + 1, device=device)
    rows = torch.arange(height, device=device)[:, None, None, None] + offsets[:, None]
    columns = torch.arange(width, device=device)[:, None, None] + offsets
    inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    place = rows.clamp(0, height - 1) * width + columns.clamp(0, width - 1)
    distance = offsets[:, None].square() + offsets.square()
    distance = torch.where(inside, distance, float("inf"))
    return place.reshape(height * width, -1), distance.reshape(height * width, -1)


def _sparse(start: Tensor, columns: Tensor, values: Tensor, count: int) -> Tensor:
    """Return a sparse square matrix, without torch's word that such matrices are new."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Sparse")
        return torch.sparse_csr_tensor(start, columns, values, (count, count))


class _Mean(torch.autograd.Function):
    """D^-1 W c and its gradient."""

    @staticmethod
    def forward(ctx, values, weights):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN205
        total = weights @ torch.ones_like(values[:, :1])
        ctx.save_for_backward(weights, total)
        return weights @ values / total

    @staticmethod
    def backward(ctx, gradient):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN205
        weights, total = ctx.saved_tensors
        return weights @ (gradient / total), None


def _mean(volume: Tensor, weights: Tensor) -> Tensor:
    """Return the means of (H, W, D)."""
    mean: Tensor = _Mean.apply(volume.flatten(0, 1), weights)  # type: ignore[no-untyped-call]
    return mean.reshape(volume.shape)
