"""The range that is searched when nobody says."""

from dataclasses import replace

import numpy as np
import pytest
from rendered import still_life

from calib.pair import RectifiedPair
from recon.disparity_range import check_range, estimate_range


class TestCheck:
    @pytest.mark.parametrize("disparities", [range(1), range(100), range(-99, 0), range(60, 99)])
    def test_a_range_that_fits_is_returned(self, disparities):
        assert check_range(disparities, 100) is disparities

    @pytest.mark.parametrize("disparities", [range(0), range(9, 3)])
    def test_an_empty_range_is_refused(self, disparities):
        with pytest.raises(ValueError, match=r"range is empty: .*maximum must lie above"):
            check_range(disparities, 100)

    @pytest.mark.parametrize("disparities", [range(101), range(-100, 5), range(300, 310)])
    def test_a_range_wider_than_the_image_is_refused(self, disparities):
        with pytest.raises(ValueError, match="do not fit images that are 100 px wide"):
            check_range(disparities, 100)


class TestEstimate:
    @pytest.mark.parametrize(("left", "right"), [(0, 0), (20, 0), (0, 20), (40, 0), (0, 40)])
    def test_it_holds_the_truth_wherever_infinity_lies(self, left, right):
        scene = still_life().shifted(left, right)

        searched = estimate_range(scene.pair)

        truth = scene.disparity[scene.visible]
        low, high = np.quantile(truth, [0.002, 0.998])
        assert searched[0] <= low
        assert high <= searched[-1]
        assert len(searched) < 2.2 * (truth.max() - truth.min()) + 8

    def test_it_holds_disparities_of_a_third_of_the_width(self, smooth_texture):
        view = (255 * smooth_texture(60, 340)).round().byte().numpy()
        geometry = replace(still_life().pair.geometry, size=(240, 60))

        searched = estimate_range(
            RectifiedPair(view[:, :240].copy(), view[:, 80:320].copy(), geometry)
        )

        assert 80 in searched
        assert len(searched) < 20

    def test_a_large_pair_is_matched_small(self, smooth_texture):
        view = (255 * smooth_texture(150, 1040)).round().byte().numpy()
        geometry = replace(still_life().pair.geometry, size=(1000, 150))

        searched = estimate_range(
            RectifiedPair(view[:, :1000].copy(), view[:, 40:].copy(), geometry)
        )

        assert 40 in searched
        assert len(searched) < 50

    def test_nothing_lies_behind_infinity(self, smooth_texture):
        view = (255 * smooth_texture(60, 200)).round().byte().numpy()

        searched = estimate_range(
            RectifiedPair(view, view, replace(still_life().pair.geometry, size=(200, 60)))
        )

        assert searched[0] == 0

    @pytest.mark.parametrize("kind", ["flat", "ramp", "noise"])
    def test_views_without_common_texture_are_refused(self, kind):
        chance = np.random.default_rng(0)
        shape = (100, 200, 3)
        ramp = np.broadcast_to(np.linspace(0, 255, 200).astype(np.uint8)[:, None], shape).copy()
        flat = np.full(shape, 128, np.uint8)
        noise = [chance.integers(0, 256, shape, dtype=np.uint8) for _ in range(2)]
        views = {"flat": (flat, flat), "ramp": (ramp, ramp), "noise": noise}[kind]

        with pytest.raises(ValueError, match=r"cannot estimate .*--min-disparity and --max-disp"):
            estimate_range(RectifiedPair(*views, still_life().pair.geometry))
