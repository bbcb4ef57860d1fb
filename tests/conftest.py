"""Tolerances and small scenes that all tests share."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

TOLERANCES = {
    torch.float32: {"rtol": 1e-5, "atol": 1e-5},
    torch.float64: {"rtol": 1e-10, "atol": 1e-10},
    np.dtype(np.float32): {"rtol": 1e-5, "atol": 1e-5},
    np.dtype(np.float64): {"rtol": 1e-10, "atol": 1e-10},
}


@pytest.fixture
def assert_close() -> Callable[..., None]:
    """Compare two arrays or tensors; equal NaN and infinities are equal."""

    def compare(actual, expected, **tolerance) -> None:
        if isinstance(actual, Tensor) and not isinstance(expected, Tensor):
            expected = torch.as_tensor(expected, dtype=actual.dtype)
        limits = {**TOLERANCES[actual.dtype], **tolerance}
        if isinstance(actual, Tensor):
            torch.testing.assert_close(actual, expected, equal_nan=True, **limits)
        else:
            np.testing.assert_allclose(actual, expected, equal_nan=True, **limits)

    return compare


@pytest.fixture
def generator() -> torch.Generator:
    """Seeded, so that a failure can be repeated."""
    return torch.Generator().manual_seed(20240229)


@pytest.fixture
def texture(generator) -> Callable[[int, int], Tensor]:
    """Return a maker of random images (H, W, 3) in [0, 1]: no two patches are alike."""
    return lambda height, width: torch.rand((height, width, 3), generator=generator)


@pytest.fixture
def smooth_texture(generator) -> Callable[[int, int], Tensor]:
    """Return a maker of random images (H, W, 3) in [0, 1] that change over about 6 px."""

    def make(height: int, width: int) -> Tensor:
        coarse = torch.rand((1, 3, height // 4 + 2, width // 4 + 2), generator=generator)
        image = torch.nn.functional.interpolate(coarse, (height, width), mode="bicubic")
        return image[0].permute(1, 2, 0).clamp(0, 1).contiguous()

    return make


@pytest.fixture
def datasets() -> Path:
    """Return the folder of real photographs; the test is skipped where there is none."""
    folder = os.environ.get("RECON_DATASETS")
    if not folder:
        pytest.skip("RECON_DATASETS names no folder of data sets")
    return Path(folder)
