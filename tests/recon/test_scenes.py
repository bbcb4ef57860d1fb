"""Generated pairs: their truth is exact, and their light is that of the scene."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from rendered import VIEW, coat, still_life_sample

from recon.training import lighting, samples, scenes
from recon.training.composition import Coat, Thing, View, assemble, rotation_about
from recon.training.pool import draw_pair, fill_pool, read_pair
from recon.training.recipe import HARD, SCENES, Recipe
from recon.training.samples import STILL_LIFES
from recon.training.scenery import compose
from recon.training.scenes import draw, render
from recon.training.textures import noise_table

CULLED = ("clutter", "lattice", "garden", "landscape")


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


def test_what_the_left_camera_does_not_show_is_not_visible_in_the_right_view(sample):
    partner = torch.arange(VIEW.width) + sample.disparity_right
    warped = sampled_at(sample.left, partner)

    judged = sample.visible_right & away_from_edges(sample.disparity_right)
    error = (warped - sample.right).abs().mean(-1)
    assert not sample.visible_right[partner > VIEW.width - 1].any()
    assert judged.float().mean() > 0.6
    assert error[judged].mean() < 0.03
    assert error[~sample.visible_right].mean() > 2 * error[judged].mean()


def test_normals_are_perpendicular_to_the_surface(sample):
    """Compare with the cross product of steps to neighbouring points."""
    x, y = VIEW.centre
    row, column = torch.meshgrid(torch.arange(VIEW.height), torch.arange(VIEW.width), indexing="ij")
    depth = (VIEW.focal_px * VIEW.baseline_m / sample.disparity_left).double()
    ray = torch.stack(((column - x) / VIEW.focal_px, (row - y) / VIEW.focal_px), -1)
    point = torch.cat((ray, torch.ones_like(ray[..., :1])), -1) * depth[..., None]
    across, down = point[1:-1, 2:] - point[1:-1, :-2], point[2:, 1:-1] - point[:-2, 1:-1]
    expected = F.normalize(torch.linalg.cross(down, across), dim=-1)

    inner = sample.normals[1:-1, 1:-1]
    judged = away_from_edges(sample.disparity_left)[1:-1, 1:-1]
    cosine = (inner * expected).sum(-1)
    assert (sample.normals.norm(dim=-1) - 1).abs().max() < 1e-5
    assert (inner * point[1:-1, 1:-1]).sum(-1).max() < 0  # towards the camera
    assert (cosine[judged] > 0.999).float().mean() > 0.95  # the ball is curved, the box has edges


def test_edges_are_the_two_pixels_on_either_side_of_a_jump_between_surfaces(sample):
    edges = sample.edges
    jumps = torch.zeros_like(edges)
    across = sample.disparity_left.diff(dim=1).abs() > 1
    down = sample.disparity_left.diff(dim=0).abs() > 1
    jumps[:, 1:] |= across
    jumps[:, :-1] |= across
    jumps[1:] |= down
    jumps[:-1] |= down

    assert torch.equal(edges, jumps)  # nothing here is so slanted that it jumps by itself
    assert 100 < edges.sum() < 0.1 * edges.numel()


def test_a_steep_surface_has_no_edges_of_its_own():
    steep = rotation_about(torch.tensor([0.0, 1.0, 0.0]), 1.5)
    wall = Thing("rectangle", (0, 0, 3), (9, 9, 1), steep, coat(5, (0.0, 0.0)))
    table = noise_table(torch.Generator().manual_seed(3))
    scene = assemble([wall], table, torch.tensor([0.0, -1.0, 0.0]), shadows=False)

    pair = render(scene, VIEW, samples=1)

    assert (pair.disparity_left.diff(dim=1).abs() > 1).any()
    assert not pair.edges.any()


def lit_wall(**light):
    """Return the left view of an even wall under a ball, lit from above it."""
    axes = torch.eye(3)
    even = Coat("flat", torch.full((2, 3), 0.5), 1.0, grain=0.0)
    floor = rotation_about(axes[0], math.pi / 2)
    things = [
        Thing("rectangle", (0, 0.5, 3), (9, 9, 1), floor, even),
        Thing("ellipsoid", (0, 0, 2.5), (0.2, 0.2, 0.2), axes, even),
    ]
    scene = assemble(things, torch.zeros(512, 512), -axes[1], shadows=True)
    scene = replace(scene, light=replace(scene.light, **light))
    return render(scene, View(160, 120, 120.0, 0.1), samples=2)


def test_light_that_covers_an_angle_casts_soft_shadows():
    hard, soft = (lit_wall(spread=spread).left.mean(-1) for spread in (0.0, 0.25))

    dark, bright = hard[60:].min(), hard.max()
    half_lit = [
        ((view > dark + 0.02) & (view < bright - 0.02))[70:].float().sum() for view in (hard, soft)
    ]
    assert half_lit[1] > 3 * half_lit[0]


def test_a_lamp_brightens_what_is_near_it():
    without = lit_wall().left
    near_left = lit_wall(lamp=(-0.6, 0.0, 2.0), lamp_strength=0.6, lamp_reach_m=0.5).left

    gain = (near_left - without).mean(-1)[60:]
    assert gain.min() >= 0
    assert gain[:, :40].mean() > 2 * gain[:, -40:].mean()


def test_highlights_move_with_the_eye():
    """A diffuse wall looks the same to both cameras, a glossy one does not."""
    axes = torch.eye(3)
    differences = []
    for gloss in (0.0, 0.5):
        even = Coat("flat", torch.full((2, 3), 0.3), 1.0, grain=0.0, gloss=gloss)
        wall = Thing("rectangle", (0, 0, 3), (9, 9, 1), axes, even)
        scene = assemble([wall], torch.zeros(512, 512), -axes[2], shadows=False)
        pair = render(scene, View(160, 120, 120.0, 0.6), samples=1)
        moved = pair.left[:, 24:] - pair.right[:, :-24]  # d = 120 x 0.6 / 3 px
        differences.append(float(moved.abs().max()))

    assert differences[0] < 1e-5
    assert differences[1] > 0.05


def test_the_same_seed_draws_the_same_pair_and_another_draws_another():
    one, same, other = (draw_pair(seed, (48, 32)) for seed in (7, 7, 8))

    assert all(np.array_equal(one[name], same[name]) for name in one)
    assert not np.array_equal(one["left"], other["left"])


@pytest.mark.parametrize("seed", [1, 2])
def test_looking_only_where_shapes_can_be_changes_nothing(seed, monkeypatch):
    """Images with soft shadows, disparities, and what each view sees of the other."""
    scene, view = compose(torch.Generator().manual_seed(seed), (48, 32), Recipe(scenes=CULLED))
    shadowy = replace(scene, light=replace(scene.light, casts_shadows=True, spread=0.1))

    culled = render(shadowy, view)
    for module in (scenes, lighting):
        monkeypatch.setattr(module, "windows", lambda *_: None)
    whole = render(shadowy, view)

    for field in fields(whole):
        assert torch.equal(getattr(culled, field.name), getattr(whole, field.name)), field.name


@pytest.mark.parametrize("kind", SCENES + HARD)
def test_pairs_of_every_kind_are_whole(kind):
    for seed in range(2):
        generator = torch.Generator().manual_seed(seed)
        pair = draw(generator, (64, 40), samples=1, recipe=Recipe(scenes=(kind,)))

        for view in (pair.left, pair.right):
            assert view.shape == (40, 64, 3)
            assert view.min() >= 0
            assert view.max() <= 1
            assert view.std() > 0.005
        for disparity in (pair.disparity_left, pair.disparity_right):
            assert disparity.isfinite().all()
            assert disparity.min() >= 0
        assert pair.disparity_left.max() <= 0.31 * 64
        assert pair.visible.float().mean() > 0.3
        assert pair.visible_right.float().mean() > 0.3
        assert pair.normals.isfinite().all()


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
