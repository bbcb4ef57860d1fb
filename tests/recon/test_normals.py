import time

import numpy as np
import pytest

from calib.rig import RectifiedGeometry
from recon.kernels.planes import plane_slopes
from recon.normals import surface_normals

WIDTH, HEIGHT = 160, 120
GEOMETRY = RectifiedGeometry(
    size=(WIDTH, HEIGHT),
    focal_px=180.0,
    centre_left=(74.3, 61.8),
    centre_right=(77.8, 61.8),
    baseline_m=0.2,
)


def rays(geometry=GEOMETRY):
    """Return (H, W, 3) directions ((x - cx) / f, (y - cy) / f, 1)."""
    width, height = geometry.size
    y, x = np.mgrid[:height, :width]
    cx, cy = geometry.centre_left
    f = geometry.focal_px
    return np.stack([(x - cx) / f, (y - cy) / f, np.ones(x.shape)], axis=2)


def disparities_of(depth, geometry=GEOMETRY):
    scale = geometry.focal_px * geometry.baseline_m
    return (scale / depth + geometry.disparity_at_infinity).astype(np.float32)


def a_plane(normal, through):
    """Return the disparities of the plane through a place, and its unit normal to the camera."""
    normal = np.array(normal) / np.linalg.norm(normal)
    normal = normal if normal @ through < 0 else -normal
    return disparities_of((normal @ through) / (rays() @ normal)), normal


def degrees_between(normals, expected):
    return np.degrees(np.arccos(np.clip((normals * expected).sum(axis=-1), -1, 1)))


@pytest.mark.parametrize(
    "normal", [(0, 0, -1), (0.5, 0, -1), (-1, 0, -1), (0, -1, -0.5), (0.6, 0.5, -0.7)]
)
def test_the_normal_of_a_plane_is_that_of_the_plane_wherever_the_principal_points_are(normal):
    values, expected = a_plane(normal, through=(0.1, 0.05, 3.0))
    values[values < 4] = np.nan  # a plane seen along its surface passes through infinity

    normals = surface_normals(values, GEOMETRY)

    inside = np.isfinite(values)
    inside[:6], inside[-6:], inside[:, :6], inside[:, -6:] = False, False, False, False
    assert inside.sum() > 1000
    assert degrees_between(normals[inside], expected).max() < 0.3


def test_the_normals_of_a_sphere_point_from_its_centre():
    geometry = GEOMETRY.resized((4 * WIDTH, 4 * HEIGHT))
    centre, radius = np.array([0.2, -0.1, 2.5]), 0.9
    directions = rays(geometry)
    along = directions @ centre
    squares = (directions**2).sum(axis=2)
    inside = along**2 - squares * (centre @ centre - radius**2)
    with np.errstate(invalid="ignore"):
        depth = (along - np.sqrt(inside)) / squares
    expected = (directions * depth[..., None] - centre) / radius

    normals = surface_normals(disparities_of(depth, geometry), geometry)

    seen = inside > 0
    error = degrees_between(normals, expected)[seen]
    facing = -(expected * directions).sum(axis=2)[seen] / np.sqrt(squares[seen])  # a cosine
    assert np.median(error) < 0.3
    assert np.percentile(error[facing > 0.5], 99) < 1.5


def test_no_normal_is_fitted_over_a_depth_edge():
    near, of_near = a_plane((0.5, 0.2, -1), through=(0, 0, 2.0))
    far, of_far = a_plane((-0.4, 0.1, -1), through=(0, 0, 3.0))
    left = np.arange(WIDTH) < 90
    values = np.where(left, near, far)
    assert (np.abs(values[:, 89] - values[:, 90]) > 1.5).all()

    normals = surface_normals(values, GEOMETRY)

    assert degrees_between(normals[:, left], of_near).max() < 1.0
    assert degrees_between(normals[:, ~left], of_far).max() < 1.0


def test_a_bend_within_a_surface_stays_sharp():
    one, of_one = a_plane((1, 0, -1), through=(0, 0, 1.0))
    other, of_other = a_plane((-1, 0, -1), through=(0, 0, 1.0))
    values = np.minimum(one, other)  # a corner of a room
    ridge = np.argmax(values[HEIGHT // 2])
    assert np.abs(one - other)[:, ridge - 1 : ridge + 2].max() < 1

    normals = surface_normals(values, GEOMETRY)

    side = of_one if values[0, 20] == one[0, 20] else of_other
    error = degrees_between(normals, side)
    assert error[:, 6 : ridge - 3].max() < 10
    assert np.median(error[:, 6 : ridge - 1]) < 0.5


def test_noise_is_averaged_over_the_window():
    values, expected = a_plane((0.3, 0, -1), through=(0, 0, 1.0))
    noise = np.random.default_rng(0).normal(0, 0.1, values.shape).astype(np.float32)

    normals = surface_normals(values + noise, GEOMETRY)

    sigma = 0.1 / np.sqrt(31**2 * 15 * 16 / 3)  # of a slope, over (2 r + 1)^2 pixels, r = 15
    expected_error = np.degrees(sigma / (values.mean() / GEOMETRY.focal_px))
    assert np.median(degrees_between(normals, expected)) < 1.5 * expected_error


def test_a_normal_is_of_unit_length_and_faces_the_camera_however_wild_the_disparities():
    random = np.random.default_rng(1)
    values = random.uniform(-3, 40, (HEIGHT, WIDTH)).astype(np.float32)
    values[random.random(values.shape) < 0.3] = np.nan

    normals = surface_normals(values, GEOMETRY)

    placed = values > GEOMETRY.disparity_at_infinity
    np.testing.assert_allclose(np.linalg.norm(normals[placed], axis=1), 1, atol=1e-5)
    assert ((normals * rays()).sum(axis=2)[placed] < 0).all()
    assert np.isnan(normals[~placed]).all()


def test_a_pixel_alone_faces_back_along_the_optical_axis():
    values = np.full((HEIGHT, WIDTH), np.nan, np.float32)
    values[40, 50] = 20

    normals = surface_normals(values, GEOMETRY)

    np.testing.assert_array_equal(normals[40, 50], (0, 0, -1))
    assert np.isnan(normals).sum() == 3 * (values.size - 1)


def test_one_row_of_neighbours_gives_no_slope_across_it():
    values = np.full((9, 30), np.nan, np.float32)
    values[4] = 10 + 0.5 * np.arange(30)

    slopes = plane_slopes(values, radii=(1, 2, 5), edge=1.0, noise=0.3)

    np.testing.assert_array_equal(slopes[4, :, 1], 0)
    np.testing.assert_allclose(slopes[4, 5:-5, 0], 0.5, rtol=0.01)


def slopes_by_hand(values, radii, edge, noise):
    """The loop that `plane_slopes` describes, one pixel after the other."""
    height, width = values.shape
    result = np.full((height, width, 2), np.nan)
    for y, x in zip(*np.nonzero(np.isfinite(values)), strict=True):
        for radius in radii:
            members = [
                (column - x, row - y, values[row, column] - values[y, x])
                for row in reached(values[:, x], y, radius, edge)
                for column in reached(values[row], x, radius, edge)
            ]
            about = np.array(members) - np.mean(members, axis=0)
            places, rises = about[:, :2], about[:, 2]
            slope = np.linalg.solve(places.T @ places + 0.1 * np.eye(2), places.T @ rises)
            left_over = rises @ rises - slope @ (places.T @ rises)
            if radius > radii[0] and left_over > len(members) * noise**2:
                break
            result[y, x] = slope
    return result


def reached(line, start, radius, edge):
    places = [start]
    for step in (-1, 1):
        place = start
        while (
            0 <= place + step < len(line)
            and abs(place + step - start) <= radius
            and abs(line[place + step] - line[place]) <= edge
        ):
            place += step
            places.append(place)
    return places


def test_the_compiled_fit_is_that_of_the_slow_loop():
    random = np.random.default_rng(2)
    y, x = np.mgrid[:24, :30]
    values = 20 + 0.4 * x - 0.2 * y + random.normal(0, 0.2, x.shape)
    values[:, 17:] -= 5
    values[random.random(values.shape) < 0.1] = np.nan
    values = values.astype(np.float32)

    slopes = plane_slopes(values, radii=(1, 3, 7), edge=1.0, noise=0.25)

    expected = slopes_by_hand(values.astype(np.float64), (1, 3, 7), 1.0, 0.25)
    assert (np.abs(slopes - expected) > 1e-3).mean() < 0.005  # a residual met in another rounding
    np.testing.assert_array_equal(np.isnan(slopes), np.isnan(expected))


@pytest.mark.slow
def test_the_normals_of_a_large_pair_take_less_than_a_second_on_two_cores():
    values = np.random.default_rng(3).normal(60, 0.2, (1000, 1400)).astype(np.float32)
    geometry = RectifiedGeometry((1400, 1000), 1200.0, (700, 500), (700, 500), 0.2)

    fastest = np.inf
    for _ in range(4):  # the first one may compile
        start = time.process_time()
        surface_normals(values, geometry)
        fastest = min(fastest, time.process_time() - start)

    assert fastest < 1.5  # of all threads together; two take half
