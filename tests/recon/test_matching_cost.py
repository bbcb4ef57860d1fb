"""What every matching cost promises."""

import math

import pytest
import torch

from recon.matching_cost import (
    MATCHING_COSTS,
    AdCensus,
    Census,
    LearnedCost,
    SoftCensus,
    SumOfAbsoluteDifferences,
)
from recon.matching_cost import NormalisedCrossCorrelation as Ncc
from recon.matching_cost import ZeroMeanNormalisedCrossCorrelation as Zncc
from recon.networks import Architecture, FeatureNetwork, save_features


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    """An untrained network in a file: equal patches have equal features all the same."""
    path = tmp_path_factory.mktemp("weights") / "untrained.safetensors"
    with torch.random.fork_rng():
        torch.manual_seed(1)
        save_features(path, FeatureNetwork(Architecture((16,), 2, 16)).eval(), about={})
    return str(path)


@pytest.fixture(params=sorted(MATCHING_COSTS))
def cost(request, weights):
    method = MATCHING_COSTS[request.param]
    return method(weights=weights) if request.param == "cnn" else method()


@pytest.mark.parametrize("shift", [-3, 0, 5])
def test_the_true_shift_costs_least(cost, shift, texture):
    left = texture(24, 48)
    right = left.roll(-shift, dims=1)

    volume = cost(left, right, range(-6, 9))

    inner = volume.cost[8:-8, 16:-16]
    assert (inner.argmin(2) - 6 == shift).float().mean() > 0.99


@pytest.mark.parametrize("disparities", [range(4), range(2, 6), range(-5, -2)], ids=str)
def test_exactly_the_candidates_outside_the_right_view_are_infinite(cost, disparities, texture):
    left, right = texture(12, 20), texture(12, 20)

    volume = cost(left, right, disparities)

    partner = torch.arange(20)[:, None] - torch.tensor(list(disparities))
    outside = (partner < 0) | (partner >= 20)
    assert volume.disparities == disparities
    assert torch.equal(volume.cost == float("inf"), outside.expand(12, -1, -1))
    assert not volume.cost.isnan().any()
    assert (volume.cost >= 0).all()


def test_inputs_are_left_alone(cost, texture):
    left, right = texture(12, 20), texture(12, 20)
    before = left.clone(), right.clone()

    cost(left, right, range(4))

    assert torch.equal(left, before[0])
    assert torch.equal(right, before[1])


def test_a_margin_is_all_the_context_that_matters(cost, texture, assert_close):
    left, right = texture(40, 24), texture(40, 24)
    top, bottom = 16, 20
    seen = slice(top - cost.margin_px, bottom + cost.margin_px)

    strip = cost(left[seen], right[seen], range(3), rows=slice(cost.margin_px, cost.margin_px + 4))

    assert_close(strip.cost, cost(left, right, range(3)).cost[top:bottom])


def test_black_images_have_finite_costs(cost):
    black = torch.zeros((9, 10, 3))

    assert cost(black, black, range(1)).cost.isfinite().all()


@pytest.mark.parametrize(
    ("method", "change"),
    [(Census(), lambda b: b**2), (Zncc(), lambda b: 0.5 * b + 0.2), (Ncc(), lambda b: 0.5 * b)],
    ids=["census_gamma", "zncc_gain_and_offset", "ncc_gain"],
)
def test_a_change_of_light_costs_nothing(method, change, texture, assert_close):
    left = texture(20, 20)[:, :, :1].expand(-1, -1, 3)

    volume = method(left, change(left), range(1))

    assert_close(volume.cost, torch.zeros((20, 20, 1)))


@pytest.mark.parametrize(("rows", "columns"), [(4, 5), (5, 4), (9, 9), (1, 1)])
def test_a_census_window_that_is_even_or_too_large_is_refused(rows, columns):
    with pytest.raises(ValueError, match=f"at most 64 pixels, got {rows} x {columns}"):
        Census(rows, columns)


def test_ad_census_is_the_sum_that_is_worked_out_by_hand():
    """The right view grows brighter by 0.1 from row to row."""
    left = torch.full((3, 3, 3), 0.5)
    right = left + 0.1 * torch.arange(3.0)[:, None, None]

    cost = AdCensus(3, 3, census_scale=0.5, difference_scale=0.2)(left, right, range(1)).cost

    census = Census(3, 3)(left, right, range(1)).cost[1, 1, 0]
    assert census == pytest.approx(3 / 8)  # the row above is darker
    assert float(cost[1, 1, 0]) == pytest.approx(2 - math.exp(-0.75) - math.exp(-0.5))


@pytest.mark.parametrize("scale", ["census_scale", "difference_scale"])
def test_a_scale_of_zero_is_refused(scale):
    with pytest.raises(ValueError, match=rf"{scale} must be positive, got 0\.0"):
        AdCensus(**{scale: 0.0})


def test_soft_census_counts_strong_steps_alike_and_faint_ones_less():
    """The pixels right of the middle are brighter by 0.001, left of it by 0.5 and 0.1."""
    row = torch.tensor([0.5, 0.1, 0.0, 0.001, 0.0])
    image = row[None, :, None].expand(5, -1, 3)

    steps = SoftCensus(faint_step=0.004).vectors(image)[2, 2]

    far, near, faint = steps[10], steps[11], steps[12]  # of the middle row: 10 before it
    assert float(far) == pytest.approx(float(near), rel=0.04)
    assert float(faint / near) == pytest.approx(0.2 / (0.1 / 0.104))


def test_soft_census_hardly_sees_a_change_of_brightness(texture):
    left = texture(12, 12)

    assert SoftCensus()(left, 0.3 * left, range(1)).cost.mean() < 0.02


def test_steps_to_nearer_neighbours_can_count_more():
    """All 24 steps are alike; distances squared are 1 beside the middle and 8 in the corners."""
    image = torch.ones(5, 5, 3)
    image[2, 2] = 0.0

    steps = SoftCensus(sigma_px=2.0).vectors(image)[2, 2]

    corner, beside = steps[0], steps[11]
    assert float(corner / beside) == pytest.approx(math.exp(-(8 - 1) / (2 * 2.0**2)))
    assert float(steps.norm()) == pytest.approx(1)


@pytest.mark.parametrize("setting", ["faint_step", "sigma_px"])
def test_a_soft_census_refuses_zero(setting):
    with pytest.raises(ValueError, match=rf"{setting} must be positive, got 0\.0"):
        SoftCensus(**{setting: 0.0})


def test_a_census_has_its_share_of_a_learned_cost(weights, texture):
    views = texture(12, 20), texture(12, 20)
    learned, census = (cost(*views, range(4)).cost for cost in (LearnedCost(weights), Census(5, 5)))

    both = LearnedCost(weights, census_share=0.25)(*views, range(4)).cost

    torch.testing.assert_close(both, 0.75 * learned + 0.25 * 1.7 * census)


def test_a_census_alone_is_no_learned_cost():
    with pytest.raises(ValueError, match=r"census_share must be in \[0, 1\), got 1\.0"):
        LearnedCost(census_share=1.0)


@pytest.mark.parametrize("method", [SumOfAbsoluteDifferences, Ncc])
def test_a_negative_radius_is_refused(method):
    with pytest.raises(ValueError, match=r"radius_px must .* got -1"):
        method(radius_px=-1)


def test_unknown_weights_are_refused(texture):
    with pytest.raises(ValueError, match="no weights called 'nowhere'"):
        MATCHING_COSTS["cnn"](weights="nowhere")(texture(8, 8), texture(8, 8), range(2))
