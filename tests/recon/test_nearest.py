"""Nearest points: the search in rings gives what comparing every point with every other gives."""

import numpy as np
import pytest

from recon.kernels.nearest import PointGrid, nearest_distances

FOCAL, CENTRE = 40.0, (21.3, 14.6)  # wide: the slopes of the rays reach 0.6
SHAPE = (33, 45)  # no multiple of a tile
FLOAT32_DIGITS = 1e-6
"""Of a depth: what is lost when float32 coordinates are subtracted."""


@pytest.fixture
def rng():
    return np.random.default_rng(20240229)


def grid(depths, focal=FOCAL, centre=CENTRE):
    return PointGrid(depths.astype(np.float32), focal, centre)


def coordinates(points):
    """All points of a grid, (N, 3) float64."""
    y, x = np.nonzero(~np.isnan(points.depths))
    z = points.depths[y, x].astype(np.float64)
    (cx, cy), f = points.centre, points.focal
    return np.stack([(x - cx) / f * z, (y - cy) / f * z, z], axis=1)


def every_distance(asked, points, limit):
    """The slow, obvious form of `nearest_distances` with a step of 1."""
    others = coordinates(points)
    result = np.full(asked.depths.shape, np.nan)
    found = []
    for point in coordinates(asked):
        distance = np.sqrt(((others - point) ** 2).sum(axis=1)).min(initial=np.inf)
        found.append(distance if distance < limit * point[2] else np.inf)
    result[~np.isnan(asked.depths)] = found
    return result


def surfaces(rng, shape=SHAPE):
    """A slanted, rough wall with a nearer square in front, and gaps."""
    y, x = np.indices(shape)
    depths = 5 + 0.02 * x - 0.03 * y + rng.normal(0, 0.02, shape)
    depths[shape[0] // 4 : shape[0] // 2, shape[1] // 3 : shape[1] // 2] = 3
    depths[rng.random(shape) < 0.2] = np.nan
    depths[shape[0] // 2 :, : shape[1] // 4] = np.nan
    return depths


def scattered(rng, shape=SHAPE):
    """Depths without any surface, from 0.1 to 8, half of them missing."""
    depths = 1.5 ** rng.integers(-5, 6, shape) * rng.uniform(0.99, 1.01, shape)
    depths[rng.random(shape) < 0.5] = np.nan
    return depths


def assert_as_every_distance(asked, points, limit):
    result = nearest_distances(asked, points, limit=limit, step=1)

    expected = every_distance(asked, points, limit)
    np.testing.assert_array_equal(np.isnan(result), np.isnan(expected))
    np.testing.assert_array_equal(np.isinf(result), np.isinf(expected))
    finite = np.isfinite(expected)
    assert finite.any()
    error = np.abs(result[finite] - expected[finite])
    assert (error <= 10 * FLOAT32_DIGITS * asked.depths[finite]).all()


@pytest.mark.parametrize("limit", [0.01, 0.05, 0.5, 50.0])
@pytest.mark.parametrize("make", [surfaces, scattered])
def test_distances_are_those_to_the_nearest_of_all_points(rng, make, limit):
    assert_as_every_distance(grid(make(rng)), grid(make(rng)), limit)


@pytest.mark.parametrize(
    "centre", [(200.0, 14.6), (-150.0, 90.0)], ids=["right of the grid", "below it and left"]
)
def test_distances_are_exact_on_steep_rays(rng, centre):
    asked, points = (grid(surfaces(rng), centre=centre) for _ in range(2))

    assert_as_every_distance(asked, points, 0.05)


def test_grids_may_differ_in_fineness(rng):
    fine = grid(surfaces(rng, (66, 90)), 2 * FOCAL, (2 * CENTRE[0] + 0.5, 2 * CENTRE[1] + 0.5))
    coarse = grid(surfaces(rng))

    assert_as_every_distance(coarse, fine, 0.05)
    assert_as_every_distance(fine, coarse, 0.05)


def test_the_search_reaches_the_far_end_of_a_long_grid():
    asked, points = np.full((3, 120), np.nan), np.full((3, 120), np.nan)
    asked[1, 2], points[1, 117] = 2.0, 2.0

    assert_as_every_distance(grid(asked), grid(points), 5.0)


def test_a_grid_is_nowhere_away_from_itself(rng):
    points = grid(surfaces(rng))

    distances = nearest_distances(points, points, limit=0.05, step=1)

    assert (distances[~np.isnan(points.depths)] == 0).all()


def test_rays_without_a_point_ask_nothing(rng):
    asked = grid(surfaces(rng))

    distances = nearest_distances(asked, grid(surfaces(rng)), limit=0.05, step=1)

    np.testing.assert_array_equal(np.isnan(distances), np.isnan(asked.depths))


def test_a_step_asks_every_so_many_rows_and_columns_of_all_points(rng):
    asked, points = grid(surfaces(rng)), grid(surfaces(rng))

    distances = nearest_distances(asked, points, limit=0.05, step=3)

    every = nearest_distances(asked, points, limit=0.05, step=1)
    np.testing.assert_array_equal(distances, every[::3, ::3])


def test_nothing_is_near_an_empty_grid(rng):
    asked = grid(surfaces(rng))

    distances = nearest_distances(asked, grid(np.full(SHAPE, np.nan)), limit=0.05, step=1)

    assert np.isinf(distances[~np.isnan(asked.depths)]).all()


def test_only_points_nearer_than_the_limit_count():
    asked, points = np.full(SHAPE, np.nan), np.full(SHAPE, np.nan)
    asked[10, 10] = 4.0
    points[10, 10] = 3.0  # 1.0 m along a ray with slopes u, v: sqrt(1 + u^2 + v^2) m
    u, v = (10 - CENTRE[0]) / FOCAL, (10 - CENTRE[1]) / FOCAL
    away = np.sqrt(1 + u**2 + v**2)

    above, below = (
        nearest_distances(grid(asked), grid(points), limit=limit, step=1)[10, 10]
        for limit in (away / 4 * 1.001, away / 4 * 0.999)
    )

    assert above == pytest.approx(away)
    assert np.isinf(below)


def test_asking_changes_nothing(rng):
    asked, points = grid(surfaces(rng)), grid(surfaces(rng))
    before = asked.depths.copy(), points.depths.copy()

    nearest_distances(asked, points, limit=0.05, step=2)

    np.testing.assert_array_equal(asked.depths, before[0])
    np.testing.assert_array_equal(points.depths, before[1])
