"""The siamese feature extractor: one vector a pixel, near for pixels that show the same point."""

from __future__ import annotations

import itertools
from copy import deepcopy
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

__all__ = ["Architecture", "FeatureNetwork"]


STEP_REACH_PX = 2
STEPS = (2 * STEP_REACH_PX + 1) ** 2 - 1
FAINT_STEP = 0.015  # a few times the noise of a sensor


@dataclass(frozen=True)
class Architecture:
    """The shape of a feature network.

    Attributes:
        channels: maps of each branch, full size first, each next one halved; one entry means no
            pooling.
        depth: convolutions of each branch.
        features: length of a pixel's vector.
    """

    channels: tuple[int, ...] = (64,)
    depth: int = 4
    features: int = 64


def _convolution(incoming: int, outgoing: int, *, normalised: bool) -> nn.Sequential:
    """Return a 3 x 3 convolution with ReLU, normalised over the batch while it trains."""
    layers: list[nn.Module] = [nn.Conv2d(incoming, outgoing, 3, padding=1)]
    if normalised:
        layers.append(nn.BatchNorm2d(outgoing))
    return nn.Sequential(*layers, nn.ReLU(inplace=True))


def _steps(image: Tensor) -> Tensor:
    """Return s / (|s| + e) of the steps s from every pixel to its neighbours, (N, 24, H, W).

    Steps of the mean of the channels, to the other pixels of a 5 x 5 window, e `FAINT_STEP`. As in
    the census transform a strong edge says no more than faint texture: else the edge of an object
    outweighs the texture of what lies behind it, and the object is fattened.
    """
    height, width = image.shape[-2:]
    reach = STEP_REACH_PX
    grey = image.mean(1, keepdim=True)
    around = F.pad(grey, (reach, reach, reach, reach), mode="replicate")
    offsets = [(y, x) for y in range(2 * reach + 1) for x in range(2 * reach + 1)]
    offsets.remove((reach, reach))
    steps = torch.cat([around[..., y : y + height, x : x + width] for y, x in offsets], 1) - grey
    return steps / (steps.abs() + FAINT_STEP)


class _Branch(nn.Module):
    """Convolutions at one size of the image."""

    def __init__(self, incoming: int, channels: int, depth: int, *, normalised: bool) -> None:
        super().__init__()
        widths = [incoming] + [channels] * depth
        self.layers = nn.Sequential(
            *(
                _convolution(before, after, normalised=normalised)
                for before, after in itertools.pairwise(widths)
            )
        )

    def forward(self, image: Tensor) -> Tensor:
        output: Tensor = self.layers(image)
        return output


class FeatureNetwork(nn.Module):
    """Convolutions and ReLU at full size, and pooled branches that see further.

    Each pooled branch starts from the last one, halved by an overlapping mean; all branches are
    brought back to full size, joined and mixed; a last convolution gives the vectors. The
    default is the fast architecture of Zbontar & LeCun, Stereo Matching by Training a CNN to
    Compare Image Patches, JMLR 2016, section 3.1, whose parameters the paper keeps (section 3):
    five convolutions of 3 x 3 with 64 maps, a field of 11 x 11 pixels.

    Args:
        architecture: its shape.
        normalised: whether batch normalisation is still separate; `fused` folds it.
    """

    def __init__(self, architecture: Architecture, *, normalised: bool = False) -> None:
        super().__init__()
        self.architecture = architecture
        channels, features = architecture.channels, architecture.features
        self.branches = nn.ModuleList(
            _Branch(before, after, architecture.depth, normalised=normalised)
            for before, after in zip((STEPS, *channels[:-1]), channels, strict=True)
        )
        self.mix = nn.Conv2d(sum(channels), features, 1)
        self.last = nn.Conv2d(features, features, 3, padding=1)

    @property
    def stride_px(self) -> int:
        """A crop sees the same pooling grid as the image if its first row is a multiple of this."""
        levels = len(self.architecture.channels)
        return 1 << (levels - 1)

    @property
    def margin_px(self) -> int:
        """Rows beyond a pixel that its vector depends on, at most; a multiple of `stride_px`."""
        reach = (
            STEP_REACH_PX
            + 1
            + sum(
                (self.architecture.depth + 2) << level
                for level, _ in enumerate(self.architecture.channels)
            )
        )
        return -(-reach // self.stride_px) * self.stride_px

    def forward(self, image: Tensor) -> Tensor:
        """Return the features of images.

        Args:
            image: (N, 3, H, W) in [0, 1].

        Returns:
            (N, C, H, W), each pixel's vector of length 1.
        """
        height, width = image.shape[-2:]
        stride = self.stride_px
        current = F.pad(_steps(image), (0, -width % stride, 0, -height % stride), mode="replicate")
        full = current.shape[-2:]
        outputs = []
        for level, branch in enumerate(self.branches):
            if level:
                current = F.avg_pool2d(F.pad(current, (1, 1, 1, 1), mode="replicate"), 4, stride=2)
            current = branch(current)
            outputs.append(current if not level else F.interpolate(current, full, mode="bilinear"))
        mixed = self.last(F.relu(self.mix(torch.cat(outputs, 1))))
        return F.normalize(mixed[..., :height, :width], dim=1)

    def fused(self) -> FeatureNetwork:
        """Return the same function with batch normalisation folded into the convolutions."""
        result = FeatureNetwork(self.architecture)
        result.mix.load_state_dict(self.mix.state_dict())
        result.last.load_state_dict(self.last.state_dict())
        ours = [module for module in result.branches.modules() if isinstance(module, nn.Conv2d)]
        theirs = [module for module in self.branches.modules() if isinstance(module, nn.Conv2d)]
        norms = [module for module in self.branches.modules() if isinstance(module, nn.BatchNorm2d)]
        for plain, convolution, norm in zip(ours, theirs, norms, strict=True):
            with torch.no_grad():
                folded = fuse_conv_bn_eval(deepcopy(convolution).eval(), deepcopy(norm).eval())
            plain.load_state_dict(folded.state_dict())
        return result.eval()
