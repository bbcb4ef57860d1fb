"""What filled pixels take, from where."""

import pytest
import torch

from recon.filling import Filling
from recon.types import DisparityMap, PixelStatus

NAN = float("nan")
NEAR, FAR = 20.0, 5.0


def scene(hole_status):
    """Near on the left half, far on the right, with a hole across the border."""
    values = torch.full((20, 40), NEAR)
    values[:, 20:] = FAR
    status = torch.full((20, 40), int(PixelStatus.MATCHED), dtype=torch.uint8)
    confidence = torch.full((20, 40), 0.8)
    hole = (slice(6, 14), slice(17, 24))
    values[hole], status[hole], confidence[hole] = NAN, int(hole_status), 0.0
    return DisparityMap(values, status, confidence), hole


@pytest.mark.parametrize("status", [PixelStatus.OCCLUDED, PixelStatus.OUTSIDE])
@pytest.mark.parametrize("mirrored", [False, True])
def test_an_occluded_hole_between_near_and_far_is_far(status, mirrored):
    disparity, hole = scene(status)
    if mirrored:
        disparity = DisparityMap(
            disparity.values.flip(1), disparity.status.flip(1), disparity.confidence.flip(1)
        )
        hole = (hole[0], slice(40 - 24, 40 - 17))

    result = Filling()(disparity)

    assert (result.values[hole] == FAR).all()
    assert (result.status[hole] == int(PixelStatus.FILLED_OCCLUSION)).all()


def test_a_mismatched_hole_in_a_surface_takes_the_surface():
    values = torch.full((30, 30), NEAR)
    values[:, :3] = FAR
    status = torch.full((30, 30), int(PixelStatus.MATCHED), dtype=torch.uint8)
    hole = (slice(8, 12), slice(6, 12))
    values[hole], status[hole] = NAN, int(PixelStatus.MISMATCHED)

    result = Filling()(DisparityMap(values, status, torch.ones(30, 30) * ~values.isnan()))

    assert (result.values[hole] == NEAR).all()
    assert (result.status[hole] == int(PixelStatus.FILLED_MISMATCH)).all()


def test_every_pixel_gets_a_disparity_and_measured_ones_keep_theirs(generator):
    values = 30 * torch.rand((25, 35), generator=generator)
    status = torch.randint(0, 4, (25, 35), generator=generator).to(torch.uint8)
    matched = status == int(PixelStatus.MATCHED)
    before = DisparityMap(values.masked_fill(~matched, NAN), status, 0.5 * matched)

    result = Filling()(before)

    assert result.valid.all()
    assert torch.equal(result.values[matched], values[matched])
    assert torch.equal(result.status == int(PixelStatus.MATCHED), matched)
    assert torch.equal(
        result.status == int(PixelStatus.FILLED_MISMATCH), status == int(PixelStatus.MISMATCHED)
    )


def test_filled_pixels_are_trusted_less(generator):
    disparity, hole = scene(PixelStatus.OCCLUDED)

    result = Filling(confidence=0.25)(disparity)

    assert result.confidence[hole].unique().item() == pytest.approx(0.25 * 0.8)
    assert result.confidence[0, 0] == disparity.confidence[0, 0]


def test_filled_values_lie_within_the_measured_ones(generator):
    values = 10 + torch.rand((25, 35), generator=generator)
    status = torch.randint(0, 4, (25, 35), generator=generator).to(torch.uint8)
    matched = status == int(PixelStatus.MATCHED)

    result = Filling()(DisparityMap(values.masked_fill(~matched, NAN), status, 0.5 * matched))

    assert result.values.min() >= 10
    assert result.values.max() <= 11


def test_a_mismatched_pixel_that_sees_no_match_is_filled_from_afar():
    values = torch.full((40, 60), NAN)
    status = torch.full((40, 60), int(PixelStatus.MISMATCHED), dtype=torch.uint8)
    values[3, 50], status[3, 50] = 7.0, int(PixelStatus.MATCHED)

    result = Filling()(DisparityMap(values, status, torch.zeros(40, 60)))

    assert (result.values == 7).all()


def test_a_map_without_a_single_match_stays_as_it_is():
    status = torch.full((6, 7), int(PixelStatus.MISMATCHED), dtype=torch.uint8)
    nothing = DisparityMap(torch.full((6, 7), NAN), status, torch.zeros(6, 7))

    assert Filling()(nothing) is nothing


def test_a_share_that_is_not_one_is_refused():
    with pytest.raises(ValueError, match=r"confidence must be in \[0, 1\], got 2"):
        Filling(confidence=2)
