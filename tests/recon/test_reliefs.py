"""Reliefs are met exactly, and without holes."""

import pytest
import torch

from recon.training.casting import Rays, first_hits
from recon.training.composition import rotation_about
from recon.training.profiles import CUTOUTS, RELIEFS
from recon.training.reliefs import height_and_slope, meet_relief
from recon.training.shapes import KINDS, Shapes
from recon.training.staging import Dice

EYE = torch.tensor([0.7, 0.2, 6.0], dtype=torch.float64)[:, None]
GRAZING_EYE = torch.tensor([-4.0, 0.3, 1.6], dtype=torch.float64)[:, None]
RAYS = 150
STEPS = 4000


@pytest.fixture(params=RELIEFS)
def heights(request, generator):
    return RELIEFS[request.param](Dice(generator)).double()


def aimed(eye, generator, reach=0.7):
    """Return directions (3, N) from `eye` to places of the middle plane of the relief."""
    target = torch.rand(2, RAYS, generator=generator, dtype=torch.float64) * 2 - 1
    return torch.cat((reach * target, torch.zeros(1, RAYS))) - eye


def at(heights, place):
    which = torch.zeros(place.shape[1], dtype=torch.int64)
    return height_and_slope(heights[None], which, place[0], place[1])


def marched(heights, eye, direction):
    """Walk in small steps: where a ray first crosses the surface, as the reference."""
    steps = torch.linspace(0, 1.6, STEPS, dtype=torch.float64)
    place = eye[:, :, None] + direction[:, :, None] * steps  # (3, N, steps)
    flat = place.clamp(-1, 1).flatten(1)
    gap = place[2] - at(heights, flat)[0].reshape(RAYS, -1)
    inside = (place[:2].abs() <= 1).all(0)
    crossing = (gap[:, 1:] * gap[:, :-1] <= 0) & inside[:, 1:] & inside[:, :-1]
    first = crossing.float().argmax(1)
    return torch.where(crossing.any(1), steps[first], torch.inf)


@pytest.mark.parametrize("eye", [EYE, GRAZING_EYE], ids=["from above", "grazing"])
def test_a_ray_meets_a_relief_where_small_steps_first_cross_it(heights, eye, generator):
    direction = aimed(eye, generator)

    found = meet_relief(eye, direction, heights)
    reference = marched(heights, eye, direction)

    agrees = ((found - reference).abs() < 2 / STEPS) | (found.isinf() & reference.isinf())
    assert reference.isfinite().sum() > 0.7 * RAYS
    assert agrees.float().mean() >= 0.98  # small steps may jump over a crest that is touched


def test_rays_that_come_from_above_find_no_hole_in_single_precision(heights, generator):
    direction = aimed(EYE, generator)

    found = meet_relief(EYE.float(), direction.float(), heights.float())
    exact = meet_relief(EYE, direction, heights)

    assert found.isfinite().all()
    # 0.02 px of disparity where it is 100 px is 2e-4 of the depth
    assert ((found - exact).abs() < 2e-5 * exact).float().mean() > 0.99


def cast_at(heights, places, tilt):
    """Place a relief 5 m ahead; return depths of rays aimed at its own places (3, N), and theirs.

    In single precision and in a turned frame, as scenes are drawn.
    """
    turn = rotation_about(torch.tensor([0.6, 0.8, 0.0]), tilt)
    centre, half = torch.tensor([0.3, -0.2, 5.0]), torch.tensor([1.7, 1.3, 0.2])
    relief = Shapes(
        torch.tensor([KINDS.index("relief")]),
        centre[None],
        turn[None],
        half[None],
        torch.tensor([0]),
        heights[None].float(),
    )
    place = centre[:, None] + turn @ (places.float() * half[:, None])
    rays = Rays(torch.zeros(3, 1, 1, 1), (place / place[2])[:, None, None])
    return first_hits(relief, rays).depth.flatten(), place[2]


@pytest.mark.parametrize("tilt", [0.0, 0.3, 1.0])
def test_where_cells_meet_there_is_no_hole(heights, tilt):
    """Aim at all nodes: at the corners of four patches."""
    along = torch.linspace(-0.8, 0.8, 65, dtype=torch.float64)  # every node of 81 but those aside
    nodes = torch.cartesian_prod(along, along).T

    depth, there = cast_at(heights, torch.cat((nodes, at(heights, nodes)[:1])), tilt)

    assert depth.isfinite().all()
    nearer = depth <= there * (1 + 1e-4)  # another part may be in the way
    assert nearer.float().mean() > 0.98  # a ray may pass a crest that it is aimed at


@pytest.mark.parametrize("tilt", [0.0, 1.0, 1.45])
def test_flat_ground_on_the_far_limit_of_its_map_is_met(tilt, generator, assert_close):
    place = 1.8 * torch.rand(2, 20_000, generator=generator) - 0.9

    depth, there = cast_at(torch.ones(81, 81), torch.cat((place, torch.ones(1, 20_000))), tilt)

    assert_close(depth, there, rtol=1e-4)


def test_a_ray_that_passes_beside_a_relief_meets_nothing():
    direction = torch.tensor([[3.0], [0.0], [-6.0]])

    assert meet_relief(EYE.float(), direction, torch.zeros(9, 9)).isinf().all()


def test_slopes_are_the_derivatives_of_the_heights(heights, generator, assert_close):
    place = torch.rand(2, 200, generator=generator, dtype=torch.float64) * 1.9 - 0.95
    step = 1e-7
    nudge_x, nudge_y = torch.tensor([[[step], [0.0]], [[0.0], [step]]])

    value, by_x, by_y = at(heights, place)

    for slope, nudge in ((by_x, nudge_x), (by_y, nudge_y)):
        expected = (at(heights, place + nudge)[0] - value) / step
        assert ((slope - expected).abs() < 1e-5).float().mean() > 0.99  # some are at a node


def test_a_map_is_read_with_x_along_its_rows(assert_close):
    heights = torch.arange(12.0).reshape(1, 3, 4)[:, :, :3]  # rows begin at 0, 4, 8
    x, y = torch.tensor([-1.0, 1.0, -1.0, 0.5]), torch.tensor([-1.0, -1.0, 1.0, 0.0])

    value = height_and_slope(heights, torch.zeros(4, dtype=torch.int64), x, y)[0]

    assert_close(value, torch.tensor([0.0, 2.0, 8.0, 5.5]))


@pytest.mark.parametrize("name", RELIEFS)
def test_reliefs_fill_their_range(name):
    for seed in range(5):
        heights = RELIEFS[name](Dice(torch.Generator().manual_seed(seed)))

        assert heights.min() == -1
        assert heights.max() == 1


@pytest.mark.parametrize("name", CUTOUTS)
def test_cutouts_have_both_holes_and_substance(name):
    for seed in range(10):
        there = (CUTOUTS[name](Dice(torch.Generator().manual_seed(seed))) > 0).float().mean()

        assert 0.05 < there < 0.97
