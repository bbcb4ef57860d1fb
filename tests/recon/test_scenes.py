"""Generated pairs: their truth is exact."""

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from rendered import VIEW, still_life_sample

from recon.training import samples
from recon.training.composition import View, rotation_about
from recon.training.furnishing import KINDS_OF_SCENE
from recon.training.pool import draw_pair, fill_pool, read_pair
from recon.training.samples import STILL_LIFES
from recon.training.scenes import draw
from recon.training.shapes import KINDS, Shapes, first_hits


@pytest.fixture(scope="module")
def sample():
    return still_life_sample(3)


def sampled_at(values, column):
    """Read (H, W, C) values at fractional columns (H, W)."""
    height, width = column.shape
    row = torch.arange(height)[:, None].expand(height, width)
    grid = torch.stack((2 * column / (width - 1) - 1, 2 * row / (height - 1) - 1), -1)
    moved = values.permute(2, 0, 1)[None].float()
    return F.grid_sample(moved, grid[None].float(), align_corners=True)[0].permute(1, 2, 0)


def away_from_edges(disparity, reach=2):
    """Return (H, W) where no step of disparity is within `reach` pixels."""
    image = disparity[None, None]
    window = {"kernel_size": 2 * reach + 1, "stride": 1, "padding": reach}
    spread = F.max_pool2d(image, **window) + F.max_pool2d(-image, **window)
    return spread[0, 0] < 0.5


def partner_column(sample):
    return torch.arange(VIEW.width) - sample.disparity_left


def test_the_right_view_warped_by_the_truth_is_the_left_view(sample):
    warped = sampled_at(sample.right, partner_column(sample))

    judged = sample.visible & away_from_edges(sample.disparity_left)
    error = (warped - sample.left).abs().mean(-1)[judged]
    unaware = (sample.right - sample.left).abs().mean(-1)[judged]
    assert judged.float().mean() > 0.6
    assert error.mean() < 0.03  # drawn with 9 rays a pixel, read between pixels
    assert error.mean() < 0.25 * unaware.mean()


def test_both_disparity_maps_agree_where_both_cameras_see(sample):
    of_right = sampled_at(sample.disparity_right[..., None], partner_column(sample))[..., 0]

    judged = sample.visible & away_from_edges(sample.disparity_left)
    assert ((of_right - sample.disparity_left).abs()[judged] < 0.05).float().mean() > 0.99


def test_a_point_is_visible_exactly_if_nothing_nearer_lands_on_its_place(sample):
    """Compare with a brute-force search of each row: what lands at the same place, but nearer."""
    disparity, column = sample.disparity_left.numpy(), partner_column(sample).numpy()
    height, width = disparity.shape
    hidden = np.zeros((height, width), bool)
    for row in range(height):
        lands = np.abs(column[row][:, None] - column[row][None, :]) < 0.5
        nearer = disparity[row][None, :] > disparity[row][:, None] + 1
        hidden[row] = (lands & nearer).any(axis=1)

    inside = column >= 0
    visible = sample.visible.numpy()
    assert not visible[~inside].any()
    agreement = (visible == ~hidden)[inside]
    assert agreement.mean() > 0.98  # edges lie between pixels
    assert hidden[inside].sum() > 100


def test_what_is_beyond_the_left_border_of_the_right_view_is_not_visible(sample):
    assert not sample.visible[partner_column(sample) < 0].any()


def test_disparity_is_focal_length_times_baseline_over_depth():
    """A wall straight ahead, by hand."""
    wall = Shapes(
        torch.tensor([list(KINDS).index("rectangle")]),
        torch.tensor([[0.0, 0.0, 4.0]]),
        torch.eye(3)[None],
        torch.tensor([[9.0, 9.0, 1.0]]),
    )

    hits = first_hits(wall, torch.zeros(3), torch.tensor([[0.1, 0.2, 1.0], [0.0, 0.0, -1.0]]))

    assert hits.depth.tolist() == [4.0, float("inf")]


@pytest.mark.parametrize("kind", KINDS)
def test_rays_meet_a_shape_on_its_surface(kind, generator, assert_close):
    turn = rotation_about(torch.tensor([0.6, 0.0, 0.8]), 0.7)
    half, centre = torch.tensor([0.5, 0.7, 0.9]), torch.tensor([0.2, -0.1, 4.0])
    shape = Shapes(torch.tensor([list(KINDS).index(kind)]), centre[None], turn[None], half[None])
    across = torch.rand(500, 2, generator=generator) * 0.5 - 0.25
    rays = torch.cat((across, torch.ones(500, 1)), 1)

    depth = first_hits(shape, torch.zeros(3), rays).depth
    met = depth.isfinite()
    place = ((depth[met, None] * rays[met] - centre) @ turn) / half

    x, y, z = place.abs().unbind(1)
    flat = torch.stack((x, y), 1)
    on_surface = {
        "box": place.abs().amax(1),
        "ellipsoid": place.norm(dim=1),
        "cylinder": torch.maximum(flat.norm(dim=1), z),
        "rectangle": torch.where(flat.amax(1) <= 1.0001, 1 + z, 0),
        "disc": torch.where(flat.norm(dim=1) <= 1.0001, 1 + z, 0),
    }[kind]
    assert 20 < met.sum() < 500
    assert_close(on_surface, torch.ones(int(met.sum())), atol=1e-4)  # single precision at 4 m


def test_the_same_seed_draws_the_same_pair_and_another_draws_another():
    one, same, other = (draw_pair(seed, (48, 32)) for seed in (7, 7, 8))

    assert all(np.array_equal(one[name], same[name]) for name in one)
    assert not np.array_equal(one["left"], other["left"])


def test_pairs_are_whole_and_varied():
    pairs = [draw(torch.Generator().manual_seed(seed), (64, 40), samples=1) for seed in range(12)]

    for pair in pairs:
        assert pair.left.shape == pair.right.shape == (40, 64, 3)
        assert pair.left.min() >= 0
        assert pair.left.max() <= 1
        assert pair.disparity_left.isfinite().all()
        assert (pair.disparity_left >= 0).all()
        assert pair.visible.float().mean() > 0.3
    means = torch.tensor([float(pair.disparity_left.mean()) for pair in pairs])
    assert means.max() > 2.5 * means.min()
    assert len(KINDS_OF_SCENE) == 5


def test_drawing_leaves_the_global_randomness_alone():
    torch.manual_seed(1)
    expected = torch.rand(3)

    torch.manual_seed(1)
    draw_pair(3, (16, 8))

    assert torch.equal(torch.rand(3), expected)


@pytest.mark.slow
def test_a_pool_holds_the_pairs_of_its_seeds_and_is_filled_once(tmp_path):
    first = list(fill_pool(tmp_path / "pool", range(2), (48, 32), workers=1))
    second = list(fill_pool(tmp_path / "pool", range(3), (48, 32), workers=1))

    assert [path.name for path in first] == ["pair_000000.npz", "pair_000001.npz"]
    assert [path.name for path in second] == ["pair_000002.npz"]
    drawn = draw_pair(2, (48, 32))
    read = read_pair(tmp_path / "pool", 2)
    assert read.keys() == drawn.keys()
    assert all(np.array_equal(read[name], drawn[name]) for name in drawn)


@pytest.mark.slow
@pytest.mark.parametrize("name", STILL_LIFES)
def test_a_still_life_fills_its_picture_with_things_at_many_distances(name, monkeypatch):
    quarter = View(width=180, height=135, focal_px=190.0, baseline_m=0.14)
    monkeypatch.setattr(samples, "VIEW", quarter)

    sample = samples.draw_still_life(name, samples=1)

    assert sample.left.shape == (135, 180, 3)
    assert sample.disparity_left.isfinite().all()
    assert sample.disparity_left.min() > 0
    assert 20 < 4 * sample.disparity_left.max() < samples.CANDIDATES
    assert sample.visible.float().mean() > 0.8
    assert sample.left.std() > 0.05
