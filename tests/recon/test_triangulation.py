import numpy as np
import pytest

from calib.pair import RectifiedPair
from calib.rig import RectifiedGeometry
from recon.triangulation import (
    Triangulation,
    depth_map,
    depth_sigma,
    flying_pixels,
    positions,
    triangulate,
)
from recon.types import DisparityMap, PixelStatus

HEIGHT, WIDTH = 48, 64
GEOMETRY = RectifiedGeometry(
    size=(WIDTH, HEIGHT),
    focal_px=70.0,
    centre_left=(30.25, 22.5),
    centre_right=(33.75, 22.5),
    baseline_m=0.12,
)


def a_disparity_map(values, *, status=None, confidence=None):
    values = np.asarray(values, np.float32)
    if status is None:
        status = np.where(np.isnan(values), PixelStatus.OCCLUDED, PixelStatus.MATCHED)
    if confidence is None:
        confidence = (~np.isnan(values)).astype(np.float32)
    return DisparityMap(values, np.asarray(status, np.uint8), np.asarray(confidence, np.float32))


def a_pair(geometry=GEOMETRY, seed=0):
    width, height = geometry.size
    random = np.random.default_rng(seed)
    left, right = random.integers(0, 256, (2, height, width, 3), dtype=np.uint8)
    return RectifiedPair(left, right, geometry)


def constant(value):
    return np.full((HEIGHT, WIDTH), value, np.float32)


def random_values(seed=0):
    return np.random.default_rng(seed).uniform(-2, 20, (HEIGHT, WIDTH)).astype(np.float32)


def a_step(*, left=20.0, right=6.0, at=32):
    values = constant(right)
    values[:, :at] = left
    return values


def blurred_along_rows(values, width):
    reach = width // 2
    padded = np.pad(values, ((0, 0), (reach, width - 1 - reach)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, width, axis=1)
    return windows.mean(axis=2).astype(np.float32)


def test_points_project_onto_their_pixel_in_both_views():
    values = random_values()
    values[values <= GEOMETRY.disparity_at_infinity + 0.5] = np.nan
    y, x = np.nonzero(np.isfinite(values))

    X, Y, Z = triangulate(a_disparity_map(values), a_pair()).points.astype(np.float64).T

    f, (cx, cy), (cx_right, cy_right) = 70.0, GEOMETRY.centre_left, GEOMETRY.centre_right
    np.testing.assert_allclose(f * X / Z + cx, x, atol=1e-4)
    np.testing.assert_allclose(f * Y / Z + cy, y, atol=1e-4)
    x_right = f * (X - GEOMETRY.baseline_m) / Z + cx_right
    np.testing.assert_allclose(x_right, x - values[y, x], atol=1e-4)
    np.testing.assert_allclose(f * Y / Z + cy_right, y, atol=1e-4)


def test_a_disparity_of_one_focal_length_is_one_baseline_away():
    in_front = GEOMETRY.focal_px + GEOMETRY.disparity_at_infinity

    depth = depth_map(a_disparity_map(constant(in_front)), GEOMETRY)

    np.testing.assert_allclose(depth, GEOMETRY.baseline_m, rtol=1e-6)


def test_pixels_at_or_beyond_infinity_are_left_out():
    values = constant(5.0)
    values[3, :10] = GEOMETRY.disparity_at_infinity
    values[4, :10] = GEOMETRY.disparity_at_infinity - 1
    values[5, :10] = np.nan

    cloud = triangulate(a_disparity_map(values), a_pair())

    assert len(cloud) == values.size - 30
    assert (cloud.points[:, 2] > 0).all()


def test_missing_depths_are_nan():
    values = constant(5.0)
    values[2, 3] = np.nan
    values[4, 5] = GEOMETRY.disparity_at_infinity

    depth = depth_map(a_disparity_map(values), GEOMETRY)

    assert set(zip(*np.nonzero(np.isnan(depth)), strict=True)) == {(2, 3), (4, 5)}
    assert depth.dtype == np.float32


def test_points_carry_colour_confidence_and_status_of_their_pixel():
    values = constant(6.0)
    values[::3, ::2] = np.nan
    status = np.where(np.isnan(values), PixelStatus.MISMATCHED, PixelStatus.MATCHED)
    status[1] = PixelStatus.FILLED_OCCLUSION
    confidence = np.where(np.isnan(values), 0, np.random.default_rng(1).random(values.shape))
    pair = a_pair()

    cloud = triangulate(a_disparity_map(values, status=status, confidence=confidence), pair)

    placed = np.isfinite(values)
    np.testing.assert_array_equal(cloud.colours, pair.left[placed])
    np.testing.assert_array_equal(cloud.confidence, confidence[placed].astype(np.float32))
    np.testing.assert_array_equal(cloud.status, status[placed])


def test_depth_sigma_is_the_effect_of_one_sigma_of_disparity():
    values, step = constant(12.0), 1e-2
    nearer, farther = (
        depth_map(a_disparity_map(values + shift), GEOMETRY)[0, 0] for shift in (step, -step)
    )

    sigma = depth_sigma(depth_map(a_disparity_map(values), GEOMETRY), GEOMETRY, step)

    np.testing.assert_allclose(sigma[0, 0], (farther - nearer) / 2, rtol=1e-3)


def test_the_cloud_names_the_error_of_its_depths():
    cloud = Triangulation(disparity_sigma_px=0.25)(a_disparity_map(constant(12.0)), a_pair())

    expected = depth_sigma(cloud.points[:, 2], GEOMETRY, 0.25)
    np.testing.assert_allclose(cloud.depth_sigma_m, expected, rtol=1e-6)


def test_positions_are_in_row_order():
    depth = np.arange(1, HEIGHT * WIDTH + 1, dtype=np.float32).reshape(HEIGHT, WIDTH)

    points = positions(depth, depth > 0, GEOMETRY)

    np.testing.assert_array_equal(points[:, 2], depth.ravel())


@pytest.mark.parametrize("width", [2, 3, 4, 5])
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_smeared_edge_is_removed_and_both_sides_stay(width, turned, mirrored):
    sharp = a_step()
    smeared = blurred_along_rows(sharp, width)
    if mirrored:
        sharp, smeared = sharp[:, ::-1], smeared[:, ::-1]
    if turned:
        sharp, smeared = sharp.T, smeared.T

    flying = flying_pixels(smeared)

    np.testing.assert_array_equal(flying, np.abs(smeared - sharp) > 1e-3)


def test_a_sharp_edge_loses_nothing():
    assert not flying_pixels(a_step()).any()


@pytest.mark.parametrize("slope", [(0.9, 0.0), (0.0, 0.9), (-0.8, 0.7), (0.3, -0.2)])
def test_a_slanted_plane_loses_nothing(slope):
    y, x = np.mgrid[:HEIGHT, :WIDTH]

    plane = 80 + slope[0] * x + slope[1] * y

    assert not flying_pixels(plane.astype(np.float32)).any()


@pytest.mark.parametrize(("sigma_px", "lost"), [(0.1, 0.0), (0.2, 0.01)])
def test_noise_on_a_steep_plane_loses_next_to_nothing(sigma_px, lost):
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    random = np.random.default_rng(3)
    planes = 80 + 0.6 * x - 0.4 * y + random.normal(0, sigma_px, (10, HEIGHT, WIDTH))

    flying = np.array([flying_pixels(plane) for plane in planes])

    assert flying.mean() <= lost  # 0.6 % at 0.2 px: the price of finding smears of 2 px


@pytest.mark.parametrize("thickness", [1, 2, 3])
@pytest.mark.parametrize("turned", [False, True])
def test_a_thin_pole_is_kept(thickness, turned):
    values = constant(6.0)
    values[:, 30 : 30 + thickness] = 20
    values = values.T if turned else values

    assert not flying_pixels(values).any()


def test_a_narrow_strip_of_a_third_depth_is_kept():
    values = a_step(left=30, right=5)
    values[:, 30:34] = 15

    assert not flying_pixels(values).any()


@pytest.mark.parametrize("thickness", [1, 2])
def test_a_thin_pole_in_front_of_an_edge_is_kept(thickness):
    values = a_step(left=20, right=6)
    values[:, 31 : 31 + thickness] = 30

    assert not flying_pixels(values)[:, 31 : 31 + thickness].any()


@pytest.mark.parametrize(("jump", "slope"), [(14, 0.5), (6, 0.9), (6, -0.9)])
def test_a_slanted_surface_that_ends_in_the_air_is_kept(jump, slope):
    values = constant(36.0)
    values[:, 32:] = 36 + jump + slope * np.arange(WIDTH - 32)

    assert not flying_pixels(values).any()


def test_missing_pixels_do_not_fly():
    values = blurred_along_rows(a_step(), 3)
    values[:, 25:40] = np.nan

    assert not flying_pixels(values).any()


def test_flying_pixels_are_kept_only_if_asked():
    smeared = a_disparity_map(blurred_along_rows(a_step(), 3))

    kept = Triangulation().kept_pixels(smeared, GEOMETRY)
    everything = Triangulation(remove_flying_pixels=False).kept_pixels(smeared, GEOMETRY)

    np.testing.assert_array_equal(~kept, flying_pixels(smeared.values))
    assert everything.all()


def test_extrapolated_pixels_are_left_out_unless_included():
    status = np.full((HEIGHT, WIDTH), PixelStatus.MATCHED)
    status[:, :5] = PixelStatus.FILLED_OCCLUSION
    status[:, 5:9] = PixelStatus.FILLED_MISMATCH
    disparity = a_disparity_map(constant(8.0), status=status)

    by_default = Triangulation()(disparity, a_pair())
    with_all = Triangulation(include=("matched", "filled_mismatch", "filled_occlusion"))(
        disparity, a_pair()
    )

    assert len(by_default) == (WIDTH - 5) * HEIGHT
    assert PixelStatus.FILLED_OCCLUSION not in by_default.status
    assert len(with_all) == WIDTH * HEIGHT


def test_far_and_doubtful_pixels_are_left_out_on_request():
    values = a_step(left=20.0, right=6.0)
    confidence = np.ones(values.shape)
    confidence[10:20] = 0.2
    disparity = a_disparity_map(values, confidence=confidence)
    near, far = (GEOMETRY.focal_px * GEOMETRY.baseline_m / (d + 3.5) for d in (20, 6))

    limited = Triangulation(max_depth_m=(near + far) / 2, min_confidence=0.5)
    kept = limited.kept_pixels(disparity, GEOMETRY)

    expected = (values == 20) & (confidence > 0.5)
    np.testing.assert_array_equal(kept, expected)


def test_the_summary_of_what_was_left_out_adds_up():
    values = blurred_along_rows(a_step(left=20.0, right=6.0), 3)
    values[0] = np.nan
    values[1] = GEOMETRY.disparity_at_infinity - 1
    status = np.where(np.isnan(values), PixelStatus.OCCLUDED, PixelStatus.MATCHED)
    status[2] = PixelStatus.FILLED_OCCLUSION
    confidence = np.full(values.shape, 0.9)
    confidence[3] = 0.1
    confidence[np.isnan(values)] = 0
    disparity = a_disparity_map(values, status=status, confidence=confidence)
    every = Triangulation(min_depth_m=0.4, max_depth_m=0.8, min_confidence=0.5)

    kept, removals = every.selection(disparity, GEOMETRY)

    names = ["status", "at infinity", "nearer than min_depth_m", "farther than max_depth_m"]
    assert [removal.filter for removal in removals] == [*names, "confidence", "flying pixels"]
    assert removals[0].of == disparity.valid.sum()
    assert [removal.removed for removal in removals[:2]] == [WIDTH, WIDTH]
    assert all(removal.removed for removal in removals[2:5])
    assert removals[0].of - sum(removal.removed for removal in removals) == kept.sum()
    np.testing.assert_array_equal(kept, every.kept_pixels(disparity, GEOMETRY))


def test_normals_are_fitted_to_the_points_that_are_kept():
    values = blurred_along_rows(a_step(left=9.0, right=6.15), 3)
    disparity = a_disparity_map(values)

    cloud = Triangulation()(disparity, a_pair())

    assert flying_pixels(values).any()
    np.testing.assert_allclose(cloud.normals, np.tile((0, 0, -1), (len(cloud), 1)), atol=1e-5)


def test_nothing_with_a_disparity_gives_an_empty_cloud():
    cloud = Triangulation()(a_disparity_map(constant(np.nan)), a_pair())

    assert len(cloud) == 0
    assert cloud.points.dtype == np.float32


def test_inputs_are_not_changed():
    values = random_values()
    disparity = a_disparity_map(values.copy())

    Triangulation()(disparity, a_pair())

    np.testing.assert_array_equal(disparity.values, values)


def test_a_disparity_of_another_size_is_refused():
    with pytest.raises(ValueError, match=r"disparity is \(47, 64\) but the left image is \(48, 64"):
        Triangulation()(a_disparity_map(constant(5.0)[1:]), a_pair())


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"include": ("occluded",)}, r"include has \['occluded'\]; states with a disparity are"),
        ({"depth_edge_px": 0.0}, "depth_edge_px must be positive, got 0.0 px"),
        ({"min_depth_m": 0.0}, "min_depth_m must be positive, got 0.0 m"),
        (
            {"min_depth_m": 3.0, "max_depth_m": 2.0},
            "min_depth_m 3.0 m must be below max_depth_m 2.0 m",
        ),
        ({"max_depth_m": -1.0}, "max_depth_m must be positive, got -1.0 m"),
        ({"min_confidence": 2.0}, r"min_confidence must be in \[0, 1\], got 2.0"),
        ({"disparity_sigma_px": 0.0}, "disparity_sigma_px must be positive, got 0.0 px"),
    ],
)
def test_impossible_settings_are_refused(setting, message):
    with pytest.raises(ValueError, match=message):
        Triangulation(**setting)
