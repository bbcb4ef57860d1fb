"""Depths and clouds of maps whose distance from the truth is known."""

import numpy as np
import pytest

from calib.pair import RectifiedPair
from calib.rig import RectifiedGeometry
from recon.evaluation.scene import Scene, Truth
from recon.evaluation.space import cloud_measures, depth_measures
from recon.triangulation import Triangulation
from recon.types import DisparityMap, PixelStatus

HEIGHT, WIDTH = 60, 64
FOCAL = 50.0  # one pixel is 2 % of the depth
BASELINE_M = 0.2
AT_INFINITY = -3.0
ROWS, COLUMNS = slice(20, 40), slice(10, 30)
EMPTY = {"median_m": None, "1%": 0.0, "5%": 0.0}


def scene_of(truth, *, visible=None, focal=FOCAL, factor=1, calibrated=True):
    """A scene whose images are `factor` times smaller than its truth of focal length `focal`."""
    height, width = truth.shape[0] // factor, truth.shape[1] // factor
    cx, cy = (width / 2 + 1.3) / factor, (height / 2 - 2.1) / factor
    geometry = RectifiedGeometry(
        (width, height),
        focal / factor,
        (cx, cy),
        (cx - AT_INFINITY / factor, cy),
        BASELINE_M,
    )
    image = np.zeros((height, width, 3), np.uint8)
    return Scene(
        dataset="made",
        name="plane",
        pair=RectifiedPair(image, image, geometry),
        calibrated=calibrated,
        disparities=range(64),
        truth=Truth(truth.astype(np.float32), visible),
    )


def masks_of(scene):
    known = np.isfinite(scene.truth.disparity)
    visible = scene.truth.visible
    return {"all": known} if visible is None else {"all": known, "nonocc": known & visible}


def plane(depth_m=1.0, *, focal=FOCAL, shape=(HEIGHT, WIDTH)):
    """Disparities of a wall in front of the camera: d = f B / Z + d_inf."""
    return np.full(shape, focal * BASELINE_M / depth_m + AT_INFINITY, np.float32)


def matched(values, status=PixelStatus.MATCHED):
    """A map with one status wherever it is known."""
    found = ~np.isnan(values)
    states = np.where(found, status, PixelStatus.MISMATCHED).astype(np.uint8)
    return DisparityMap(values.astype(np.float32), states, found.astype(np.float32))


def depths(values, scene):
    return depth_measures(values, scene, masks_of(scene))


def cloud(values, scene, *settings):
    return cloud_measures(matched(values), scene, masks_of(scene), *settings)


def with_patch(values, patch):
    result = values.copy()
    result[ROWS, COLUMNS] = patch
    return result


def outside_patch():
    return with_patch(np.ones((HEIGHT, WIDTH), bool), False)


@pytest.fixture
def rough_wall():
    """A slanted, rough wall of which one fifth is unknown."""
    rng = np.random.default_rng(20240229)
    y, x = np.indices((HEIGHT, WIDTH))
    values = 8 + 0.05 * x + 0.02 * y + rng.normal(0, 0.1, (HEIGHT, WIDTH))
    values[rng.random((HEIGHT, WIDTH)) < 0.2] = np.nan
    return values


def test_the_truth_itself_has_no_error(rough_wall):
    scene = scene_of(rough_wall, visible=outside_patch())

    of_depths = depths(scene.truth.disparity, scene)
    of_cloud = cloud(scene.truth.disparity, scene, Triangulation(remove_flying_pixels=False))

    perfect = {"median_relative": 0.0, "within_1%": 100.0, "within_5%": 100.0}
    assert of_depths == {"nonocc": perfect, "all": perfect}
    sides = ("accuracy", "completeness")
    expected = {f"{side}_median_m": 0.0 for side in sides} | {"chamfer_%": 0.0}
    expected |= {f"{side}_{share}": 100.0 for side in sides for share in ("1%", "5%")}
    assert of_cloud == expected


@pytest.mark.parametrize("depth_m", [0.3, 20.0])
def test_a_wall_two_percent_too_far_is_two_percent_away(depth_m):
    focal = 2000.0  # so fine a grid that only the distance of the walls counts
    scene = scene_of(plane(depth_m, focal=focal), focal=focal)
    found = plane(1.02 * depth_m, focal=focal)

    of_depths, of_cloud = depths(found, scene)["all"], cloud(found, scene)

    assert of_depths["median_relative"] == pytest.approx(0.02, rel=1e-4)
    assert (of_depths["within_1%"], of_depths["within_5%"]) == (0.0, 100.0)
    for side in ("accuracy", "completeness"):
        assert of_cloud[f"{side}_median_m"] == pytest.approx(0.02 * depth_m, rel=1e-3)
        assert (of_cloud[f"{side}_1%"], of_cloud[f"{side}_5%"]) == (0.0, 100.0)
    # of the depth of the point that is asked: of the wall found, and of the true one
    assert of_cloud["chamfer_%"] == pytest.approx((2 / 1.02 + 2) / 2, rel=1e-3)


def test_depths_are_counted_from_the_disparity_at_infinity():
    scene = scene_of(plane(2.0))
    found = plane(2.0) + 0.1

    # Z = f B / (d - d_inf) with f B / Z* = 5 px
    expected = 1 - 5 / 5.1
    assert depths(found, scene)["all"]["median_relative"] == pytest.approx(expected, rel=1e-4)


def test_a_hole_costs_completeness_and_no_accuracy():
    scene = scene_of(plane())
    found = with_patch(plane(), np.nan)

    of_cloud = cloud(found, scene)

    assert of_cloud["accuracy_1%"] == of_cloud["accuracy_5%"] == 100.0
    # even the outermost pixels of the hole are 2 % from its edge, those behind them 4 %
    hole, middle = 20 * 20 / (HEIGHT * WIDTH), 16 * 16 / (HEIGHT * WIDTH)
    assert of_cloud["completeness_1%"] == pytest.approx(100 * (1 - hole))
    assert of_cloud["completeness_5%"] == pytest.approx(100 * (1 - middle))
    assert of_cloud["completeness_median_m"] == 0.0


def test_a_flying_surface_costs_accuracy_and_no_completeness():
    scene = scene_of(plane(), visible=outside_patch())
    found = with_patch(plane(), plane(0.5)[0, 0])

    of_cloud = cloud(found, scene)

    patch = 20 * 20 / (HEIGHT * WIDTH)
    assert of_cloud["accuracy_1%"] == of_cloud["accuracy_5%"] == pytest.approx(100 * (1 - patch))
    assert of_cloud["completeness_1%"] == 100.0
    assert of_cloud["completeness_median_m"] == of_cloud["accuracy_median_m"] == 0.0
    assert of_cloud["chamfer_%"] == pytest.approx(5 * patch / 2)


def test_nobody_judges_points_where_the_truth_is_unknown():
    scene = scene_of(with_patch(plane(), np.nan))
    found = with_patch(plane(), plane(0.5)[0, 0])

    of_cloud = cloud(found, scene)

    assert of_cloud["accuracy_1%"] == of_cloud["completeness_1%"] == 100.0


def test_one_known_true_pixel_is_enough_to_judge_a_larger_one():
    truth = np.full((HEIGHT, WIDTH), np.nan)
    truth[1::2, 1::2] = plane()[1::2, 1::2]
    scene = scene_of(truth, factor=2)

    of_cloud = cloud(plane()[::2, ::2] / 2, scene)

    assert of_cloud["accuracy_5%"] == 100.0


def test_without_a_mask_all_known_truth_is_asked():
    found = with_patch(plane(), np.nan)

    without, with_mask = (
        cloud(found, scene_of(plane(), visible=visible)) for visible in (None, outside_patch())
    )

    assert without["completeness_1%"] < with_mask["completeness_1%"] == 100.0


def test_depths_of_occluded_pixels_count_in_all_only():
    scene = scene_of(plane(), visible=outside_patch())
    found = with_patch(plane(), plane(1.03)[0, 0])

    regions = depths(found, scene)

    patch = 20 * 20 / (HEIGHT * WIDTH)
    assert regions["nonocc"]["within_1%"] == regions["all"]["within_5%"] == 100.0
    assert regions["all"]["within_1%"] == pytest.approx(100 * (1 - patch))


def test_without_a_mask_of_visible_pixels_there_is_no_such_region():
    scene = scene_of(plane())

    assert set(depths(plane(), scene)) == {"all"}


@pytest.mark.parametrize("disparity", [np.nan, AT_INFINITY, AT_INFINITY - 1])
def test_pixels_without_a_depth_are_not_within(disparity):
    scene = scene_of(plane())
    found = with_patch(plane(), disparity)

    of_depths = depths(found, scene)["all"]

    patch = 20 * 20 / (HEIGHT * WIDTH)
    assert of_depths["within_5%"] == of_depths["within_1%"] == pytest.approx(100 * (1 - patch))
    assert of_depths["median_relative"] == 0.0
    assert cloud(found, scene)["accuracy_5%"] == 100.0


def test_pixels_whose_true_depth_is_infinite_are_not_counted():
    scene = scene_of(with_patch(plane(), AT_INFINITY))

    assert depths(plane(), scene)["all"]["within_1%"] == 100.0


def test_an_empty_region_has_no_figures():
    scene = scene_of(plane(), visible=np.zeros((HEIGHT, WIDTH), bool))

    of_depths = depths(plane(), scene)["nonocc"]

    assert of_depths == {"median_relative": None, "within_1%": None, "within_5%": None}


def test_distances_are_not_known_without_a_calibration():
    scene = scene_of(plane(), calibrated=False)

    assert depths(plane(), scene) is None
    assert cloud(plane(), scene) is None


def test_an_empty_cloud_is_neither_accurate_nor_complete():
    scene = scene_of(plane())
    nothing = np.full((HEIGHT, WIDTH), np.nan)

    of_depths, of_cloud = depths(nothing, scene)["all"], cloud(nothing, scene)

    assert of_depths == {"median_relative": None, "within_1%": 0.0, "within_5%": 0.0}
    sides = ("accuracy", "completeness")
    expected = {f"{side}_{name}": value for side in sides for name, value in EMPTY.items()}
    assert of_cloud == {**expected, "chamfer_%": pytest.approx(5.0)}


def test_a_median_beyond_five_percent_is_not_known():
    scene = scene_of(plane())

    of_cloud = cloud(plane(1.1), scene)

    assert of_cloud["accuracy_median_m"] is None
    assert of_cloud["completeness_median_m"] is None
    assert of_cloud["chamfer_%"] == pytest.approx(5.0)


def test_the_cloud_is_the_one_that_users_get():
    scene = scene_of(plane())
    guessed = matched(plane(1.1), PixelStatus.FILLED_OCCLUSION)
    everything = Triangulation(include=("matched", "filled_occlusion"))

    by_default, with_guesses = (
        cloud_measures(guessed, scene, masks_of(scene), *settings)
        for settings in ((), (everything,))
    )

    assert by_default["accuracy_5%"] == with_guesses["accuracy_5%"] == 0.0
    near = scene_of(plane(1.08))
    assert cloud_measures(guessed, near, masks_of(near))["completeness_5%"] == 0.0
    assert cloud_measures(guessed, near, masks_of(near), everything)["completeness_5%"] == 100.0


@pytest.mark.parametrize("factor", [2, 4])
def test_a_map_smaller_than_the_truth_has_the_same_depths(factor):
    scene = scene_of(plane(), factor=factor)
    small = plane()[::factor, ::factor] / factor

    of_depths, of_cloud = depths(small, scene)["all"], cloud(small, scene)

    assert of_depths["median_relative"] == pytest.approx(0.0, abs=1e-6)
    assert of_depths["within_1%"] == 100.0
    # The middle of a small pixel is a corner of true ones; asked are the truth's pixels in the
    # corner of a small one.
    to_middle, from_corner = np.sqrt(0.5), np.sqrt(0.5) * (factor - 1)
    expected = 100 * (to_middle + from_corner) / 2 / FOCAL
    assert of_cloud["chamfer_%"] == pytest.approx(expected, rel=1e-4)


def test_a_map_as_large_as_the_truth_of_a_smaller_pair_is_compared_as_it_is():
    scene = scene_of(plane(), factor=2)

    assert cloud(plane(), scene)["chamfer_%"] == pytest.approx(0.0, abs=1e-5)


def test_a_map_of_another_size_is_refused():
    scene = scene_of(plane())

    with pytest.raises(
        ValueError, match=r"disparity map is \(60, 63\) but the truth is \(60, 64\)"
    ):
        depths(plane()[:, :-1], scene)
    with pytest.raises(
        ValueError, match=r"disparity map is \(60, 63\) but the truth is \(60, 64\)"
    ):
        cloud(plane()[:, :-1], scene)


def test_measuring_changes_nothing(rough_wall):
    scene = scene_of(rough_wall)
    found = matched(rough_wall + 0.5)
    before = found.values.copy(), scene.truth.disparity.copy()

    depth_measures(found.values, scene, masks_of(scene))
    cloud_measures(found, scene, masks_of(scene))

    np.testing.assert_array_equal(found.values, before[0])
    np.testing.assert_array_equal(scene.truth.disparity, before[1])
