"""What filled pixels take, from where."""

import numba
import pytest
import torch

from recon.filling import FILLINGS, BackgroundFilling, SurfaceFilling
from recon.types import DisparityMap, PixelStatus

NAN = float("nan")
NEAR, FAR = 15.0, 5.0


@pytest.fixture(params=FILLINGS)
def filling(request):
    return FILLINGS[request.param]


def fill(filling, disparity, *, guide=None, right=None):
    """Fill, with a right view that says nothing and a picture of one colour if none is given."""
    height, width = disparity.values.shape
    guide = torch.full((height, width, 3), 0.5) if guide is None else guide
    right = torch.full((height, width), NAN) if right is None else right
    states = torch.where(right.isnan(), int(PixelStatus.OUTSIDE), int(PixelStatus.MATCHED))
    of_right = DisparityMap(right, states.to(torch.uint8), torch.ones(height, width))
    return filling(disparity, of_right=of_right, guide=guide)


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
def test_an_occluded_hole_between_near_and_far_is_far(status, mirrored, filling):
    disparity, hole = scene(status)
    if mirrored:
        disparity = DisparityMap(
            disparity.values.flip(1), disparity.status.flip(1), disparity.confidence.flip(1)
        )
        hole = (hole[0], slice(40 - 24, 40 - 17))
    far_behind = torch.full((20, 40), FAR)  # in front of which the right view sees nothing

    result = fill(filling(), disparity, right=far_behind)

    assert (result.values[hole] == FAR).all()
    assert (result.status[hole] == int(PixelStatus.FILLED_OCCLUSION)).all()


def test_a_mismatched_hole_in_a_surface_takes_the_surface(filling):
    values = torch.full((30, 30), NEAR)
    values[:, :3] = FAR
    picture = torch.where(values == FAR, 0.2, 0.7)[..., None].expand(-1, -1, 3).contiguous()
    status = torch.full((30, 30), int(PixelStatus.MATCHED), dtype=torch.uint8)
    hole = (slice(8, 12), slice(6, 12))
    values[hole], status[hole] = NAN, int(PixelStatus.MISMATCHED)

    holed = DisparityMap(values, status, torch.ones(30, 30) * ~values.isnan())
    result = fill(filling(), holed, guide=picture)

    assert (result.values[hole] == NEAR).all()
    assert (result.status[hole] == int(PixelStatus.FILLED_MISMATCH)).all()


def test_every_pixel_gets_a_disparity_and_measured_ones_keep_theirs(generator, filling):
    values = 30 * torch.rand((25, 35), generator=generator)
    status = torch.randint(0, 4, (25, 35), generator=generator).to(torch.uint8)
    matched = status == int(PixelStatus.MATCHED)
    before = DisparityMap(values.masked_fill(~matched, NAN), status, 0.5 * matched)

    result = fill(filling(), before)

    assert result.valid.all()
    assert torch.equal(result.values[matched], values[matched])
    assert torch.equal(result.status == int(PixelStatus.MATCHED), matched)
    assert torch.equal(
        result.status == int(PixelStatus.FILLED_MISMATCH), status == int(PixelStatus.MISMATCHED)
    )


def test_filled_pixels_are_trusted_less(filling):
    disparity, hole = scene(PixelStatus.OCCLUDED)

    result = fill(filling(confidence=0.25), disparity)

    assert result.confidence[hole].unique().item() == pytest.approx(0.25 * 0.8)
    assert result.confidence[0, 0] == disparity.confidence[0, 0]


def test_filled_values_lie_within_the_measured_ones_and_the_rise(generator, filling):
    values = 10 + torch.rand((25, 35), generator=generator)
    status = torch.randint(0, 4, (25, 35), generator=generator).to(torch.uint8)
    matched = status == int(PixelStatus.MATCHED)

    holed = DisparityMap(values.masked_fill(~matched, NAN), status, 0.5 * matched)
    result = fill(filling(most_rise_px=0.5), holed)

    assert result.values.min() >= 9.5
    assert result.values.max() <= 11.5


def test_a_mismatched_pixel_that_sees_no_match_is_filled_from_afar(filling):
    values = torch.full((40, 60), NAN)
    status = torch.full((40, 60), int(PixelStatus.MISMATCHED), dtype=torch.uint8)
    values[3, 50], status[3, 50] = 7.0, int(PixelStatus.MATCHED)

    result = fill(filling(), DisparityMap(values, status, torch.zeros(40, 60)))

    assert (result.values == 7).all()


def test_a_map_without_a_single_match_stays_as_it_is(filling):
    status = torch.full((6, 7), int(PixelStatus.MISMATCHED), dtype=torch.uint8)
    nothing = DisparityMap(torch.full((6, 7), NAN), status, torch.zeros(6, 7))

    assert fill(filling(), nothing) is nothing


def test_a_share_that_is_not_one_is_refused(filling):
    with pytest.raises(ValueError, match=r"confidence must be in \[0, 1\], got 2"):
        filling(confidence=2)


@pytest.mark.parametrize(
    ("setting", "value", "message"),
    [
        ("most_rise_px", -1.0, "must not be negative, got -1"),
        ("tolerance_px", -0.5, "must not be negative, got -0.5"),
        ("radius_px", 0, "must be positive, got 0"),
        ("colour", 0.0, "must be positive, got 0.0"),
        ("same_px", NAN, "must be positive, got nan"),
    ],
)
def test_settings_of_surfaces_that_cannot_be_are_refused(setting, value, message):
    with pytest.raises(ValueError, match=f"{setting} {message}"):
        SurfaceFilling(**{setting: value})


class TestSurfaces:
    """What only `SurfaceFilling` does."""

    def bordered(self):
        """A hole at the left border: near below, far above, each of its own colour."""
        values = torch.full((40, 60), FAR)
        values[20:] = NEAR
        picture = torch.full((40, 60, 3), 0.1)
        picture[20:] = 0.9
        picture[20:, :8] = 0.1  # the near thing ends here; beyond it lies what is far
        status = torch.full((40, 60), int(PixelStatus.MATCHED), dtype=torch.uint8)
        values[20:, :14], status[20:, :14] = NAN, int(PixelStatus.OUTSIDE)
        confidence = torch.ones(40, 60) * ~values.isnan()
        return DisparityMap(values, status, confidence), picture

    def test_a_hole_takes_the_surface_of_its_own_colour(self):
        disparity, picture = self.bordered()

        result = fill(SurfaceFilling(), disparity, guide=picture)
        by_rows = fill(BackgroundFilling(), disparity, guide=picture)

        assert (result.values[20:, :8] == FAR).all()
        assert (result.values[20:, 8:14] == NEAR).all()
        assert (by_rows.values[20:, :8] == NEAR).all()

    def test_what_the_right_view_would_see_in_front_is_not_continued(self):
        disparity, hole = scene(PixelStatus.OCCLUDED)
        # The right view sees what is far wherever the hole would lie, were it near.
        contradicting = torch.full((20, 40), FAR)
        silent = torch.full((20, 40), NEAR)

        kept_out = fill(SurfaceFilling(), disparity, right=contradicting)
        let_in = fill(SurfaceFilling(), disparity, right=silent)
        tolerated = fill(SurfaceFilling(tolerance_px=NEAR - FAR), disparity, right=contradicting)

        assert (kept_out.values[hole] == FAR).all()
        assert (let_in.values[hole] == NEAR).any()
        assert torch.equal(tolerated.values, let_in.values)

    @pytest.mark.parametrize("status", [PixelStatus.OCCLUDED, PixelStatus.MISMATCHED])
    def test_a_slanted_surface_goes_on_with_both_its_slopes(self, status):
        rows, columns = torch.meshgrid(torch.arange(60.0), torch.arange(80.0), indexing="ij")
        truth = 10 + 0.05 * columns - 0.04 * rows
        hole = (slice(25, 35), slice(30, 50))
        values, state = truth.clone(), torch.full((60, 80), 1, dtype=torch.uint8)
        values[hole], state[hole] = NAN, int(status)
        holed = DisparityMap(values, state, torch.ones(60, 80) * ~values.isnan())

        result = fill(SurfaceFilling(), holed)
        level = fill(SurfaceFilling(most_rise_px=0.0), holed)

        assert (result.values - truth)[hole].abs().max() < 0.02
        assert (level.values - truth)[hole].abs().max() > 0.08

    def test_a_wrong_piece_beside_a_mismatch_does_not_spread(self):
        values = torch.full((41, 41), FAR)
        status = torch.full((41, 41), int(PixelStatus.MATCHED), dtype=torch.uint8)
        values[15:26, 15:26], status[15:26, 15:26] = NAN, int(PixelStatus.MISMATCHED)
        values[20, 20], status[20, 20] = NEAR, int(PixelStatus.MATCHED)
        confidence = torch.ones(41, 41) * ~values.isnan()

        result = fill(SurfaceFilling(), DisparityMap(values, status, confidence))

        wrong = (result.values - FAR).abs() > 1
        assert wrong.sum() <= 5  # itself and at most its four neighbours

    def test_nothing_depends_on_the_number_of_threads(self, generator):
        values = 10 + 5 * torch.rand((50, 70), generator=generator)
        status = torch.randint(0, 4, (50, 70), generator=generator).to(torch.uint8)
        matched = status == int(PixelStatus.MATCHED)
        holed = DisparityMap(values.masked_fill(~matched, NAN), status, 0.5 * matched)
        picture = torch.rand((50, 70, 3), generator=generator)
        threads = numba.get_num_threads()

        try:
            both = []
            for count in (1, threads):
                numba.set_num_threads(count)
                both.append(fill(SurfaceFilling(), holed, guide=picture, right=values).values)
        finally:
            numba.set_num_threads(threads)

        assert torch.equal(*both)
