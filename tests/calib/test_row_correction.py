"""Cameras that were turned are turned back."""

from dataclasses import replace

import numpy as np
import pytest
from turned import as_raw, rotation, with_right_turned, workshop

from calib import Rectifier
from calib.epipolar import Matches, match_views
from calib.row_correction import (
    RowCorrection,
    corrected_pair,
    corrected_rig,
    estimate_row_correction,
)

GEOMETRY = workshop().geometry


def made(rng, count=400, *, turn=(0, 0, 0), height_m=0.0, noise_px=0.1, wrong=0.0):
    """Matches of points in space, seen by a right camera that was turned and stands higher."""
    points = rng.uniform([-1.5, -1, 2], [1.5, 1, 8], (count, 3))
    f, centre = GEOMETRY.focal_px, np.array(GEOMETRY.centre_left)
    seen = (points - [GEOMETRY.baseline_m, height_m, 0]) @ rotation(*turn).T
    left, right = (f * p[:, :2] / p[:, 2:] + centre for p in (points, seen))
    right = right + noise_px * rng.standard_normal(right.shape)
    lost = rng.random(count) < wrong
    right[lost, 1] += rng.uniform(-9, 9, lost.sum())
    return Matches(left, right)


class TestEstimate:
    @pytest.mark.parametrize("turn", [(0.02, 0, 0), (0, 0, -0.015), (-0.008, 0, 0.03)])
    def test_pitch_and_roll_are_found(self, turn, rng):
        found = estimate_row_correction(made(rng, turn=turn), GEOMETRY)

        # What turns the camera back is the inverse.
        assert found.pitch == pytest.approx(-turn[0], abs=2e-4)
        assert found.roll == pytest.approx(-turn[2], abs=5e-4)
        assert found.baseline_roll == 0
        assert found.before_px > 1
        assert found.after_px < 0.12

    def test_wrong_matches_hardly_matter(self, rng):
        found = estimate_row_correction(made(rng, turn=(0.02, 0, 0), wrong=0.2), GEOMETRY)

        assert found.pitch == pytest.approx(-0.02, abs=3e-4)

    def test_a_camera_that_stands_higher_is_found_if_the_matches_ask_for_it(self, rng):
        height = 0.006
        found = estimate_row_correction(made(rng, turn=(0.01, 0, 0), height_m=height), GEOMETRY)

        assert abs(found.baseline_roll) == pytest.approx(height / GEOMETRY.baseline_m, rel=0.05)
        assert found.after_px < 0.12

    def test_the_yaw_is_not_touched(self, rng):
        left, right = estimate_row_correction(made(rng, turn=(0.01, 0.02, 0)), GEOMETRY).rotations

        turned = right @ left.T
        assert turned[0, 2] == pytest.approx(0, abs=1e-4)

    def test_a_good_pair_is_left_as_it_is(self, rng):
        found = estimate_row_correction(made(rng), GEOMETRY)

        assert not found.changes
        assert found.before_px == found.after_px == pytest.approx(0.08, abs=0.01)
        for rotation_of_view in found.rotations:
            assert np.array_equal(rotation_of_view, np.eye(3))

    def test_noise_is_not_fitted(self, rng):
        """Half of the matches cannot tell the other half anything."""
        found = estimate_row_correction(made(rng, count=44, noise_px=1.5), GEOMETRY)

        assert not found.changes

    def test_a_gain_of_hundredths_of_a_pixel_is_not_worth_a_change(self, rng):
        turn = (0.03 / GEOMETRY.focal_px, 0, 0)

        found = estimate_row_correction(made(rng, turn=turn, noise_px=0.003), GEOMETRY)

        assert found.before_px == pytest.approx(0.03, abs=0.003)
        assert not found.changes

    def test_a_few_matches_change_nothing(self, rng):
        assert not estimate_row_correction(made(rng, 30, turn=(0.02, 0, 0)), GEOMETRY).changes
        none = Matches(np.zeros((0, 2)), np.zeros((0, 2)))
        assert estimate_row_correction(none, GEOMETRY) == RowCorrection()

    def test_a_turn_that_is_no_drift_is_refused(self, rng):
        with pytest.raises(ValueError, match=r"turn of 11\.\d degrees, which is no drift"):
            estimate_row_correction(made(rng, turn=(0, 0, 0.2)), GEOMETRY)


class TestCorrectedPair:
    def test_rows_of_a_turned_view_agree_again(self):
        pair = with_right_turned(workshop(), 0.015, 0, -0.01)
        found = estimate_row_correction(match_views(pair.left, pair.right), pair.geometry)

        corrected = corrected_pair(pair, found)

        again = match_views(corrected.left, corrected.right)
        assert found.pitch == pytest.approx(-0.015, abs=3e-4)
        assert found.roll == pytest.approx(0.01, abs=1e-3)
        assert found.before_px > 4
        assert np.abs(again.offsets).mean() == pytest.approx(found.after_px, abs=0.1)
        assert np.abs(again.offsets).mean() < 0.25
        assert corrected.geometry == pair.geometry
        assert np.array_equal(corrected.left, pair.left)

    def test_both_views_are_turned_with_the_baseline(self):
        correction = RowCorrection(baseline_roll=0.05)

        corrected = corrected_pair(workshop(), correction)

        assert not np.array_equal(corrected.left, workshop().left)
        again = match_views(corrected.left, corrected.right)
        expected = 0.05 * np.median(match_views(workshop().left, workshop().right).disparities)
        assert abs(np.median(again.offsets)) == pytest.approx(expected, rel=0.1)


class TestCorrectedRig:
    @pytest.mark.parametrize("common", [(0, 0, 0), (0.03, -0.04, 0.05)])
    def test_the_pose_that_the_camera_really_has_is_found(self, common):
        turn = (0.015, 0.0, -0.01)
        pair = as_raw(workshop(), turn=turn, common=common)
        rectifier = Rectifier(pair.calibration)
        rectified = rectifier(pair)
        matches = match_views(rectified.left, rectified.right)

        rig = corrected_rig(rectifier, estimate_row_correction(matches, rectified.geometry))

        error = rig.right_from_left.R @ rotation(*turn).T
        assert np.abs(error - np.eye(3)).max() < 2e-3
        assert rig.baseline_m == pytest.approx(pair.calibration.baseline_m)
        again = Rectifier(rig)(replace(pair, calibration=rig))
        assert np.abs(match_views(again.left, again.right).offsets).mean() < 0.2
        assert np.abs(matches.offsets).mean() > 3

    def test_no_correction_is_the_same_rig(self):
        rig = as_raw(workshop(), believed=(0.01, 0.02, 0.03)).calibration

        same = corrected_rig(Rectifier(rig), RowCorrection())

        np.testing.assert_allclose(same.right_from_left.R, rig.right_from_left.R, atol=1e-12)
        np.testing.assert_allclose(same.right_from_left.t, rig.right_from_left.t, atol=1e-12)
