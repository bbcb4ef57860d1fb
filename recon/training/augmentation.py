"""What two real cameras do differently to one scene."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

__all__ = ["Augmentation"]


def _uniform(generator: torch.Generator, count: int, low: float, high: float) -> Tensor:
    return low + (high - low) * torch.rand(count, 1, 1, 1, generator=generator)


@dataclass(frozen=True)
class Augmentation:
    """Photometric and small geometric changes, drawn anew for each image of a pair.

    Attributes:
        shared: strength of changes that both views share (exposure, gamma, tint).
        apart: strength of changes that one view has alone.
        darkest: how far the exposure of both views may fall, as a logarithm.
        most_noise: largest standard deviation of the noise, in [0, 1] units.
        most_rows_px: largest vertical error of rectification, pixels.
        most_blur_px: largest standard deviation of the blur, pixels.
    """

    shared: float = 0.5
    apart: float = 0.18
    darkest: float = 1.0
    most_noise: float = 0.02
    most_rows_px: float = 0.5
    most_blur_px: float = 0.9

    def __call__(
        self, left: Tensor, right: Tensor, generator: torch.Generator
    ) -> tuple[Tensor, Tensor]:
        """Return the changed pair.

        Args:
            left: (N, 3, H, W) in [0, 1].
            right: (N, 3, H, W), the same.
            generator: source of randomness.
        """
        shared = self._tone(len(left), self.shared, generator)
        shared[:, :3] -= self.darkest * _uniform(generator, len(left), 0, 1) ** 2
        views = []
        for view, moves in ((left, False), (right, True)):
            apart = self._tone(len(left), self.apart, generator)
            changed = self._moved(view, generator) if moves else view
            changed = self._blurred(changed, generator)
            changed = _toned(_toned(changed, shared), apart)
            strength = self.most_noise * _uniform(generator, len(view), 0, 1) ** 2
            noise = torch.randn(changed.shape, generator=generator) * strength
            views.append((changed + noise).clamp(0, 1))
        return views[0], views[1]

    def _tone(self, count: int, strength: float, generator: torch.Generator) -> Tensor:
        """Draw logarithms of gain for each channel and of gamma, (N, 4, 1, 1)."""
        gain = _uniform(generator, count, -strength, strength)
        tint = (torch.rand(count, 3, 1, 1, generator=generator) - 0.5) * strength
        gamma = _uniform(generator, count, -strength, strength)
        return torch.cat((gain + tint, gamma), 1)

    def _blurred(self, view: Tensor, generator: torch.Generator) -> Tensor:
        """Blur each image by its own small Gaussian of 5 taps."""
        sigma = _uniform(generator, len(view), 0.2, self.most_blur_px)[:, 0, 0]
        taps = torch.exp(-(torch.arange(-2, 3.0) ** 2) / (2 * sigma**2))
        taps = (taps / taps.sum(1, keepdim=True)).repeat_interleave(3, 0)  # (3 N, 5)
        flat = F.pad(view.reshape(1, -1, *view.shape[2:]), (2, 2, 2, 2), mode="replicate")
        flat = F.conv2d(flat, taps[:, None, :, None], groups=len(taps))
        return F.conv2d(flat, taps[:, None, None, :], groups=len(taps)).reshape(view.shape)

    def _moved(self, view: Tensor, generator: torch.Generator) -> Tensor:
        """Shift the rows of each image a little, and more to one side than to the other."""
        count, _, height, width = view.shape
        shift = _uniform(generator, count, -self.most_rows_px, self.most_rows_px)[:, 0]
        turn = _uniform(generator, count, -self.most_rows_px, self.most_rows_px)[:, 0]
        across = torch.linspace(-1, 1, width).expand(count, height, width)
        down = torch.linspace(-1, 1, height)[:, None].expand(count, height, width)
        moved = down + (shift + turn * across) * 2 / max(1, height - 1)
        grid = torch.stack((across, moved), -1)
        return F.grid_sample(view, grid, padding_mode="border", align_corners=True)


def _toned(view: Tensor, tone: Tensor) -> Tensor:
    """Apply gains and gamma, given as logarithms (N, 4, 1, 1)."""
    gain, gamma = torch.exp(tone[:, :3]), torch.exp(tone[:, 3:])
    return (gain * view).clamp(1e-4, 1) ** gamma
