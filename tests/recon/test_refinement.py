"""What every refinement promises."""

from dataclasses import replace

import pytest
import torch

from recon.refinement import REFINEMENTS, DomainTransform, LocalPlanes
from recon.types import DisparityMap, PixelStatus

NAN = float("nan")
HEIGHT, WIDTH = 40, 50


@pytest.fixture(params=sorted(REFINEMENTS))
def refinement(request):
    return REFINEMENTS[request.param]()


@pytest.fixture(params=sorted(REFINEMENTS))
def strong(request):
    """With a wide reach, to see how far it goes."""
    far = {
        "domain_transform": DomainTransform(),
        "local_planes": LocalPlanes(radius_px=6, step_px=1, tolerance_px=2.0),
    }
    return far.get(request.param) or REFINEMENTS[request.param](radius_px=6)


@pytest.fixture
def gaps(generator):
    mask = torch.rand((HEIGHT, WIDTH), generator=generator) < 0.2
    mask[:8, :8] = True
    return mask


def of(values):
    """A map that is matched or filled where there are values."""
    valid = ~values.isnan()
    status = torch.full(values.shape, int(PixelStatus.MATCHED), dtype=torch.uint8)
    status[::2] = int(PixelStatus.FILLED_MISMATCH)
    return DisparityMap(values, status.masked_fill(~valid, int(PixelStatus.OCCLUDED)), 0.5 * valid)


def grey(height=HEIGHT, width=WIDTH):
    return torch.full((height, width, 3), 0.5)


def test_a_constant_stays_constant_beside_gaps(refinement, gaps, texture, assert_close):
    disparity = of(torch.full((HEIGHT, WIDTH), 17.0).masked_fill(gaps, NAN))

    result = refinement(disparity, guide=texture(HEIGHT, WIDTH))

    assert_close(result.values, disparity.values)


def test_status_and_confidence_are_kept(refinement, gaps, texture, generator):
    values = torch.rand((HEIGHT, WIDTH), generator=generator)
    disparity = of(values.masked_fill(gaps, NAN))
    before = disparity.values.clone()

    result = refinement(disparity, guide=texture(HEIGHT, WIDTH))

    assert torch.equal(result.status, disparity.status)
    assert torch.equal(result.confidence, disparity.confidence)
    assert torch.equal(disparity.values.nan_to_num(), before.nan_to_num())


def test_noise_on_a_plain_surface_is_reduced_to_a_half(strong, generator):
    noise = torch.rand((HEIGHT, WIDTH), generator=generator)

    result = strong(of(noise), guide=grey())

    assert result.values.std() < noise.std() / 2


@pytest.mark.parametrize("axis", [0, 1])
def test_stripes_along_either_axis_are_smoothed(strong, axis):
    """A filter of rows alone would leave stripes along the rows as they are."""
    position = torch.arange(HEIGHT if axis == 0 else WIDTH)
    stripes = (position % 3 == 0).float()
    values = stripes[:, None].expand(HEIGHT, WIDTH) if axis == 0 else stripes.expand(HEIGHT, WIDTH)

    result = strong(of(values.contiguous()), guide=grey())

    inner = result.values[6:-6, 6:-6]
    assert inner.max() - inner.min() < 0.2


def test_the_largest_step_between_pixels_falls_along_both_axes(refinement, generator):
    noise = torch.rand((HEIGHT, WIDTH), generator=generator)

    result = refinement(of(noise), guide=grey())

    for axis in (0, 1):
        assert result.values.diff(dim=axis).abs().mean() < noise.diff(dim=axis).abs().mean() / 1.5


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("name", ["domain_transform", "weighted_median"])
def test_a_strong_edge_of_the_guide_is_not_crossed(name, axis, generator):
    guide, values = grey(), torch.full((HEIGHT, WIDTH), 5.0)
    guide[:] = 0.0
    guide.narrow(axis, 20, guide.shape[axis] - 20).fill_(1.0)
    values.narrow(axis, 20, guide.shape[axis] - 20).fill_(25.0)

    result = REFINEMENTS[name]()(of(values), guide=guide)

    # What leaks through the step of 1 + 3 * sigma_space / sigma_range is less than rounding.
    torch.testing.assert_close(result.values, values, rtol=0, atol=1e-3)


def test_an_edge_without_an_edge_in_the_guide_is_smoothed_by_the_domain_transform():
    values = torch.full((HEIGHT, WIDTH), 5.0)
    values[:, 25:] = 25.0

    result = DomainTransform()(of(values), guide=grey())

    assert (result.values[:, 15:35].diff(dim=1) > 0).all()


def test_a_trusted_disparity_weighs_more_if_confidence_counts():
    values = torch.zeros((1, 21))
    values[0, 10] = 1.0
    status = torch.full((1, 21), int(PixelStatus.MATCHED), dtype=torch.uint8)
    trusted = torch.full((1, 21), 0.1)
    trusted[0, 10] = 1.0

    plain, weighted = (
        DomainTransform(confidence_weighted=weighted)(
            DisparityMap(values, status, trusted), guide=grey(1, 21)
        ).values
        for weighted in (False, True)
    )

    assert (weighted > plain).all()


def test_the_weight_of_a_disparity_is_its_odds():
    """Of being right: 0.98 / 0.03 and 0.99 / 0.02, with the 0.01 that bounds them; 1.5 apart."""
    values = torch.zeros((1, 21))
    values[0, 10] = 1.0
    status = torch.full((1, 21), int(PixelStatus.MATCHED), dtype=torch.uint8)
    pulls = []
    for sure in (0.98, 0.99):
        trusted = torch.full((1, 21), 0.999)
        trusted[0, 10] = sure
        disparity = DisparityMap(values, status, trusted)
        result = DomainTransform(confidence_weighted=True)(disparity, guide=grey(1, 21))
        pulls.append(result.values[0, 5].item())

    assert pulls[1] > 1.3 * pulls[0]


def test_what_is_trusted_enough_can_be_left_alone(texture):
    values, guide = 9 * texture(HEIGHT, WIDTH).mean(2), texture(HEIGHT, WIDTH)
    trusted = torch.linspace(0, 1, WIDTH).expand(HEIGHT, WIDTH)
    status = torch.full((HEIGHT, WIDTH), int(PixelStatus.MATCHED), dtype=torch.uint8)
    disparity = DisparityMap(values, status, trusted)

    everywhere = DomainTransform()(disparity, guide=guide).values
    some = DomainTransform(below_confidence=0.5)(disparity, guide=guide).values

    half = WIDTH // 2
    assert torch.equal(some[:, half:], values[:, half:])
    assert torch.equal(some[:, :half], everywhere[:, :half])
    assert not torch.equal(some[:, :half], values[:, :half])


@pytest.mark.parametrize("limit", [0.0, 1.1])
def test_a_limit_of_confidence_outside_its_range_is_refused(limit):
    with pytest.raises(ValueError, match=r"below_confidence must be in \(0, 1\]"):
        DomainTransform(below_confidence=limit)


def test_pixels_without_any_confidence_keep_a_disparity(texture):
    values = torch.ones((6, 7))
    status = torch.full((6, 7), int(PixelStatus.MATCHED), dtype=torch.uint8)

    result = DomainTransform(confidence_weighted=True)(
        DisparityMap(values, status, torch.zeros(6, 7)), guide=texture(6, 7)
    )

    assert torch.equal(result.values, values)


@pytest.mark.parametrize("setting", ["sigma_space_px", "sigma_range", "iterations"])
def test_a_setting_that_is_not_positive_is_refused(setting):
    with pytest.raises(ValueError, match=f"{setting} must be positive, got 0"):
        DomainTransform(**{setting: 0})


@pytest.mark.parametrize("name", ["median", "weighted_median"])
def test_a_negative_radius_is_refused(name):
    with pytest.raises(ValueError, match="radius_px must not be negative, got -1"):
        REFINEMENTS[name](radius_px=-1)


class TestLocalPlanes:
    @pytest.fixture
    def slope(self):
        rows, columns = torch.meshgrid(
            torch.arange(float(HEIGHT)), torch.arange(float(WIDTH)), indexing="ij"
        )
        return 30 + 0.3 * columns - 0.2 * rows

    @pytest.fixture
    def noise(self, generator):
        return 0.2 * torch.randn((HEIGHT, WIDTH), generator=generator)

    def test_a_slanted_plane_stays_as_it_is(self, slope, assert_close):
        assert_close(LocalPlanes()(of(slope), guide=grey()).values, slope, atol=1e-2)

    def test_noise_on_a_slanted_plane_goes(self, slope, noise):
        result = LocalPlanes()(of(slope + noise), guide=grey()).values

        assert (result - slope)[6:-6, 6:-6].std() < 0.4 * noise.std()
        assert (result - slope).std() < 0.6 * noise.std()  # the borders, too

    def test_a_jump_stays_where_it_is_though_the_guide_shows_nothing(self, slope, noise):
        slope[:, 23:] += 4.0

        result = LocalPlanes()(of(slope + noise), guide=grey()).values

        error = (result - slope).abs()
        assert error.max() < 1.0
        assert error[:, 20:26].mean() < 0.8 * noise.abs().mean()

    def test_what_looks_otherwise_does_not_count(self, slope, noise):
        guide = grey()
        guide[:, 23:] = 0.6
        faint = slope.clone()
        faint[:, 23:] += 0.4

        seen, unseen = (
            LocalPlanes()(of(faint + noise), guide=view).values - faint for view in (guide, grey())
        )

        assert seen[:, 20:26].abs().mean() < 0.8 * unseen[:, 20:26].abs().mean()

    def test_what_is_not_trusted_does_not_count(self, slope):
        values = slope.clone()
        values[:, ::2] += 0.5
        trust = torch.ones_like(slope)
        trust[:, ::2] = 0.05

        result = LocalPlanes(step_px=1)(replace(of(values), confidence=trust), guide=grey()).values

        assert (result - slope)[6:-6, 6:-6].abs().max() < 0.05

    @pytest.mark.parametrize("name", ["radius_px", "step_px", "colour", "tolerance_px", "rounds"])
    def test_a_setting_that_is_not_positive_is_refused(self, name):
        with pytest.raises(ValueError, match=f"{name} must be positive, got 0"):
            LocalPlanes(**{name: 0})
