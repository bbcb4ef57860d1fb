"""The same results on a CUDA device as on the CPU."""

import numpy as np
import pytest
import torch

from calib import RectifiedGeometry, RectifiedPair
from recon import load_preset
from recon.types import PixelStatus

pytestmark = [
    pytest.mark.gpu,
    pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device"),
]


@pytest.fixture
def shifted_pair() -> RectifiedPair:
    """A random texture, seen 7 pixels apart."""
    scene = np.random.default_rng(3).integers(0, 256, (96, 167, 3), dtype=np.uint8)
    geometry = RectifiedGeometry((160, 96), 150.0, (80.0, 48.0), (80.0, 48.0), 0.1)
    return RectifiedPair(scene[:, :160].copy(), scene[:, 7:].copy(), geometry)


@pytest.mark.parametrize("preset", ["paper", "census", "best", "sgm", "context"])
def test_the_matcher_finds_the_shift_on_the_device(preset, shifted_pair):
    found = load_preset(preset).matcher(shifted_pair, range(16), device="cuda")

    matched = found.status == PixelStatus.MATCHED
    assert matched[:, 20:].mean() > 0.99
    assert (np.abs(found.values[matched] - 7) > 0.5).mean() < 0.01


@pytest.mark.parametrize("preset", ["paper", "census", "best", "sgm", "context"])
def test_the_device_changes_next_to_nothing(preset, shifted_pair):
    matcher = load_preset(preset).matcher

    on_cpu = matcher(shifted_pair, range(16)).values
    on_device = matcher(shifted_pair, range(16), device="cuda").values

    # ties in winner-takes-all may fall differently, so a few pixels may
    assert (np.abs(on_cpu - on_device) > 1e-2).mean() < 0.01
