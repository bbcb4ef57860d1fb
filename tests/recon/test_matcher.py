"""The stages together, on scenes of exact truth."""

import subprocess
import sys
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest
import torch
from turned import workshop

from calib.pair import RectifiedPair
from calib.rig import RectifiedGeometry
from calib.row_alignment import RowAlignment
from recon.aggregation import AGGREGATIONS, BilateralAggregation
from recon.filling import BackgroundFilling, SurfaceFilling
from recon.matcher import Matcher
from recon.matching_cost import Census, LearnedCost, SumOfAbsoluteDifferences
from recon.networks import Architecture, FeatureNetwork, save_features
from recon.optimisation import SemiGlobal
from recon.refinement import DomainTransform, Median
from recon.strips import GRID_PX
from recon.types import CostVolume, DisparityMap, PixelStatus

HEIGHT, WIDTH = 60, 100
NEAR, FAR = 9, 3
SQUARE = (slice(20, 45), slice(40, 70))
SEARCHED = range(14)
SEARCHED_OF_WORKSHOP = range(48)

MATCHER = Matcher(Census(), BilateralAggregation(radius_px=4), refinements=(DomainTransform(),))


def pair_of(left, right):
    height, width, _ = left.shape
    geometry = RectifiedGeometry((width, height), 100.0, (50.0, 30.0), (50.0, 30.0), 0.1)
    return RectifiedPair(*((255 * i).round().byte().numpy() for i in (left, right)), geometry)


@pytest.fixture
def truth():
    values = np.full((HEIGHT, WIDTH), float(FAR))
    values[SQUARE] = NEAR
    return values


@pytest.fixture
def pair(texture):
    """A square of one texture in front of a wall of another."""
    wall, square = texture(HEIGHT, WIDTH + FAR), texture(HEIGHT, WIDTH) * 0.5
    left, right = wall[:, :WIDTH].clone(), wall[:, FAR:].clone()
    left[SQUARE] = square[SQUARE]
    rows, columns = SQUARE
    right[rows, columns.start - NEAR : columns.stop - NEAR] = square[SQUARE]
    return pair_of(left, right)


def assert_same(one, other, **tolerance):
    assert np.array_equal(one.status, other.status)
    for name in ("values", "confidence"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), **tolerance)


def test_a_scene_is_matched_within_half_a_pixel_where_both_cameras_see_it(pair, truth):
    by_rows = replace(MATCHER, filling=BackgroundFilling())  # colours of noise lead nowhere
    disparity = by_rows(pair, SEARCHED)

    hidden = np.zeros((HEIGHT, WIDTH), bool)
    hidden[SQUARE[0], SQUARE[1].start - (NEAR - FAR) : SQUARE[1].start] = True
    hidden[:, :FAR] = True
    good = np.abs(disparity.values - truth) < 0.5
    assert good[~hidden].mean() > 0.99
    assert good[hidden].mean() > 0.8


def test_rows_are_aligned_first_if_asked_for():
    pair = workshop()
    y, x = np.mgrid[: pair.right.shape[0], : pair.right.shape[1]].astype(np.float32)
    lower = cv2.remap(pair.right, x, y + 0.7, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    apart = RectifiedPair(pair.left, lower, pair.geometry)
    aligning = replace(MATCHER, row_alignment=RowAlignment())
    seen = {}

    straight = MATCHER(pair, SEARCHED_OF_WORKSHOP).values
    off = np.abs(MATCHER(apart, SEARCHED_OF_WORKSHOP).values - straight) > 1
    aligned = aligning(apart, SEARCHED_OF_WORKSHOP, observe=seen.__setitem__).values

    assert (np.abs(aligned - straight) > 1).mean() < 0.5 * off.mean()
    assert np.array_equal(seen["row_alignment"].left, pair.left)
    assert not np.array_equal(seen["row_alignment"].right, lower)


def test_every_pixel_has_a_disparity_and_says_where_from(pair):
    disparity = MATCHER(pair, SEARCHED)

    assert np.isfinite(disparity.values).all()
    present = {PixelStatus.MATCHED, PixelStatus.FILLED_MISMATCH, PixelStatus.FILLED_OCCLUSION}
    assert set(np.unique(disparity.status)) <= present
    assert disparity.values.dtype == disparity.confidence.dtype == np.float32
    assert disparity.status.dtype == np.uint8
    assert (disparity.confidence >= 0).all()
    assert (disparity.confidence <= 1).all()


def test_without_filling_occluded_pixels_have_no_disparity(pair):
    disparity = replace(MATCHER, filling=None)(pair, SEARCHED)

    band = disparity.status[25:40, SQUARE[1].start - (NEAR - FAR) : SQUARE[1].start]
    assert (band != PixelStatus.MATCHED).mean() > 0.8
    assert np.isnan(disparity.values[disparity.status != PixelStatus.MATCHED]).all()


@pytest.mark.parametrize("offset", [-20, 5])
def test_a_range_may_start_anywhere(pair, truth, offset):
    columns = torch.arange(WIDTH) + offset
    right = np.zeros_like(pair.right)
    inside = ((columns >= 0) & (columns < WIDTH)).numpy()
    right[:, inside] = pair.right[:, columns[inside]]

    disparity = MATCHER(RectifiedPair(pair.left, right, pair.geometry), range(offset, offset + 14))

    seen = slice(30, 75)
    good = np.abs(disparity.values - truth - offset)[:, seen] < 0.5
    assert good[:18].mean() > 0.99
    assert good[25:40, 15:35].mean() > 0.99


class TestStrips:
    @pytest.fixture
    def tall(self, texture):
        image = texture(150, 40)
        return pair_of(image, image.roll(-4, dims=1))

    @pytest.mark.parametrize("aggregation", sorted(AGGREGATIONS))
    @pytest.mark.parametrize("cost", [Census(), SumOfAbsoluteDifferences()], ids=["census", "sad"])
    def test_strips_give_the_whole(self, cost, aggregation, tall):
        matcher = Matcher(cost, AGGREGATIONS[aggregation](), refinements=(Median(),))

        whole = matcher(tall, range(8))
        strips = replace(matcher, volume_limit_mb=0.06)(tall, range(8))

        assert_same(strips, whole, rtol=1e-5, atol=1e-5)

    @pytest.mark.parametrize("channels", [(8,), (8, 8, 8)], ids=["plain", "pooled"])
    def test_strips_of_a_network_give_the_whole(self, channels, tall, tmp_path):
        with torch.random.fork_rng():
            torch.manual_seed(0)
            network = FeatureNetwork(Architecture(channels, 1, 8)).eval()
        save_features(tmp_path / "untrained.safetensors", network, about={})
        cost = LearnedCost(str(tmp_path / "untrained.safetensors"))
        matcher = Matcher(cost, AGGREGATIONS["box"](), filling=None)

        whole = matcher(tall, range(8))
        strips = replace(matcher, volume_limit_mb=0.05)(tall, range(8))

        # Convolutions of another height add in another order: costs near a tie may swap.
        same = np.isclose(strips.values, whole.values, atol=1e-3, equal_nan=True)
        assert same.mean() > 0.999
        assert np.abs(strips.confidence - whole.confidence)[same].max() < 1e-3

    def test_semi_global_strips_give_nearly_the_whole(self, tall):
        """Paths begin 64 rows outside a strip: by then they have forgotten where."""
        matcher = Matcher(Census(), AGGREGATIONS["none"](), optimisation=SemiGlobal())

        rows = []

        whole = matcher(tall, range(8))
        strips = replace(matcher, volume_limit_mb=0.06)(
            tall,
            range(8),
            observe=lambda stage, result: (
                rows.append(len(result.cost)) if stage == "aggregation" else None
            ),
        )

        assert np.isclose(strips.values, whole.values, atol=1e-3).mean() > 0.999
        assert len(rows) > 1
        assert sum(rows) == len(tall.left)  # observers see every row once

    def test_volumes_keep_the_limit(self, tall):
        limit_mb = 0.06
        seen = []

        def observe(stage, result):
            if isinstance(result, CostVolume):
                seen.append((stage, result.cost.numel() * 4 / 1e6))

        Matcher(Census(), BilateralAggregation(radius_px=3), volume_limit_mb=limit_mb)(
            tall, range(8), observe=observe
        )

        assert len(seen) > 4
        assert max(size for _, size in seen) <= limit_mb

    def test_a_limit_too_small_is_passed_by_little(self, tall):
        matcher = Matcher(Census(), BilateralAggregation(), volume_limit_mb=1e-6)
        rows = []

        def observe(stage, result):
            if stage == "aggregation":
                rows.append(len(result.cost))

        matcher(tall, range(8), observe=observe)

        assert sum(rows) == 150
        assert max(rows) == GRID_PX


class TestObservers:
    def test_they_see_every_stage_in_order(self, pair):
        seen = {}

        result = replace(MATCHER, min_segment_px=5)(pair, SEARCHED, observe=seen.__setitem__)

        assert list(seen) == [
            "matching_cost",
            "aggregation",
            "disparity/left",
            "disparity/right",
            "left_right_check",
            "small_segments",
            "filling",
            "refinement/DomainTransform",
        ]
        assert all(isinstance(seen[stage], CostVolume) for stage in list(seen)[:2])
        assert all(isinstance(seen[stage], DisparityMap) for stage in list(seen)[2:])
        assert np.array_equal(seen["refinement/DomainTransform"].values.numpy(), result.values)

    def test_they_change_no_value(self, pair):
        seen = {}

        watched = MATCHER(pair, SEARCHED, observe=seen.__setitem__)
        alone = MATCHER(pair, SEARCHED)

        assert_same(watched, alone, rtol=0, atol=0)

    def test_later_stages_leave_earlier_results_alone(self, pair):
        copies, seen = {}, {}

        def observe(stage, result):
            seen[stage] = result
            copies[stage] = (result.cost if "cost" in dir(result) else result.values).clone()

        MATCHER(pair, SEARCHED, observe=observe)

        for stage, result in seen.items():
            values = result.cost if "cost" in dir(result) else result.values
            assert torch.equal(values.nan_to_num(), copies[stage].nan_to_num()), stage

    def test_rejected_pixels_are_filled_between_check_and_filling(self, pair):
        seen = {}
        MATCHER(pair, SEARCHED, observe=seen.__setitem__)

        stages = ["disparity/left", "left_right_check", "filling"]
        counts = [int(seen[stage].valid.sum()) for stage in stages]
        drops, rises = (after - before for before, after in pairwise(counts))
        assert drops < 0 < rises


@pytest.mark.parametrize("colour", [0.0, 1.0])
@pytest.mark.parametrize("aggregation", sorted(AGGREGATIONS))
def test_images_without_texture_do_no_harm(colour, aggregation):
    plain = torch.full((20, 30, 3), colour)
    matcher = Matcher(
        Census(), AGGREGATIONS[aggregation](), min_segment_px=9, refinements=(DomainTransform(),)
    )

    disparity = matcher(pair_of(plain, plain), range(2, 9))

    assert np.isfinite(disparity.values).all()
    assert np.isfinite(disparity.confidence).all()


def test_a_range_that_sees_nothing_leaves_everything_outside(pair):
    disparity = MATCHER(pair, range(200, 210))

    assert (disparity.status == PixelStatus.OUTSIDE).all()
    assert np.isnan(disparity.values).all()


def test_inputs_may_be_read_only_and_stay_as_they_are(pair):
    left = pair.left.copy()
    for image in (pair.left, pair.right):
        image.setflags(write=False)

    MATCHER(pair, SEARCHED)

    assert np.array_equal(pair.left, left)


@pytest.mark.parametrize("disparities", [range(0), range(0, 10, 2), range(5, 0, -1)], ids=str)
def test_a_range_with_gaps_or_nothing_is_refused(pair, disparities):
    with pytest.raises(ValueError, match="disparities must be consecutive, at least one"):
        MATCHER(pair, disparities)


@pytest.mark.parametrize(
    ("setting", "value", "message"),
    [
        ("left_right_tolerance_px", -1.0, "left_right_tolerance_px must not be negative, got -1"),
        ("min_segment_px", -2, "min_segment_px must not be negative, got -2"),
        ("volume_limit_mb", 0, "volume_limit_mb must be positive, got 0"),
    ],
)
def test_settings_that_cannot_be_are_refused(setting, value, message):
    with pytest.raises(ValueError, match=message):
        replace(MATCHER, **{setting: value})


def test_the_whole_configuration_is_printed():
    text = repr(MATCHER)

    assert "Census(rows_px=7, columns_px=9)" in text
    assert repr(SurfaceFilling()) in text
    assert eval(text, {**globals(), **vars(sys.modules["recon.optimisation"])}) == MATCHER


@pytest.mark.slow
def test_importing_the_matcher_loads_no_viewer_and_no_mesh_library():
    code = "import sys, recon.matcher;print(*{'rerun', 'open3d', 'trimesh'} & set(sys.modules))"

    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert done.stdout.strip() == ""
