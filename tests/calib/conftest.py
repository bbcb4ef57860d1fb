"""Rigs and folders that the tests of calib share."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from lenses import LENSES, rotation

from calib import Camera, Pose, StereoCalibration


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


@pytest.fixture
def make_camera() -> Callable[..., Camera]:
    def make(lens: str = "five", size: tuple[int, int] = (160, 120), **changes: float) -> Camera:
        model, coefficients = LENSES[lens]
        width, height = size
        fx, fy = changes.get("fx", 0.7 * width), changes.get("fy", 0.72 * width)
        cx, cy = changes.get("cx", 0.49 * width), changes.get("cy", 0.52 * height)
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        return Camera(size, K, np.array(coefficients), model)

    return make


@pytest.fixture
def make_rig(make_camera: Callable[..., Camera]) -> Callable[..., StereoCalibration]:
    def make(lens: str = "five", size: tuple[int, int] = (160, 120)) -> StereoCalibration:
        left = make_camera(lens, size)
        right = make_camera(lens, size, fx=0.71 * size[0], cx=0.52 * size[0], cy=0.5 * size[1])
        pose = Pose(rotation(0.02, -0.03, 0.015), np.array([-0.12, 0.004, -0.006]))
        return StereoCalibration(left, right, pose)

    return make
