"""Small displacements of pictures: rows that do not meet, colours that do not, and zoom."""

from __future__ import annotations

from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

__all__ = ["Pairs", "displaced", "zoomed"]


class Pairs(NamedTuple):
    """N pairs and their truth."""

    left: Tensor
    """(N, 3, H, W) in [0, 1]."""
    right: Tensor
    """(N, 3, H, W), the same."""
    disparity: Tensor
    """(N, H, W) px, of the left views."""
    visible: Tensor
    """(N, H, W) bool, left pixels that the right view shows."""


def displaced(view: Tensor, rows: Tensor, colours: Tensor) -> Tensor:
    """Move the content of pictures by fractions of a pixel.

    Args:
        view: (N, 3, H, W).
        rows: (N, 3): down by rows[0] + rows[1] x + rows[2] y pixels at (x, y) in [-1, 1]; the
            columns stay where they are, and so does the truth.
        colours: (N, 2): right and down for red, the opposite for blue, pixels.
    """
    count, _, height, width = view.shape
    x = torch.linspace(-1, 1, width, device=view.device)
    y = torch.linspace(-1, 1, height, device=view.device)[:, None]
    shift, turn, stretch = rows[:, :, None, None].unbind(1)  # (N, 1, 1) each
    down = shift + turn * x + stretch * y  # (N, H, W)
    sign = torch.tensor([1.0, 0.0, -1.0], device=view.device)
    apart = (sign[:, None] * colours[:, None])[..., None, None]  # (N, 3, 2, 1, 1)
    size = (count, 3, height, width)
    from_x = (x - apart[:, :, 0] * 2 / max(1, width - 1)).expand(size)
    from_y = (y - (down[:, None] + apart[:, :, 1]) * 2 / max(1, height - 1)).expand(size)
    grid = torch.stack((from_x, from_y), -1).flatten(0, 1)
    flat = view.reshape(-1, 1, height, width)
    moved = F.grid_sample(flat, grid, padding_mode="border", align_corners=True)
    return moved.reshape(view.shape)


def _sources(scale: Tensor, start: Tensor, length: int) -> Tensor:
    """Return where each of `length` pixels comes from, (N, length).

    Args:
        scale: (N,) at least 1.
        start: (N,) in [0, 1], which part is looked at, from the first to the last.
        length: of the axis.
    """
    place = torch.arange(length, device=scale.device, dtype=torch.float32)
    room = length * (1 - 1 / scale)
    return (start * room)[:, None] + (place + 0.5) / scale[:, None] - 0.5


def _between(values: Tensor, row: Tensor, column: Tensor) -> Tensor:
    """Read (N, H, W) at fractional rows (N, H) and columns (N, W), without mixing surfaces."""
    height, width = values.shape[1:]
    top, left = row.floor().clamp(0, height - 1), column.floor().clamp(0, width - 1)
    bottom, right = (top + 1).clamp_max(height - 1), (left + 1).clamp_max(width - 1)
    which = torch.arange(len(values), device=values.device)[:, None, None]
    corners = torch.stack(
        [
            values[which, r.long()[:, :, None], c.long()[:, None]]
            for r in (top, bottom)
            for c in (left, right)
        ]
    )
    down, across = (row - top).clamp(0, 1)[:, :, None], (column - left).clamp(0, 1)[:, None]
    smooth = torch.lerp(
        torch.lerp(corners[0], corners[1], across), torch.lerp(corners[2], corners[3], across), down
    )
    nearest = corners.gather(0, (2 * (down >= 0.5) + (across >= 0.5)).long()[None])[0]
    return torch.where(corners.amax(0) - corners.amin(0) < 1, smooth, nearest)


def zoomed(pairs: Pairs, scale: Tensor, start: Tensor) -> Pairs:
    """Enlarge the same part of both views to the full size; disparities grow with the width.

    Args:
        pairs: what to enlarge.
        scale: (N, 2) at least 1, of the width and of the height.
        start: (N, 2) in [0, 1], where the part lies across and down.
    """
    height, width = pairs.disparity.shape[1:]
    column = _sources(scale[:, 0], start[:, 0], width)
    row = _sources(scale[:, 1], start[:, 1], height)
    size = (len(scale), height, width)
    x = ((2 * column + 1) / width - 1)[:, None].expand(size)
    y = ((2 * row + 1) / height - 1)[:, :, None].expand(size)
    grid = torch.stack((x, y), -1)
    views = [
        F.grid_sample(view, grid, padding_mode="border", align_corners=False)
        for view in (pairs.left, pairs.right)
    ]
    disparity = _between(pairs.disparity, row, column) * scale[:, :1, None]
    seen = F.grid_sample(pairs.visible[:, None].float(), grid, mode="nearest", align_corners=False)
    inside = torch.arange(width, device=scale.device) - disparity >= 0
    return Pairs(views[0], views[1], disparity, (seen[:, 0] > 0.5) & inside)
