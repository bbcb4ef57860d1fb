"""Scenes of exact truth: which pixels does the other view confirm, and why not the others?"""

import pytest
import torch

from recon.consistency import left_right_check, reject_small_segments
from recon.types import DisparityMap, PixelStatus

HEIGHT, WIDTH = 30, 80
NEAR, FAR = 12, 4
ROWS, COLUMNS = slice(8, 22), slice(40, 60)
SEARCHED = range(16)


def matched(values):
    """A map without gaps, NaN being outside."""
    outside = values.isnan()
    status = torch.full(values.shape, int(PixelStatus.MATCHED), dtype=torch.uint8)
    return DisparityMap(
        values,
        status.masked_fill(outside, int(PixelStatus.OUTSIDE)),
        torch.ones_like(values).masked_fill(outside, 0.0),
    )


@pytest.fixture
def of_left():
    """A square in front of a wall; where the right view cannot see the wall, a guess."""
    values = torch.full((HEIGHT, WIDTH), float(FAR))
    values[ROWS, COLUMNS] = NEAR
    return matched(values)


@pytest.fixture
def of_right():
    values = torch.full((HEIGHT, WIDTH), float(FAR))
    values[ROWS, COLUMNS.start - NEAR : COLUMNS.stop - NEAR] = NEAR
    return matched(values)


def check(of_left, of_right, tolerance_px=0.5):
    return left_right_check(of_left, of_right, tolerance_px=tolerance_px, disparities=SEARCHED)


def test_exactly_the_band_left_of_the_square_is_occluded(of_left, of_right):
    result = check(of_left, of_right)

    expected = torch.full((HEIGHT, WIDTH), int(PixelStatus.MATCHED), dtype=torch.uint8)
    # A wall pixel x is hidden if its place in the right view, x - FAR, lies behind the square.
    expected[ROWS, COLUMNS.start - (NEAR - FAR) : COLUMNS.start] = int(PixelStatus.OCCLUDED)
    expected[:, :FAR] = int(PixelStatus.OCCLUDED)
    assert torch.equal(result.status, expected)


def test_a_wrong_match_of_a_visible_point_is_mismatched(of_left, of_right):
    values = of_left.values.clone()
    values[3, 30:34] = 9.0

    result = check(matched(values), of_right)

    assert (result.status[3, 30:34] == int(PixelStatus.MISMATCHED)).all()
    assert (result.status == int(PixelStatus.MISMATCHED)).sum() == 4


def test_a_match_beyond_the_border_is_occluded(of_left, of_right):
    """The right view shows the wall at column -1 nowhere."""
    result = check(of_left, of_right)

    assert (result.status[:, :FAR] == int(PixelStatus.OCCLUDED)).all()
    assert (result.status[:, FAR] == int(PixelStatus.MATCHED)).all()


def test_rejected_pixels_have_neither_value_nor_confidence(of_left, of_right):
    result = check(of_left, of_right)

    rejected = result.status != int(PixelStatus.MATCHED)
    assert result.values[rejected].isnan().all()
    assert not result.confidence[rejected].any()
    assert torch.equal(result.values[~rejected], of_left.values[~rejected])


def test_pixels_outside_stay_outside(of_right):
    values = torch.full((HEIGHT, WIDTH), float("nan"))

    result = check(matched(values), of_right)

    assert (result.status == int(PixelStatus.OUTSIDE)).all()


@pytest.mark.parametrize(("tolerance_px", "kept"), [(0.5, False), (0.75, True)])
def test_the_tolerance_is_the_largest_difference_kept(of_left, of_right, tolerance_px, kept):
    off = matched(of_left.values + 0.75)

    result = check(off, of_right, tolerance_px)

    assert bool((result.status[3, 20:] == int(PixelStatus.MATCHED)).all()) == kept


def test_negative_disparities_are_checked_alike(of_left, of_right):
    offset = 10
    result = left_right_check(
        matched(of_left.values - offset),
        matched(of_right.values.roll(offset, 1) - offset),
        tolerance_px=0.5,
        disparities=range(-10, 6),
    )

    band = slice(COLUMNS.start - (NEAR - FAR), COLUMNS.start)
    assert (result.status[ROWS, band] == int(PixelStatus.OCCLUDED)).all()
    assert (result.status[ROWS, COLUMNS] == int(PixelStatus.MATCHED)).all()


def test_small_islands_are_rejected_and_large_ones_stay(of_left):
    values = of_left.values.clone()
    values[2, 5:8] = 9.0

    result = reject_small_segments(matched(values), min_segment_px=4)

    rejected = result.status == int(PixelStatus.MISMATCHED)
    assert rejected[2, 5:8].all()
    assert rejected.sum() == 3
    assert result.values[rejected].isnan().all()


def test_a_slope_is_one_segment():
    slope = matched(torch.arange(40.0).expand(10, -1) * 0.9)

    result = reject_small_segments(slope, min_segment_px=400)

    assert torch.equal(result.values, slope.values)


def test_no_size_keeps_every_segment(generator):
    noise = matched(30 * torch.rand((10, 10), generator=generator))

    assert torch.equal(reject_small_segments(noise, min_segment_px=0).values, noise.values)
