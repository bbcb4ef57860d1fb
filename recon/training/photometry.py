"""What lenses, sensors and files do to a picture. Pictures are (N, 3, H, W) in [0, 1]."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor

__all__ = ["blurred", "compressed", "saturated", "sensed", "toned", "uneven", "vignetted"]

BLUR_TAPS = 4  # on either side
BLOCK = 8
MIDDLE = 128  # of 8 bits; what coefficients are taken about
LUMINANCE_STEPS = (
    (16, 11, 10, 16, 24, 40, 51, 61),
    (12, 12, 14, 19, 26, 58, 60, 55),
    (14, 13, 16, 24, 40, 57, 69, 56),
    (14, 17, 22, 29, 51, 87, 80, 62),
    (18, 22, 37, 56, 68, 109, 103, 77),
    (24, 35, 55, 64, 81, 104, 113, 92),
    (49, 64, 78, 87, 103, 121, 120, 101),
    (72, 92, 95, 98, 112, 100, 103, 99),
)
CHROMINANCE_STEPS = (
    (17, 18, 24, 47),
    (18, 21, 26, 66),
    (24, 26, 56, 99),
    (47, 66, 99, 99),
)
"""The upper left of the table; the rest is 99."""
YCC_FROM_RGB = (
    (0.299, 0.587, 0.114),
    (-0.168736, -0.331264, 0.5),
    (0.5, -0.418688, -0.081312),
)


def toned(view: Tensor, tone: Tensor) -> Tensor:
    """Apply gains and gamma, given as logarithms (N, 4, 1, 1)."""
    gain, gamma = torch.exp(tone[:, :3]), torch.exp(tone[:, 3:])
    return (gain * view).clamp(1e-4, 1) ** gamma


def saturated(view: Tensor, factor: Tensor) -> Tensor:
    """Move colours away from grey by `factor` (N, 1, 1, 1); 0 leaves only grey."""
    return torch.lerp(view.mean(1, keepdim=True), view, factor).clamp(0, 1)


def vignetted(view: Tensor, loss: Tensor) -> Tensor:
    """Darken towards the corners, which lose the share `loss` (N, 1, 1, 1)."""
    height, width = view.shape[2:]
    down = torch.linspace(-1, 1, height, device=view.device)[:, None]
    across = torch.linspace(-1, 1, width, device=view.device)
    return view * (1 - loss * (down**2 + across**2) / 2)


def uneven(view: Tensor, coarse: Tensor) -> Tensor:
    """Multiply by a smooth field, given as coarse logarithms (N, 1, h, w)."""
    field = F.interpolate(coarse, view.shape[2:], mode="bicubic", align_corners=True)
    return (view * torch.exp(field)).clamp(0, 1)


def blurred(view: Tensor, sigma: Tensor) -> Tensor:
    """Blur each picture by a Gaussian of its own standard deviation (N, 1, 1, 1), pixels."""
    place = torch.arange(-BLUR_TAPS, BLUR_TAPS + 1.0, device=view.device)
    taps = torch.exp(-(place**2) / (2 * sigma[:, 0, 0] ** 2))
    taps = (taps / taps.sum(1, keepdim=True)).repeat_interleave(3, 0)  # (3 N, taps)
    flat = F.pad(view.reshape(1, -1, *view.shape[2:]), [BLUR_TAPS] * 4, mode="replicate")
    flat = F.conv2d(flat, taps[:, None, :, None], groups=len(taps))
    return F.conv2d(flat, taps[:, None, None, :], groups=len(taps)).reshape(view.shape)


def sensed(view: Tensor, noise: Tensor, strength: Tensor) -> Tensor:
    """Add noise whose variance grows with the brightness, as that of counted photons does.

    Args:
        view: the pictures.
        noise: (N, 3, H, W) of standard deviation 1.
        strength: (N, 1, 1, 1), standard deviation at white.
    """
    return (view + strength * (0.15 + 0.85 * view).sqrt() * noise).clamp(0, 1)


def _cosines(device: torch.device) -> Tensor:
    """Return the orthonormal DCT-II as a matrix (8, 8)."""
    order = torch.arange(BLOCK, device=device, dtype=torch.float32)
    waves = torch.cos(math.pi / BLOCK * order[:, None] * (order + 0.5))
    waves[0] *= math.sqrt(0.5)
    return waves * math.sqrt(2 / BLOCK)


def _steps(quality: Tensor) -> Tensor:
    """Return the steps (N, 3, 8, 8) that coefficients are rounded to, for qualities (N,)."""
    tables = torch.full((3, BLOCK, BLOCK), 99.0, device=quality.device)
    tables[0] = torch.tensor(LUMINANCE_STEPS, device=quality.device)
    tables[1:, :4, :4] = torch.tensor(CHROMINANCE_STEPS, device=quality.device)
    percent = torch.where(quality < 50, 5000 / quality, 200 - 2 * quality)[:, None, None, None]
    return (tables * percent / 100).round().clamp(1, 255)


def compressed(view: Tensor, quality: Tensor) -> Tensor:
    """Round the 8 x 8 cosine coefficients of luminance and colour, as JPEG files do.

    Source: ITU-T T.81, 1992, annexes A and K (transform and tables); the scale of qualities is
    that of libjpeg. The colours are kept at full resolution.

    Args:
        view: the pictures.
        quality: (N,) in (0, 100].
    """
    height, width = view.shape[2:]
    to_ycc = torch.tensor(YCC_FROM_RGB, device=view.device)
    ycc = torch.einsum("kc,nchw->nkhw", to_ycc, 255 * view - MIDDLE)
    padded = F.pad(ycc, (0, -width % BLOCK, 0, -height % BLOCK), mode="replicate")
    blocks = padded.unfold(2, BLOCK, BLOCK).unfold(3, BLOCK, BLOCK)  # (N, 3, rows, columns, 8, 8)
    waves, steps = _cosines(view.device), _steps(quality)[:, :, None, None]
    rounded = (waves @ blocks @ waves.T / steps).round() * steps
    blocks = waves.T @ rounded @ waves
    joined = blocks.transpose(3, 4).reshape(padded.shape)[..., :height, :width]
    back = torch.linalg.inv(to_ycc)
    return ((torch.einsum("kc,nchw->nkhw", back, joined) + MIDDLE) / 255).clamp(0, 1)
