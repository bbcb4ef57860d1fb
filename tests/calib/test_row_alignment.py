"""Rows that a rectification left apart are brought together, and others stay as they are."""

import cv2
import numpy as np
import pytest
from turned import workshop

from calib import RectifiedPair
from calib.epipolar import Matches, match_views
from calib.row_alignment import RowAlignment

WIDTH, HEIGHT = SIZE = (640, 400)


def made(rng, offset, count=500, *, noise_px=0.05, wrong=0.0):
    """Matches whose left rows are `offset(x, y)` below the right ones, x and y in [-1, 1]."""
    right = rng.uniform([0, 0], [WIDTH - 1, HEIGHT - 1], (count, 2))
    x, y = 2 * right[:, 0] / WIDTH - 1, 2 * right[:, 1] / HEIGHT - 1
    left = right + np.stack([rng.uniform(5, 60, count), offset(x, y)], axis=1)
    left[:, 1] += noise_px * rng.standard_normal(count)
    lost = rng.random(count) < wrong
    left[lost, 1] += rng.uniform(-9, 9, lost.sum())
    return Matches(left, right)


def bent(x, y):
    return 0.3 - 0.2 * x + 0.1 * y + 0.25 * x * x - 0.15 * x * y


def over_image(offset):
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return offset(2 * x / WIDTH - 1, 2 * y / HEIGHT - 1)


def with_bent_rows(pair, offset):
    """Move every row of the right view up by the offset, so that it wants to come down by it."""
    height, width, _ = pair.right.shape
    y, x = np.mgrid[:height, :width].astype(np.float32)
    source = y + offset(2 * x / width - 1, 2 * y / height - 1).astype(np.float32)
    right = cv2.remap(pair.right, x, source, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return RectifiedPair(pair.left, right, pair.geometry)


@pytest.mark.parametrize("wrong", [0.0, 0.2])
def test_a_plane_and_a_bend_are_found(rng, wrong):
    for offset in (bent, lambda x, y: 0.4 + 0.3 * x - 0.1 * y):
        shift = RowAlignment().shift(made(rng, offset, wrong=wrong), SIZE)

        assert np.abs(shift - over_image(offset)).max() < 0.1
        assert np.abs(shift - over_image(offset)).mean() < 0.03


def test_a_plane_is_not_bent(rng):
    shift = RowAlignment().shift(made(rng, lambda x, y: 0.4 + 0.3 * x), SIZE)

    assert np.abs(np.diff(shift, 2, axis=0)).max() < 1e-9
    assert np.abs(np.diff(shift, 2, axis=1)).max() < 1e-9


def test_rows_that_agree_stay_and_so_do_those_of_few_matches(rng):
    assert not RowAlignment().shift(made(rng, lambda x, _: 0 * x), SIZE).any()
    assert not RowAlignment().shift(made(rng, bent, count=80), SIZE).any()
    assert not RowAlignment().shift(made(rng, bent, count=0), SIZE).any()


def test_rows_that_are_far_apart_are_not_taken_for_a_remainder(rng):
    def steep(x, _):
        return 2 * x

    assert RowAlignment().shift(made(rng, steep), SIZE).any()
    assert not RowAlignment(largest_shift_px=1.5).shift(made(rng, steep), SIZE).any()
    assert not RowAlignment().shift(made(rng, lambda x, _: 0 * x + 8), SIZE).any()


def test_the_rows_of_photographs_come_together():
    apart = with_bent_rows(workshop(), bent)

    aligned = RowAlignment()(apart)

    def residual(pair):
        return np.median(np.abs(match_views(pair.left, pair.right).offsets))

    assert residual(apart) > 0.2
    assert residual(aligned) < 0.06
    assert aligned.left is apart.left
    assert aligned.geometry == apart.geometry
    assert np.abs(aligned.right.astype(int) - workshop().right).mean() < 2


def test_a_good_pair_is_left_alone():
    pair = workshop()

    assert RowAlignment()(pair) is pair


@pytest.mark.parametrize("wrong", [{"least_gain": 1.0}, {"largest_shift_px": 0.0}])
def test_settings_out_of_range_are_named(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        RowAlignment(**wrong)
