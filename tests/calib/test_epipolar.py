"""Points that both views show, and how far from each other's row they lie."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from turned import warped, with_right_turned, workshop

from calib.epipolar import (
    LEAST_MATCHES,
    Matches,
    looks_mirrored,
    match_views,
    vertical_residual,
)


def residual(left, right, **how):
    return vertical_residual(match_views(left, right), **how)


def moved(image, right=0.0, down=0.0):
    return warped(image, np.array([[1, 0, right], [0, 1, down], [0, 0, 1.0]]))


class TestMatchViews:
    def test_an_assertion_of_the_library_leaves_the_matches_of_another_search(self, monkeypatch):
        views = workshop().left, workshop().right
        usual, search = match_views(*views), cv2.findFundamentalMat

        def failing(left, right, method, *settings):
            if method == cv2.USAC_MAGSAC:
                raise cv2.error("(-215:Assertion failed) !model.empty()")
            return search(left, right, method, *settings)

        monkeypatch.setattr(cv2, "findFundamentalMat", failing)

        assert len(match_views(*views)) > 0.9 * len(usual)

    def test_the_rows_of_a_drawn_pair_agree_to_a_tenth_of_a_pixel(self):
        matches = match_views(workshop().left, workshop().right)

        assert len(matches) > 300
        assert np.abs(matches.offsets).mean() < 0.1

    @pytest.mark.parametrize("down", [-40.0, -12.3, 0.4, 25.0])
    def test_a_shift_is_found_wherever_it_leads(self, down):
        found = residual(workshop().left, moved(workshop().right, down=down))

        assert found.count > 250
        assert found.median_px == pytest.approx(-down, abs=0.05)
        assert found.mean_absolute_px == pytest.approx(abs(down), abs=0.1)

    def test_light_and_contrast_do_not_matter(self):
        dark = (20 + 0.3 * workshop().right).astype(np.uint8)

        found = residual(workshop().left, dark)

        assert found.count > 200
        assert found.mean_absolute_px < 0.15

    def test_what_moved_between_the_photographs_is_left_out(self):
        right = workshop().right.copy()
        right[100:180, 100:220] = workshop().right[130:210, 100:220]

        found = residual(workshop().left, right)

        assert found.count > 300
        assert found.mean_absolute_px < 0.1
        assert found.p95_px < 0.5

    def test_large_pictures_are_searched_small_and_measured_at_full_size(self):
        left, right = (
            cv2.resize(image, None, fx=4, fy=4, interpolation=cv2.INTER_CUBIC)
            for image in (workshop().left, moved(workshop().right, down=2.3))
        )

        found = residual(left, right)

        assert found.count > 200
        assert found.median_px == pytest.approx(-9.2, abs=0.1)
        assert found.p95_px - found.mean_absolute_px < 0.5

    def test_the_same_pictures_give_the_same_matches(self):
        once, again = (match_views(workshop().left, workshop().right) for _ in range(2))

        assert np.array_equal(once.left, again.left)
        assert np.array_equal(once.right, again.right)

    def test_the_pictures_are_left_alone(self):
        left, right = workshop().left.copy(), workshop().right.copy()

        match_views(left, right)

        assert np.array_equal(left, workshop().left)
        assert np.array_equal(right, workshop().right)

    @pytest.mark.parametrize("other", ["empty", "noise"])
    def test_pictures_that_share_nothing_hardly_match(self, other, rng):
        pictures = {
            "empty": np.full_like(workshop().right, 128),
            "noise": rng.integers(0, 256, workshop().right.shape, dtype=np.uint8),
        }

        found = residual(workshop().left, pictures[other])

        assert found.count < LEAST_MATCHES
        assert not found.reliable

    def test_two_lists_of_different_lengths_are_refused(self):
        with pytest.raises(ValueError, match=r"two arrays \(N, 2\), got \(3, 2\) and \(4, 2\)"):
            Matches(np.zeros((3, 2)), np.zeros((4, 2)))


class TestVerticalResidual:
    def made(self, offsets, disparities):
        right = np.random.default_rng(0).uniform(100, 200, (len(offsets), 2))
        return Matches(right + np.column_stack([disparities, offsets]), right)

    def test_the_figures_are_those_of_left_minus_right(self):
        found = vertical_residual(self.made([-1.0, -1, -1, 3, -1], [5.0] * 5))

        assert found.count == 5
        assert found.median_px == pytest.approx(-1)
        assert found.mean_absolute_px == pytest.approx(7 / 5)
        assert found.p95_px == pytest.approx(2.6)

    def test_what_lies_behind_infinity_is_counted_in_both_orders(self):
        found = vertical_residual(
            self.made([0.0] * 4, [-5.0, -13, -20, 30]), disparity_at_infinity=-10
        )

        assert found.behind_infinity == 0.5  # -13 and -20
        assert found.swapped_behind_infinity == 0.25  # -30
        assert not found.swapped_fits_better

    def test_infinity_itself_is_not_behind_infinity(self):
        found = vertical_residual(self.made([0.0] * 3, [-1.5, 0, 1.5]))

        assert found.behind_infinity == found.swapped_behind_infinity == 0

    def test_swapped_views_are_recognised(self):
        right_order, swapped = (
            residual(*views)
            for views in ((workshop().left, workshop().right), (workshop().right, workshop().left))
        )

        assert right_order.behind_infinity == 0
        assert not right_order.swapped_fits_better
        assert swapped.behind_infinity > 0.95
        assert swapped.swapped_fits_better

    def test_a_view_upside_down_is_recognised(self):
        turned = np.ascontiguousarray(workshop().right[::-1, ::-1])

        assert residual(workshop().left, turned).upside_down
        assert not residual(workshop().left, workshop().right).upside_down

    def test_no_matches_are_no_figures(self):
        found = vertical_residual(Matches(np.zeros((0, 2)), np.zeros((0, 2))))

        assert found.count == 0
        assert not found.reliable
        assert not found.swapped_fits_better

    def test_a_few_matches_are_not_relied_on(self):
        good = residual(workshop().left, workshop().right)

        assert good.reliable
        assert not replace(good, count=LEAST_MATCHES - 1).reliable


def test_a_mirrored_view_is_recognised():
    left, right = workshop().left, workshop().right
    mirrored = np.ascontiguousarray(right[:, ::-1])
    count = len(match_views(left, mirrored))

    assert count < LEAST_MATCHES
    assert looks_mirrored(left, mirrored, count)
    assert not looks_mirrored(left, right, len(match_views(left, right)))
    assert not looks_mirrored(left, np.full_like(left, 128), 0)


def test_a_turned_camera_leaves_its_mark_in_the_rows():
    pair = with_right_turned(workshop(), 0.01, 0, 0)

    found = residual(pair.left, pair.right)

    assert found.median_px == pytest.approx(0.01 * pair.geometry.focal_px, rel=0.1)
