"""A network that chooses disparities with the context that single pixels lack."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor, nn
from torch.nn.modules.batchnorm import _BatchNorm
from torch.nn.utils.fusion import fuse_conv_bn_eval

__all__ = ["BLOCK", "Estimate", "Regulariser", "RegulariserShape"]

BLOCK = 4
"""Pixels and candidates that share a cell of the volume in which the network looks around."""
HALVINGS = 3
EXACT_FROM = 2
SPATIAL_MULTIPLE = BLOCK << HALVINGS
CANDIDATE_MULTIPLE = BLOCK << (HALVINGS - 1)
NEIGHBOURS = 9
HYPOTHESES = NEIGHBOURS + 1
"""For a pixel: the blocks around it, and the winner of the paths."""
PEAK_RADIUS = 3
OFFSETS = (-3.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 3.0)
MISSING = 3.0
"""Cost of a candidate that does not exist, above all that do."""
STEEPEST_PX = 3.0
LARGEST_CORRECTION_PX = 2.0
FIRST_SHARPNESS, FIRST_PATH_SHARPNESS = 12.0, 4.0
CELLS_AT_ONCE = 1 << 21
"""Costs of which the blocks are seen together: few enough for a cache and for memory in use."""
MEAN_LIGHT, LIGHT_SPREAD = 0.45, 0.25
"""Of every image: those of the image itself would differ from strip to strip."""


@dataclass(frozen=True)
class RegulariserShape:
    """The shape of a regulariser.

    Attributes:
        cells: channels of the volume at a quarter, an eighth, a 16th and a 32nd of the size.
        context: channels of what is seen of the guide at full, half, quarter, ... 32nd size.
        fine: channels of the correction at full size.
    """

    cells: tuple[int, ...] = (16, 32, 48, 64)
    context: tuple[int, ...] = (16, 24, 32, 48, 64, 64)
    fine: int = 32

    def __post_init__(self) -> None:
        if len(self.cells) != HALVINGS + 1 or len(self.context) != HALVINGS + 3:
            raise ValueError(
                f"a regulariser has {HALVINGS + 1} sizes of cells and {HALVINGS + 3} of context, "
                f"got {self.cells} and {self.context}"
            )
        if min(*self.cells, *self.context, self.fine) < 1:
            raise ValueError(f"cells, context and fine must be positive: {self}")


class Estimate(NamedTuple):
    """What the network makes of N volumes."""

    disparity: Tensor
    """(N, H, W), in candidates from the first."""
    log_scale: Tensor
    """(N, H, W), logarithm of the mean absolute error to expect, the scale of a Laplace law."""
    occlusion: Tensor
    """(N, H, W), logit of the chance that the other view does not see the pixel."""
    enlarged: Tensor
    """(N, H, W), the disparity before the correction at full size."""
    logits: Tensor
    """(N, H / 4, W / 4, D), of the candidates of blocks of 4 x 4 pixels, padded."""


def _layer2(incoming: int, outgoing: int, stride: int = 1, spacing: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(
            incoming, outgoing, 3, stride=stride, padding=spacing, dilation=spacing, bias=False
        ),
        nn.BatchNorm2d(outgoing),
        nn.ReLU(inplace=True),
    )


def _layer3(incoming: int, outgoing: int, stride: int | tuple[int, int, int] = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv3d(incoming, outgoing, 3, stride=stride, padding=1, bias=False),
        nn.BatchNorm3d(outgoing),
        nn.ReLU(inplace=True),
    )


class _Context(nn.Module):
    """What is seen of the guide, at every size."""

    def __init__(self, channels: tuple[int, ...]) -> None:
        super().__init__()
        self.first = _layer2(3, channels[0])
        self.levels = nn.ModuleList(
            nn.Sequential(_layer2(before, after, stride=2), _layer2(after, after))
            for before, after in pairwise(channels)
        )

    def forward(self, guide: Tensor) -> list[Tensor]:
        seen = [self.first((guide - MEAN_LIGHT) / LIGHT_SPREAD)]
        for level in self.levels:
            seen.append(level(seen[-1]))
        return seen


class _Gate(nn.Module):
    """Let the guide say which channels of the volume matter at a pixel.

    Source: Bangunharcana et al., Correlate-and-Excite: Real-Time Stereo Matching via Guided Cost
    Volume Excitation, IROS 2021.
    """

    def __init__(self, context: int, cells: int) -> None:
        super().__init__()
        self.weights = nn.Conv2d(context, cells, 1)

    def forward(self, volume: Tensor, seen: Tensor) -> Tensor:
        gated: Tensor = volume * torch.sigmoid(self.weights(seen))[..., None]
        return gated


def _at(level: int, layer: nn.Module, volume: Tensor) -> Tensor:
    """Return what a layer makes of a volume, in float32 at coarse levels.

    oneDNN's gradients of convolutions over small volumes in bfloat16 hold memory that nobody
    wrote.
    """
    if level < EXACT_FROM:
        result: Tensor = layer(volume)
        return result
    with torch.autocast(volume.device.type, enabled=False):
        exact: Tensor = layer(volume.float())
        return exact


class _Hourglass(nn.Module):
    """Convolutions over rows, columns and candidates, ever coarser and back."""

    def __init__(self, shape: RegulariserShape) -> None:
        super().__init__()
        cells, context = shape.cells, shape.context[2:]
        steps = ((2, 2, 2),) * (HALVINGS - 1) + ((2, 2, 1),)
        self.steps = steps
        self.first = _layer3(cells[0], cells[0])
        self.down = nn.ModuleList(
            nn.Sequential(_layer3(before, after, stride=step), _layer3(after, after))
            for before, after, step in zip(cells[:-1], cells[1:], steps, strict=True)
        )
        self.gates = nn.ModuleList(
            _Gate(seen, channels) for seen, channels in zip(context, cells, strict=True)
        )
        self.narrow = nn.ModuleList(
            nn.Conv3d(after, before, 1) for before, after in pairwise(cells)
        )
        self.up = nn.ModuleList(_layer3(channels, channels) for channels in cells[:-1])
        self.last = nn.Conv3d(cells[0], BLOCK, 3, padding=1)

    def forward(self, volume: Tensor, context: list[Tensor]) -> Tensor:
        current = self.gates[0](self.first(volume), context[0])
        kept = [current]
        levels = zip(self.down, self.gates[1:], context[1:], strict=True)
        for level, (down, gate, seen) in enumerate(levels, 1):
            current = gate(_at(level, down, current), seen)
            kept.append(current)
        for level in reversed(range(HALVINGS)):
            narrow = self.narrow[level](current)
            for axis, step in zip((2, 3, 4), self.steps[level], strict=True):
                if step == 2:
                    narrow = narrow.repeat_interleave(2, axis)
            current = _at(level, self.up[level], kept[level] + narrow)
        logits: Tensor = self.last(current)
        return logits


class Regulariser(nn.Module):
    """From the costs of all candidates of one view to its disparity.

    It never sees colours of two views, but how alike their pixels are: the same thing in every
    photograph. Costs of blocks of 4 x 4 pixels and 4 candidates are weighed together; an
    hourglass looks around among the blocks; for each pixel the guide and its own costs choose
    among the blocks around it; and a last correction looks at its costs near the result.
    """

    def __init__(self, shape: RegulariserShape = RegulariserShape()) -> None:
        super().__init__()
        self.shape = shape
        self.sharpness = nn.Parameter(torch.tensor(FIRST_SHARPNESS).log())
        self.path_sharpness = nn.Parameter(torch.tensor(FIRST_PATH_SHARPNESS).log())
        self.likeness = nn.Linear(BLOCK**3, shape.cells[0])
        self.chance = nn.Linear(BLOCK**3, shape.cells[0], bias=False)
        self.path_chance = nn.Linear(BLOCK**3, shape.cells[0], bias=False)
        self.context = _Context(shape.context)
        self.hourglass = _Hourglass(shape)
        self.block_weights = nn.Conv2d(
            shape.context[2] + NEIGHBOURS, NEIGHBOURS * BLOCK**2, 3, padding=1
        )
        self.pixel_weights = nn.Sequential(
            _layer2(shape.context[0] + 2 * HYPOTHESES + 1, shape.fine),
            nn.Conv2d(shape.fine, HYPOTHESES, 1),
        )
        fine = shape.fine
        self.correction = nn.Sequential(
            _layer2(shape.context[0] + len(OFFSETS) + 2 + 4, fine),
            _layer2(fine, fine, spacing=2),
            _layer2(fine, fine, spacing=4),
            nn.Conv2d(fine, 3, 3, padding=1),
        )
        for start in self.correction[-1].parameters():  # at first nothing is corrected
            nn.init.zeros_(start)

    def laid_out(self) -> Regulariser:
        """Return this network with its weights in the order in which it is fastest."""
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                module.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
            if isinstance(module, nn.Conv3d):
                module.to(memory_format=torch.channels_last_3d)  # type: ignore[call-overload]
        return self

    def fused(self) -> Regulariser:
        """Return the same function with batch normalisation folded into the convolutions."""
        result = deepcopy(self).eval()
        for layer in result.modules():
            if not isinstance(layer, nn.Sequential):
                continue
            match [*layer.children()]:
                case [nn.Conv2d() | nn.Conv3d() as convolution, _BatchNorm() as norm, nn.ReLU()]:
                    layer[0] = fuse_conv_bn_eval(convolution, norm)
                    layer[1] = nn.Identity()
        return result

    def forward(self, cost: Tensor, paths: Tensor, winner: Tensor, guide: Tensor) -> Estimate:
        """Estimate disparities.

        Args:
            cost: (N, H, W, D) float32 in [0, 2], +inf where there is no candidate.
            paths: (N, H, W, D), mean costs of semi-global paths to each cell, +inf likewise.
            winner: (N, H, W), where these are least, in candidates from the first.
            guide: (N, 3, H, W) in [0, 1], the view whose costs they are.
        """
        height, width = cost.shape[1:3]
        down, across = -height % SPATIAL_MULTIPLE, -width % SPATIAL_MULTIPLE
        winner = F.pad(winner, (0, across, 0, down))
        guide = F.pad(guide, (0, across, 0, down), mode="replicate")
        seen = self.context(guide)
        cells, surest = self._cells(cost, paths)
        logits = self.hourglass(cells, seen[2:]).float().permute(0, 2, 3, 4, 1).flatten(3)
        enlarged = self._enlarged(*_peak(logits), cost, surest, winner, seen)
        disparity, log_scale, occlusion = self._corrected(enlarged, cost, seen[0])
        kept = slice(None), slice(height), slice(width)
        return Estimate(disparity[kept], log_scale[kept], occlusion[kept], enlarged[kept], logits)

    def _cells(self, cost: Tensor, paths: Tensor) -> tuple[Tensor, Tensor]:
        """Return what is seen of the blocks of the volume, (N, C, h, w, D / 4), padded.

        Some rows at a time: what is between costs and blocks would take three more volumes.

        Returns:
            That, and the greatest chance that the paths give a candidate, (N, H, W), padded.
        """
        height, width, count = cost.shape[1:]
        rows = BLOCK * max(1, CELLS_AT_ONCE // (BLOCK * width * count))
        cells, surest = [], []
        for top in range(0, height, rows):
            strip = slice(None), slice(top, top + rows)
            down = -height % SPATIAL_MULTIPLE if top + rows >= height else 0
            beyond = (0, -count % CANDIDATE_MULTIPLE, 0, -width % SPATIAL_MULTIPLE, 0, down)
            near = F.pad(cost[strip], beyond, value=float("inf")).clamp_max(MISSING)
            path_chance = self._path_chance(F.pad(paths[strip], beyond, value=float("inf")))
            chance = torch.softmax(-self.sharpness.exp() * near, -1)
            seen_alike = (
                self.likeness(_blocks(_likeness(near)))
                + self.chance(_blocks(chance))
                + self.path_chance(_blocks(path_chance))
            )
            cells.append(F.relu(seen_alike))
            surest.append(path_chance.amax(-1))
        return torch.cat(cells, 1).permute(0, 4, 1, 2, 3), torch.cat(surest, 1)

    def _path_chance(self, paths: Tensor) -> Tensor:
        """Return a softmax over the candidates; those that do not exist share a little."""
        least = paths.amin(-1, keepdim=True)
        above = torch.where(paths.isfinite(), paths - least, MISSING)
        return torch.softmax(-self.path_sharpness.exp() * above, -1)

    def _enlarged(
        self,
        peak: Tensor,
        chance: Tensor,
        cost: Tensor,
        surest: Tensor,
        winner: Tensor,
        seen: list[Tensor],
    ) -> Tensor:
        """Let each pixel choose among the blocks around it and the winner of the paths."""
        size = winner.shape[1:]
        around = _neighbours(peak)  # (N, 9, h, w)
        relative = (around - peak[:, None]).clamp(-8, 8) / 8
        coarse = self.block_weights(torch.cat((seen[2], relative), 1))
        coarse = F.pixel_shuffle(coarse, BLOCK).float()  # (N, 9, H, W)
        blocks = F.interpolate(around, size, mode="nearest")
        hypotheses = torch.cat((blocks, winner[:, None]), 1)
        sampled = _sample(cost, hypotheses)
        sure = F.interpolate(_neighbours(chance), size, mode="nearest")
        apart = (winner - blocks[:, NEIGHBOURS // 2])[:, None].clamp(-8, 8) / 8
        fine = self.pixel_weights(
            torch.cat((seen[0], sampled, sure, surest[:, None], apart), 1)
        ).float()
        weights = F.pad(coarse, (0, 0, 0, 0, 0, 1)) + fine
        return (torch.softmax(weights, 1) * hypotheses).sum(1)

    def _corrected(
        self, enlarged: Tensor, cost: Tensor, seen: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        start = enlarged.detach()
        offsets = start.new_tensor(OFFSETS)[:, None, None]
        sampled = _sample(cost, start[:, None] + offsets)
        phase = 2 * torch.pi * start[:, None]
        padded = F.pad(start[:, None], (1, 1, 1, 1), mode="replicate")
        steps = (
            torch.cat(
                (
                    padded[..., 1:-1, 2:],
                    padded[..., 1:-1, :-2],
                    padded[..., 2:, 1:-1],
                    padded[..., :-2, 1:-1],
                ),
                1,
            )
            - start[:, None]
        )
        steps = steps.clamp(-STEEPEST_PX, STEEPEST_PX)
        looked = torch.cat((seen, sampled, phase.sin(), phase.cos(), steps), 1)
        raw = self.correction(looked).float()
        change = LARGEST_CORRECTION_PX * torch.tanh(raw[:, 0])
        return enlarged + change, raw[:, 1].clamp(-5, 5), raw[:, 2]


def _blocks(volume: Tensor) -> Tensor:
    """Return (N, h, w, D / 4, 64): what is in each block of 4 x 4 pixels and 4 candidates."""
    count, height, width, depth = volume.shape
    parts = volume.reshape(
        count, height // BLOCK, BLOCK, width // BLOCK, BLOCK, depth // BLOCK, BLOCK
    )
    return parts.permute(0, 1, 3, 5, 2, 4, 6).flatten(4)


def _peak(logits: Tensor) -> tuple[Tensor, Tensor]:
    """Return the mean candidate near the best, and how likely those near it are, (N, h, w)."""
    best = logits.argmax(-1, keepdim=True)
    near = best + torch.arange(-PEAK_RADIUS, PEAK_RADIUS + 1, device=logits.device)
    inside = (near >= 0) & (near < logits.shape[-1])
    values = logits.gather(-1, near.clamp(0, logits.shape[-1] - 1))
    values = values.masked_fill(~inside, float("-inf"))
    mean = (torch.softmax(values, -1) * near).sum(-1)
    chance = torch.exp(torch.logsumexp(values, -1) - torch.logsumexp(logits, -1))
    return mean, chance


def _neighbours(values: Tensor) -> Tensor:
    """Return (N, 9, h, w): the values of the 3 x 3 blocks around each."""
    padded = F.pad(values[:, None], (1, 1, 1, 1), mode="replicate")[:, 0]
    rows, columns = values.shape[1:]
    return torch.stack(
        [padded[:, y : y + rows, x : x + columns] for y in range(3) for x in range(3)], 1
    )


def _likeness(cost: Tensor) -> Tensor:
    """Return how alike pixels are, in [-1, 1]; 0 where there is no candidate."""
    return torch.where(cost < MISSING, 1 - cost, 0.0)


def _sample(cost: Tensor, candidates: Tensor) -> Tensor:
    """Read the likeness of (N, H, W, D) at fractional candidates, padded (N, K, H, W).

    It is 0 outside.
    """
    height, width, count = cost.shape[1:]
    down, across = candidates.shape[2] - height, candidates.shape[3] - width
    place = candidates.detach()[..., :height, :width].permute(0, 2, 3, 1)
    low = place.floor()
    parts = []
    for index in (low, low + 1):
        inside = (index >= 0) & (index < count)
        found = _likeness(cost.gather(-1, index.clamp(0, count - 1).long()))
        parts.append(torch.where(inside, found, 0.0))
    sampled = torch.lerp(parts[0], parts[1], place - low).permute(0, 3, 1, 2)
    return F.pad(sampled, (0, across, 0, down))
