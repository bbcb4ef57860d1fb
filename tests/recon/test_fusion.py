"""Depth maps of a ball before a wall, drawn exactly, fused to one surface."""

from dataclasses import replace

import numpy as np
import pytest

from calib import Pose
from calib.rig import RectifiedGeometry
from recon.fusion import DepthNoise, DepthView, Fusion, Volume, stereo_noise
from recon.fusion.averaging import stated_sigma_m
from recon.fusion.surface import FusedSurface, without_fragments

K = np.array([[120.0, 0, 79.5], [0, 120.0, 59.5], [0, 0, 1]])
SHAPE = (120, 160)
BALL, RADIUS = np.array([0.0, 0.0, 2.0]), 0.5
WALL_Z = 3.0
NOISE = DepthNoise(0.005, 0.0)
VOXEL = 0.04
QUICK = Fusion(VOXEL, min_views=1, smallest_piece_m2=0.0, correlation=0.0)


def rays(pose):
    v, u = np.indices(SHAPE)
    of_camera = np.stack(
        [(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(SHAPE)], axis=-1
    )
    return of_camera @ pose.R.T


def ball_before_wall(pose=None, *, ball=True, noise_m=0.0, seed=0, trust=1.0, wall_z=WALL_Z):
    """A view with exact depths: z of the camera is the parameter of rays with z = 1."""
    pose = pose or Pose.identity()
    direction, origin = rays(pose), pose.t - BALL
    depth = (wall_z - pose.t[2]) / direction[..., 2]
    a = (direction**2).sum(-1)
    b = direction @ origin
    inside = b * b - a * (origin @ origin - RADIUS**2)
    hit = inside >= 0
    if ball:
        depth = np.where(hit, (-b - np.sqrt(np.maximum(inside, 0))) / a, depth)
    depth = depth + np.random.default_rng(seed).normal(0, 1, SHAPE) * noise_m
    image = np.where((hit & ball)[..., None], [200, 40, 40], [40, 40, 200]).astype(np.uint8)
    trusts = np.full(SHAPE, trust, np.float32)
    return DepthView(depth.astype(np.float32), trusts, image, K, NOISE, pose)


def aside(x_m, turn=0.0):
    return Pose.from_values(np.array([0, turn, 0, x_m, 0, 0]))


def fused(*views, settings=QUICK):
    volume = Volume(settings)
    for view in views:
        volume.add(view)
    return volume.surface()


def off_truth(surface):
    """Distance of every vertex to the ball or the wall, whichever is nearer."""
    to_ball = np.abs(np.linalg.norm(surface.vertices - BALL, axis=1) - RADIUS)
    return np.minimum(to_ball, np.abs(surface.vertices[:, 2] - WALL_Z))


WALK = [ball_before_wall(aside(x, -x / 2)) for x in (-0.4, -0.2, 0.0, 0.2, 0.4)]


def test_the_surface_lies_where_all_views_saw_it():
    surface = fused(*WALK)

    assert np.quantile(off_truth(surface), 0.95) < VOXEL / 8
    assert np.median(off_truth(surface)) < VOXEL / 40


def test_normals_face_the_cameras_and_faces_turn_with_them():
    surface = fused(*WALK)

    a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
    turned = np.cross(b - a, c - a)
    assert (np.einsum("ij,ij->i", turned, surface.normals[surface.faces[:, 0]]) > 0).mean() > 0.99
    wall = surface.vertices[:, 2] > WALL_Z - VOXEL / 4
    assert surface.normals[wall, 2].mean() < -0.95
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1, atol=1e-3)


def test_colours_are_those_of_the_views():
    surface = fused(*WALK)

    near_ball = np.linalg.norm(surface.vertices - BALL, axis=1) < RADIUS + VOXEL / 2
    assert (np.median(surface.colours[near_ball], axis=0) == [200, 40, 40]).all()
    assert (np.median(surface.colours[~near_ball], axis=0) == [40, 40, 200]).all()


def test_noise_of_many_views_averages_out():
    noise_m = NOISE.base_m

    def spread(count):
        views = [ball_before_wall(ball=False, noise_m=noise_m, seed=n) for n in range(count)]
        return np.std(fused(*views).vertices[:, 2])

    assert spread(16) < 0.35 * spread(1)


def test_the_sigma_that_is_stated_is_that_of_independent_views():
    views = [ball_before_wall(ball=False, trust=0.5 if n else 1.0) for n in range(3)]

    surface = fused(*views)

    # The weights are trust / sigma^2: 1 + 0.5 + 0.5 of them.
    np.testing.assert_allclose(np.median(surface.sigma_m), NOISE.base_m / np.sqrt(2), rtol=1e-5)
    assert np.median(surface.views) == 3
    np.testing.assert_allclose(np.median(surface.trust), 2 / 3, rtol=1e-5)


@pytest.mark.parametrize("correlation", [0.0, 0.4, 1.0])
def test_the_sigma_that_is_stated_is_that_of_errors_that_are_alike_in_part(correlation):
    views, count, draws = 6, np.array([6.0]), 40_000
    dice = np.random.default_rng(1)
    shared, own = dice.normal(size=(draws, 1)), dice.normal(size=(draws, views))
    means = (np.sqrt(correlation) * shared + np.sqrt(1 - correlation) * own).mean(axis=1)

    stated = stated_sigma_m(count, count, correlation)

    np.testing.assert_allclose(stated, means.std(), rtol=0.02)


def test_views_that_err_alike_state_a_greater_sigma_of_the_same_surface():
    views = [ball_before_wall(ball=False) for _ in range(3)]

    apart, alike = (fused(*views, settings=replace(QUICK, correlation=r)) for r in (0.0, 0.5))

    np.testing.assert_array_equal(apart.vertices, alike.vertices)
    np.testing.assert_allclose(alike.sigma_m, apart.sigma_m * np.sqrt(2), rtol=1e-5)


def test_a_view_of_less_error_counts_for_more():
    near = ball_before_wall(ball=False, wall_z=3.0)
    far = ball_before_wall(ball=False, wall_z=3.05)
    coarse = DepthView(
        far.depth, far.trust, far.image, K, DepthNoise(0.015, 0.0), far.world_from_camera
    )

    surface = fused(near, coarse)

    np.testing.assert_allclose(np.median(surface.vertices[:, 2]), 3.0 + 0.05 / 10, atol=1e-4)


def test_a_pixel_of_less_error_counts_for_more():
    near = ball_before_wall(ball=False, wall_z=3.0)
    far = ball_before_wall(ball=False, wall_z=3.05)
    times = np.ones(SHAPE, np.float32)
    times[:, 80:] = 3

    surface = fused(near, replace(far, noise_times=times))

    z, left = surface.vertices[:, 2], surface.vertices[:, 0] < 0
    np.testing.assert_allclose(np.median(z[left]), 3.0 + 0.05 / 2, atol=1e-4)
    np.testing.assert_allclose(np.median(z[~left]), 3.0 + 0.05 / 10, atol=1e-4)
    sigma = [np.median(surface.sigma_m[half]) for half in (left, ~left)]
    np.testing.assert_allclose(sigma, NOISE.base_m / np.sqrt([2, 1 + 1 / 9]), rtol=1e-5)


def test_pixels_whose_error_exceeds_the_truncation_make_no_surface():
    times = np.ones(SHAPE, np.float32)
    times[:, 80:] = 1.1 * QUICK.truncation_m / NOISE.base_m

    surface = fused(replace(ball_before_wall(ball=False), noise_times=times))

    assert surface.vertices[:, 0].min() < -1.9
    assert surface.vertices[:, 0].max() < VOXEL


def test_what_a_pixel_that_is_unsure_sees_through_is_not_emptied():
    truth = ball_before_wall(ball=False)
    wrong = ball_before_wall(ball=False, wall_z=WALL_Z + 1.0)
    unsure = replace(wrong, noise_times=np.full(SHAPE, 80, np.float32))  # 0.4 m

    surface = fused(truth, *[unsure] * 3, settings=Fusion(VOXEL, min_views=1, max_depth_m=3.5))

    assert np.abs(np.median(surface.vertices[:, 2]) - WALL_Z) < VOXEL / 10


def test_what_moved_away_is_seen_through_and_gone():
    there, gone = ball_before_wall(), ball_before_wall(ball=False)

    surface = fused(there, gone, gone, gone)

    near_ball = np.linalg.norm(surface.vertices - BALL, axis=1) < RADIUS + 2 * VOXEL
    assert not near_ball.any()
    assert (np.abs(surface.vertices[:, 2] - WALL_Z) < VOXEL).all()


def test_a_surface_is_not_emptied_by_what_is_only_a_little_farther():
    truth = ball_before_wall(ball=False)
    wrong = ball_before_wall(ball=False, wall_z=WALL_Z + 1.0)
    unsure = DepthView(
        wrong.depth, wrong.trust, wrong.image, K, DepthNoise(0.4, 0.0), wrong.world_from_camera
    )

    surface = fused(truth, *[unsure] * 3, settings=Fusion(VOXEL, min_views=1, max_depth_m=3.5))

    assert np.abs(np.median(surface.vertices[:, 2]) - WALL_Z) < VOXEL / 10


def test_depths_that_are_not_trusted_or_too_far_make_no_surface():
    doubted = ball_before_wall(trust=0.25)
    settings = Fusion(VOXEL, min_views=1, min_trust=0.2, max_depth_m=2.5)

    assert len(fused(doubted).faces) == 0
    only_ball = fused(doubted, settings=settings)
    assert 0 < only_ball.vertices[:, 2].max() < 2.5 + VOXEL


def test_fewer_views_than_asked_for_make_no_surface():
    views = [ball_before_wall(aside(x)) for x in (0.0, 0.01)]

    assert len(fused(*views, settings=Fusion(VOXEL, min_views=3)).faces) == 0
    assert len(fused(*views, settings=Fusion(VOXEL, min_views=3).for_views(2)).faces) > 0


def test_pieces_smaller_than_asked_for_are_left_out():
    views = [ball_before_wall()] * 2
    ball_m2 = np.pi * RADIUS**2  # at least what is seen of it, flat

    whole = fused(*views, settings=Fusion(VOXEL, min_views=1, smallest_piece_m2=0.0))
    largest = fused(*views, settings=Fusion(VOXEL, min_views=1, smallest_piece_m2=3 * ball_m2))

    assert whole.vertices[:, 2].min() < 2
    assert largest.vertices[:, 2].min() > WALL_Z - VOXEL
    assert largest.faces.max() == len(largest.vertices) - 1


def test_two_runs_give_the_same_arrays():
    first, second = fused(*WALK), fused(*WALK)

    for name in ("vertices", "faces", "normals", "colours", "sigma_m", "views", "trust"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


def test_memory_grows_with_the_surface_and_not_with_the_views():
    volume = Volume(QUICK)
    counts = []
    for _ in range(4):
        volume.add(WALK[2])
        counts.append(volume.blocks)

    assert len(set(counts)) == 1
    volume.add(WALK[0])
    assert counts[0] < volume.blocks < 2 * counts[0]


def test_a_world_far_from_its_origin_is_fused_as_well():
    far_away = Pose(np.eye(3), np.array([-800.0, 30.0, 400.0]))
    views = [
        DepthView(v.depth, v.trust, v.image, v.K, v.noise, far_away @ v.world_from_camera)
        for v in WALK
    ]

    surface = fused(*views)

    assert np.median(np.abs(np.linalg.norm(surface.vertices - far_away.t - BALL, axis=1))) < 3
    near_wall = np.abs(surface.vertices[:, 2] - 400 - WALL_Z)
    assert np.median(near_wall) < VOXEL / 8


def test_the_error_of_stereo_is_that_of_the_conventions():
    geometry = RectifiedGeometry((160, 120), 120.0, (80, 60), (80, 60), 0.1)

    noise = stereo_noise(geometry, 0.5)

    np.testing.assert_allclose(noise.sigma_m(np.array([2.0])), 2.0**2 / (120 * 0.1) * 0.5)


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("voxel_m", 0.0),
        ("truncation_voxels", 0.5),
        ("min_trust", 1.5),
        ("min_views", 0),
        ("smallest_piece_m2", -1.0),
        ("max_depth_m", 0.0),
    ],
)
def test_a_setting_out_of_range_is_named(setting, value):
    with pytest.raises(ValueError, match=setting):
        Fusion(**{"voxel_m": 0.1, setting: value})


def test_a_small_piece_stays_if_many_views_see_it():
    def triangle(x_m, side_m):
        corners = [[x_m, 0, 1], [x_m + side_m, 0, 1], [x_m, side_m, 1]]
        return np.array(corners, np.float32)

    vertices = np.concatenate([triangle(0, 2.0), triangle(5, 0.5), triangle(9, 0.5)])
    views = np.repeat(np.float32([2, 8, 2]), 3)
    zeros, ones = np.zeros((9, 3), np.float32), np.ones(9, np.float32)
    faces = np.arange(9, dtype=np.int32).reshape(3, 3)
    surface = FusedSurface(vertices, faces, zeros, zeros.astype(np.uint8), ones, views, ones)

    kept = without_fragments(surface, 1.0, few_views=2)

    assert sorted(set(kept.vertices[:, 0] // 4)) == [0, 1]  # the last is small and seen by few
    assert len(without_fragments(surface, 0.1, few_views=2).faces) == 3
    assert len(without_fragments(surface, 1.0, few_views=8).faces) == 1
