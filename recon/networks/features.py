"""The siamese feature extractor: one vector a pixel, near for pixels that show the same point."""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import replace

import torch
import torch.nn.functional as F
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from recon.networks.architecture import STEP_REACH_PX, STEPS, Architecture

__all__ = ["LEAST_LENGTH", "Architecture", "FeatureNetwork", "saturated_steps"]

LEAST_LENGTH = 1e-3
"""Steps that together are shorter are those of a flat image."""


def _convolution(incoming: int, outgoing: int, *, spacing: int, normalised: bool) -> nn.Sequential:
    """Return a 3 x 3 convolution with ReLU, normalised over the batch while it trains."""
    layers: list[nn.Module] = [nn.Conv2d(incoming, outgoing, 3, padding=spacing, dilation=spacing)]
    if normalised:
        layers.append(nn.BatchNorm2d(outgoing))
    return nn.Sequential(*layers, nn.ReLU(inplace=True))


def saturated_steps(image: Tensor, faint: float) -> Tensor:
    """Return s / (|s| + e) of the steps s from every pixel to its neighbours, (N, 24, H, W).

    Steps of the mean of the channels, to the other pixels of a 5 x 5 window, e `faint`. As in
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
    steps = steps.contiguous(memory_format=torch.channels_last)  # as all that follows
    return steps / (steps.abs() + faint)


class _Branch(nn.Module):
    """Convolutions at one size of the image."""

    def __init__(
        self, incoming: int, channels: int, spacings: tuple[int, ...], *, normalised: bool
    ) -> None:
        super().__init__()
        widths = [incoming] + [channels] * (len(spacings) - 1)
        self.layers = nn.Sequential(
            *(
                _convolution(before, channels, spacing=spacing, normalised=normalised)
                for before, spacing in zip(widths, spacings, strict=True)
            )
        )

    def forward(self, image: Tensor) -> Tensor:
        output: Tensor = self.layers(image)
        return output


class FeatureNetwork(nn.Module):
    """Convolutions and ReLU at full size, and pooled branches that see further.

    Each pooled branch starts from the last one, halved by an overlapping mean; all branches are
    mixed, brought back to full size and added; a last convolution gives the vectors. The
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
            _Branch(before, after, spacings, normalised=normalised)
            for before, after, spacings in zip(
                (STEPS, *channels[:-1]), channels, architecture.spacings, strict=True
            )
        )
        self.mix = nn.Conv2d(sum(channels), features, 1)
        self.last = nn.Conv2d(features, architecture.learned, 3, padding=1)

    @property
    def stride_px(self) -> int:
        """See `Architecture.stride_px`."""
        return self.architecture.stride_px

    @property
    def margin_px(self) -> int:
        """See `Architecture.margin_px`."""
        return self.architecture.margin_px

    def forward(self, image: Tensor) -> Tensor:
        """Return the features of images.

        Args:
            image: (N, 3, H, W) in [0, 1].

        Returns:
            (N, C, H, W), each pixel's vector, of length 1; in a flat image the steps have no
            share, and it is shorter.
        """
        height, width = image.shape[-2:]
        stride = self.stride_px
        steps = saturated_steps(image, self.architecture.faint_step)
        current = F.pad(steps, (0, -width % stride, 0, -height % stride), mode="replicate")
        full = current.shape[-2:]
        shares = torch.split(self.mix.weight, list(self.architecture.channels), dim=1)
        for level, (branch, share) in enumerate(zip(self.branches, shares, strict=True)):
            if level:
                current = F.avg_pool2d(F.pad(current, (1, 1, 1, 1), mode="replicate"), 4, stride=2)
            current = branch(current)
            if not level:
                joined = F.conv2d(current, share, self.mix.bias)
            else:  # mixing commutes with enlarging, and is cheaper before it
                mixed = F.conv2d(current, share)
                joined = joined + F.interpolate(mixed, full, mode="bilinear")
        vectors: Tensor = self.last(F.relu(joined))[..., :height, :width].to(image.dtype)
        shape = self.architecture
        if not shape.direct:
            return F.normalize(vectors, dim=1)
        if not shape.direct_share:
            return F.normalize(torch.cat((steps, vectors), 1), dim=1)
        direct = math.sqrt(shape.direct_share) * F.normalize(steps, dim=1, eps=LEAST_LENGTH)
        rest = math.sqrt(1 - shape.direct_share) * F.normalize(vectors, dim=1)
        return torch.cat((direct, rest), 1)

    def fused(self) -> FeatureNetwork:
        """Return the same function with batch normalisation folded into the convolutions."""
        result = FeatureNetwork(self.architecture).to(self.mix.weight.device)
        result.mix.load_state_dict(self.mix.state_dict())
        result.last.load_state_dict(self.last.state_dict())
        for plain, branch in zip(result.branches, self.branches, strict=True):
            plain.load_state_dict(_folded(branch).state_dict())
        return result.eval()

    def begin_from(self, narrower: FeatureNetwork) -> None:
        """Become the same function as a network with the first of these branches alone.

        The branches that it has not are mixed in with weights of 0, from which training moves
        them (function-preserving growth: Chen, Goodfellow & Shlens, Net2Net, ICLR 2016). Only the
        last pixels of an image that the pooling grid does not fit differ.

        Args:
            narrower: without batch normalisation, see `fused`.

        Raises:
            ValueError: if its branches are not the first of these.
        """
        ours, theirs = self.architecture, narrower.architecture
        count = len(theirs.channels)
        grown = replace(theirs, channels=ours.channels)
        if ours.channels[:count] != theirs.channels or grown != ours:
            raise ValueError(f"{ours} cannot begin from the weights of {theirs}")
        for level, branch in enumerate(narrower.branches):
            self.branches[level] = deepcopy(branch)
        with torch.no_grad():
            weights = F.pad(narrower.mix.weight, (0, 0, 0, 0, 0, sum(ours.channels[count:])))
        self.mix.load_state_dict({**narrower.mix.state_dict(), "weight": weights})
        self.last.load_state_dict(narrower.last.state_dict())


def _folded(branch: nn.Module) -> nn.Module:
    """Return a branch whose convolutions have taken their batch normalisation in, if any."""
    result = deepcopy(branch).eval()
    for name, layer in list(result.named_modules()):
        match list(layer.children()):
            case [nn.Conv2d() as convolution, nn.BatchNorm2d() as norm, nn.ReLU() as relu]:
                with torch.no_grad():
                    folded = fuse_conv_bn_eval(convolution, norm)
                result.set_submodule(name, nn.Sequential(folded, relu))
    return result
