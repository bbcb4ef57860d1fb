"""What tests of training share: quick pairs, a small network, and how to kill a training."""

import pytest
import torch

from recon.networks import Architecture
from recon.training.progress import Scores
from recon.training.scenes import StereoSample
from recon.training.train import train

CPU = torch.device("cpu")
SIZE = (96, 64)
PAIRS, KEPT = 5, 2
SMALL = Architecture(channels=(8, 8), depth=1, features=8)
FAR_PX, NEAR_PX = 2, 6


def draw_bands(generator, size, *, samples=2, recipe=None):
    """Return noise, the upper half `FAR_PX`, the lower half `NEAR_PX` apart; as `scenes.draw`."""
    width, height = size
    device = generator.device
    noise = torch.rand(height, width + NEAR_PX, 3, generator=generator, device=device)
    disparity = torch.full((height, width), float(FAR_PX), device=device)
    disparity[height // 2 :] = NEAR_PX
    far, near = (noise[:, shift : shift + width] for shift in (FAR_PX, NEAR_PX))
    visible = torch.arange(width, device=device) >= disparity
    return StereoSample(
        left=noise[:, :width],
        right=torch.where((disparity == FAR_PX)[..., None], far, near),
        disparity_left=disparity,
        disparity_right=disparity,
        visible=visible,
        visible_right=visible.flip(1),
        normals=torch.zeros(height, width, 3, device=device),
        edges=torch.zeros(height, width, dtype=torch.bool, device=device),
    )


def weights_of(network):
    return torch.cat([value.flatten().double() for value in network.state_dict().values()])


class Killed(Exception):  # noqa: N818  not an error
    pass


def killed_at(step):
    def observe(stage, result):
        if isinstance(result, Scores) and result.step == step:
            raise Killed

    return observe


def left_off_at(settings, step):
    """Train to a step and be killed there."""
    with pytest.raises(Killed):
        train(settings, observe=killed_at(step))
