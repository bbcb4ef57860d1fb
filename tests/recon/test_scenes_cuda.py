"""Pairs drawn and changed on a CUDA device are those of the CPU."""

import pytest
import torch
from rendered import still_life_sample

from recon.training.augmentation import Augmentation, Pairs
from recon.training.recipe import HARD, SCENES, Recipe
from recon.training.scenery import compose
from recon.training.scenes import draw, render

pytestmark = [
    pytest.mark.gpu,
    pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device"),
]


def moved(value, device):
    """Return a scene, or a part of one, with its tensors on a device."""
    if isinstance(value, torch.Tensor):
        return value.to(device)
    if hasattr(value, "__dataclass_fields__"):
        parts = {name: moved(getattr(value, name), device) for name in value.__dataclass_fields__}
        return type(value)(**parts)
    return value


@pytest.mark.parametrize("kind", SCENES + HARD)
def test_a_scene_looks_the_same_on_the_device(kind):
    generator = torch.Generator().manual_seed(1)
    scene, view = compose(generator, (96, 64), Recipe(scenes=(kind,)))

    on_cpu, on_device = render(scene, view), render(moved(scene, "cuda"), view)

    assert on_device.left.device.type == "cuda"
    apart = (on_cpu.disparity_left - on_device.disparity_left.cpu()).abs()
    assert (apart > 0.01).float().mean() < 0.005  # outlines may fall on either side
    assert ((on_cpu.left - on_device.left.cpu()).abs() > 0.02).float().mean() < 0.02
    assert (on_cpu.visible != on_device.visible.cpu()).float().mean() < 0.005


@pytest.mark.parametrize("kind", SCENES + HARD)
def test_a_scene_is_composed_and_drawn_on_the_device_of_its_generator(kind):
    pairs = [
        draw(torch.Generator("cuda").manual_seed(3), (64, 40), recipe=Recipe(scenes=(kind,)))
        for _ in range(2)
    ]

    assert pairs[0].left.device.type == pairs[0].visible_right.device.type == "cuda"
    assert torch.equal(pairs[0].disparity_left, pairs[1].disparity_left)
    assert pairs[0].disparity_left.isfinite().all()


@pytest.mark.parametrize("of", ["cpu", "cuda"])
def test_augmentation_runs_where_its_input_is_whatever_the_generator(of):
    sample = still_life_sample(1)
    views = (view.permute(2, 0, 1)[None] for view in (sample.left, sample.right))
    pairs = Pairs(*views, sample.disparity_left[None], sample.visible[None])
    on_device = Pairs(*(part.to("cuda") for part in pairs))

    one, same = (
        Augmentation(covered=1.0).whole(on_device, torch.Generator(of).manual_seed(2))
        for _ in range(2)
    )

    assert all(part.device.type == "cuda" for part in one)
    assert all(torch.equal(a, b) for a, b in zip(one, same, strict=True))
