import dataclasses
import itertools

import numpy as np
import pytest
from test_files import a_cloud

from recon.cloud_filters import CloudFilters, uniform_positions, voxel_means
from recon.types import PixelStatus, PointCloud

FOCAL = 70.0


def a_wall(depth, *, rows=30, columns=40, sigma_px=0.5, focal_baseline=8.4):
    """Return the cloud of a wall that fills the picture, one point a pixel."""
    y, x = np.mgrid[:rows, :columns].astype(np.float64)
    z = np.full(y.size, depth)
    points = np.stack([x.ravel() * z / FOCAL, y.ravel() * z / FOCAL, z], axis=1)
    count = len(points)
    return PointCloud(
        points=points.astype(np.float32),
        colours=np.full((count, 3), 128, np.uint8),
        normals=np.tile(np.float32([0, 0, -1]), (count, 1)),
        confidence=np.ones(count, np.float32),
        depth_sigma_m=(z**2 / focal_baseline * sigma_px).astype(np.float32),
        status=np.full(count, PixelStatus.MATCHED, np.uint8),
    )


def joined(*clouds):
    names = [field.name for field in dataclasses.fields(PointCloud)]
    return PointCloud(**{n: np.concatenate([getattr(c, n) for c in clouds]) for n in names})


def lone_points(depth):
    """Return five points far from each other and from a wall behind them."""
    return a_wall(depth).chosen(np.array([205, 215, 225, 805, 835]))


def test_points_of_a_pair_are_a_pixel_apart_at_any_depth():
    for depth in (0.5, 3.0, 60.0):
        at = uniform_positions(a_wall(depth), FOCAL).reshape(30, 40, 3)

        np.testing.assert_allclose(np.diff(at[..., 0], axis=1), 1, atol=1e-4)
        np.testing.assert_allclose(np.diff(at[..., 1], axis=0), 1, atol=1e-4)
        np.testing.assert_allclose(at[..., 2], 8.4 / depth / 0.5, rtol=1e-5)


@pytest.mark.slow  # imports open3d
@pytest.mark.parametrize(
    "setting", [{"remove_radius_outliers": True}, {"remove_statistical_outliers": True}]
)
def test_lone_points_go_and_walls_stay_however_far_they_are(setting):
    near, far, lone = a_wall(1.0), a_wall(20.0), lone_points(0.3)
    cloud = joined(near, lone, far)

    left, (removal,) = CloudFilters(**setting)(cloud, focal_px=FOCAL)

    gone = np.ones(len(cloud), bool)
    gone[np.isin(cloud.points[:, 2], left.points[:, 2])] = False
    assert set(cloud.points[gone, 2]) == {np.float32(0.3)}
    assert (left.points[:, 2] == 1).sum() > 0.98 * len(near)
    assert (left.points[:, 2] == 20).sum() > 0.98 * len(far)
    assert (removal.removed, removal.of) == (len(cloud) - len(left), len(cloud))


@pytest.mark.slow  # imports open3d
def test_the_summary_adds_up_and_names_the_filters_in_order():
    cloud = joined(a_wall(2.0), lone_points(0.3))
    every = CloudFilters(remove_statistical_outliers=True, remove_radius_outliers=True, voxel_m=0.2)

    left, removals = every(cloud, focal_px=FOCAL)

    names = ["statistical outliers", "radius outliers", "merged in voxels"]
    assert [removal.filter for removal in removals] == names
    assert removals[0].of == len(cloud)
    assert len(cloud) - sum(removal.removed for removal in removals) == len(left)
    for before, after in itertools.pairwise(removals):
        assert before.of - before.removed == after.of


def test_without_settings_nothing_happens():
    cloud = a_cloud()

    left, removals = CloudFilters()(cloud, focal_px=FOCAL)

    assert left is cloud
    assert removals == ()


@pytest.mark.parametrize("edge_m", [0.4, 0.7, 5.0])
def test_thinning_again_changes_nothing(edge_m):
    once = voxel_means(a_cloud(2000), edge_m)

    twice = voxel_means(once, edge_m)

    assert len(once) < 2000
    for field in dataclasses.fields(PointCloud):
        a, b = getattr(once, field.name), getattr(twice, field.name)
        np.testing.assert_allclose(a.astype(float), b.astype(float), atol=1e-6)


def test_each_cube_holds_one_point():
    thin = voxel_means(a_cloud(3000), 0.5)

    cubes = np.floor(thin.points.astype(np.float64) / 0.5)
    assert len(np.unique(cubes, axis=0)) == len(thin)


def test_a_cube_holds_the_means_and_the_commonest_status():
    cloud = dataclasses.replace(
        a_cloud(4),
        points=np.float32([[0.1, 0.1, 0.1], [0.3, 0.1, 0.1], [0.2, 0.4, 0.1], [5, 5, 5]]),
        colours=np.uint8([[10, 0, 0], [20, 0, 0], [60, 0, 255], [1, 2, 3]]),
        normals=np.float32([[0, 0, -1], [0, -1, 0], [0, 0, -1], [1, 0, 0]]),
        confidence=np.float32([0.2, 0.4, 0.9, 0.1]),
        status=np.uint8([5, 1, 5, 4]),
    )

    thin = voxel_means(cloud, 1.0)

    np.testing.assert_allclose(thin.points, [[0.2, 0.2, 0.1], [5, 5, 5]], rtol=1e-6)
    np.testing.assert_array_equal(thin.colours, [[30, 0, 85], [1, 2, 3]])
    np.testing.assert_allclose(thin.normals[0], np.array([0, -1, -2]) / np.sqrt(5), rtol=1e-6)
    np.testing.assert_allclose(thin.confidence, [0.5, 0.1], rtol=1e-6)
    np.testing.assert_allclose(thin.depth_sigma_m[0], cloud.depth_sigma_m[:3].mean(), rtol=1e-6)
    np.testing.assert_array_equal(thin.status, [5, 4])


def test_normals_that_cancel_leave_the_first():
    cloud = dataclasses.replace(
        a_cloud(2),
        points=np.float32([[0.1, 0.1, 0.1], [0.3, 0.1, 0.1]]),
        normals=np.float32([[0, 0, -1], [0, 0, 1]]),
    )

    np.testing.assert_array_equal(voxel_means(cloud, 1.0).normals, [[0, 0, -1]])


def test_an_empty_cloud_stays_empty():
    empty = a_cloud().chosen(np.zeros(50, bool))
    filters = CloudFilters(remove_radius_outliers=True, voxel_m=1.0)

    left, removals = filters(empty, focal_px=FOCAL)

    assert len(left) == 0
    assert [removal.percent for removal in removals] == [0, 0]


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"voxel_m": 0.0}, "voxel_m must be positive, got 0.0 m"),
        ({"radius_px": -1.0}, "radius_px must be positive, got -1.0 px"),
        ({"radius_neighbours": 0}, "radius_neighbours must be at least 1, got 0"),
        ({"statistical_deviations": np.inf}, "statistical_deviations must be positive, got inf"),
    ],
)
def test_impossible_settings_are_refused(setting, message):
    with pytest.raises(ValueError, match=message):
        CloudFilters(**setting)
