"""How evenly fractions of disparity spread on slanted planes, where the truth has no favourites."""

import numpy as np
import pytest
import torch
from rendered import coat

from calib import RectifiedGeometry
from calib.pair import RectifiedPair
from recon.matcher import Matcher
from recon.settings import load_preset
from recon.training.composition import Thing, View, assemble, rotation_about
from recon.training.scenes import render
from recon.training.textures import noise_table
from recon.types import Array

VIEW = View(width=240, height=120, focal_px=260.0, baseline_m=0.2)
TURNS = ((0.6, 0.0), (-0.5, 0.3), (0.2, -0.6))
"""Walls by which `shared_slope` was chosen."""
OTHER_TURNS = ((-0.6, 0.2), (0.45, -0.4), (-0.25, 0.65))
"""Walls by which nothing was chosen."""
BORDER = 12


def slanted_wall(turn: float, tilt: float) -> tuple[RectifiedPair, Array]:
    """A wall turned about both axes, with its true disparity, NaN near the borders."""
    axes = torch.eye(3)
    rotation = rotation_about(axes[1], turn) @ rotation_about(axes[0], tilt)
    wall = Thing("rectangle", (0, 0, 2.6), (20, 20, 1), rotation, coat(16, (0.0, 0.0)))
    table = noise_table(torch.Generator().manual_seed(3))
    light = torch.tensor([0.0, 0.0, -1.0])
    sample = render(assemble([wall], table, light, shadows=False), VIEW, samples=3)
    views = ((255 * image).round().byte().numpy() for image in (sample.left, sample.right))
    geometry = RectifiedGeometry(
        (VIEW.width, VIEW.height), VIEW.focal_px, VIEW.centre, VIEW.centre, VIEW.baseline_m
    )
    truth = np.where(sample.visible, sample.disparity_left, np.nan)
    inner = np.full_like(truth, np.nan)
    within = slice(BORDER, -BORDER), slice(BORDER, -BORDER)
    inner[within] = truth[within]
    return RectifiedPair(*views, geometry), inner


@pytest.fixture(scope="module")
def walls():
    return [slanted_wall(*angles) for angles in TURNS]


def errors_and_fractions(walls, matcher: Matcher) -> tuple[Array, Array]:
    """Match all walls; errors in px, and the distances from the nearest integer below."""
    errors, fractions = [], []
    for pair, truth in walls:
        known = np.isfinite(truth)
        first, last = int(np.nanmin(truth)) - 2, int(np.nanmax(truth)) + 3
        found = matcher(pair, range(max(0, first), last)).values[known]
        errors.append(found - truth[known])
        fractions.append(found % 1)
    return np.concatenate(errors), np.concatenate(fractions)


def unevenness(fractions: Array) -> float:
    """Return by how much the fullest or the emptiest tenth is off a tenth, as a share of it."""
    shares = np.histogram(fractions, 10, (0, 1))[0] / len(fractions)
    return float(np.abs(10 * shares - 1).max())


PRESETS = ("best", "sgm", "fast")


@pytest.mark.parametrize("preset", PRESETS)
def test_disparities_of_slanted_walls_do_not_crowd_at_integers(preset, walls):
    errors, fractions = errors_and_fractions(walls, load_preset(preset).matcher)

    assert unevenness(fractions) < 0.1
    assert np.abs(errors).mean() < 0.04


@pytest.mark.parametrize("preset", PRESETS)
def test_nor_do_those_of_walls_by_which_nothing_was_chosen(preset):
    others = [slanted_wall(*angles) for angles in OTHER_TURNS]

    errors, fractions = errors_and_fractions(others, load_preset(preset).matcher)

    assert unevenness(fractions) < 0.1
    assert np.abs(errors).mean() < 0.04


def unrefined(**optimisation: float) -> Matcher:
    changes = {"refinements": [], "enlargement": False, "optimisation": optimisation}
    return load_preset("sgm", changes).matcher


def test_a_parabola_draws_path_sums_towards_integers(walls):
    paths = {"directions": 8, "large_step": 2.25}

    of_parabola, crowded = errors_and_fractions(walls, unrefined(**paths, shared_slope=-1.0))
    errors, fractions = errors_and_fractions(walls, unrefined(**paths, shared_slope=0.0))

    assert unevenness(crowded) > 3 * unevenness(fractions)
    assert np.abs(errors).mean() < 0.8 * np.abs(of_parabola).mean()
