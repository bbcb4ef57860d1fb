"""What every aggregation promises."""

import pytest
import torch

from recon.aggregation import AGGREGATIONS, BilateralAggregation
from recon.types import CostVolume

INF = float("inf")


@pytest.fixture(params=sorted(AGGREGATIONS))
def aggregation(request):
    return AGGREGATIONS[request.param]()


@pytest.fixture
def missing(generator):
    """(H, W, D): single candidates, and a corner of whole pixels as beside the border."""
    mask = torch.rand((20, 30, 6), generator=generator) < 0.2
    mask[:5, :5] = True
    return mask


def test_a_constant_stays_constant_beside_missing_candidates(
    aggregation, missing, texture, assert_close
):
    volume = CostVolume(torch.full((20, 30, 6), 0.7).masked_fill(missing, INF), range(6))

    result = aggregation(volume, guide=texture(20, 30))

    assert_close(result.cost, volume.cost)


def test_candidates_without_a_cost_stay_without(aggregation, missing, texture, generator):
    cost = torch.rand((20, 30, 6), generator=generator).masked_fill(missing, INF)

    result = aggregation(CostVolume(cost, range(-2, 4)), guide=texture(20, 30))

    assert torch.equal(result.cost == INF, missing)
    assert not result.cost.isnan().any()
    assert result.disparities == range(-2, 4)


def test_inputs_are_left_alone(aggregation, texture, generator):
    cost, guide = torch.rand((8, 9, 3), generator=generator), texture(8, 9)
    before = cost.clone(), guide.clone()

    aggregation(CostVolume(cost, range(3)), guide=guide)

    assert torch.equal(cost, before[0])
    assert torch.equal(guide, before[1])


def test_candidates_do_not_mix(aggregation, texture, generator, assert_close):
    cost, guide = torch.rand((8, 9, 4), generator=generator), texture(8, 9)

    together = aggregation(CostVolume(cost, range(4)), guide=guide)
    alone = aggregation(CostVolume(cost[:, :, 2:3].contiguous(), range(1)), guide=guide)

    assert_close(together.cost[:, :, 2:3], alone.cost)


def test_a_margin_is_all_the_context_that_matters(aggregation, smooth_texture, generator):
    cost, guide = torch.rand((60, 10, 2), generator=generator), smooth_texture(60, 10)
    margin = aggregation.margin_px
    seen = slice(25 - margin, 30 + margin)

    strip = aggregation(CostVolume(cost[seen].contiguous(), range(2)), guide=guide[seen])
    whole = aggregation(CostVolume(cost, range(2)), guide=guide)

    assert torch.equal(strip.cost[margin : margin + 5], whole.cost[25:30])


def test_bilateral_support_stops_at_an_edge_of_the_guide():
    guide = torch.zeros((20, 20, 3))
    guide[:, 10:] = 1.0
    cost = torch.zeros((20, 20, 1))
    cost[:, 10:] = 1.0

    result = BilateralAggregation()(CostVolume(cost, range(1)), guide=guide)

    assert torch.equal(result.cost, cost)


@pytest.mark.parametrize("axis", [0, 1])
def test_bilateral_support_comes_from_both_axes(axis):
    cost = torch.zeros((21, 21, 1))
    cost.select(axis, 10).fill_(1.0)

    result = BilateralAggregation()(CostVolume(cost, range(1)), guide=torch.zeros((21, 21, 3)))

    profile = result.cost[:, :, 0].mean(1 - axis)
    assert (profile[:10].diff() > 0).all() or (profile[2:10].diff() > 0).all()
    assert profile[10] < 0.5


@pytest.mark.parametrize("setting", ["sigma_space_px", "sigma_colour"])
def test_a_sigma_that_is_not_positive_is_refused(setting):
    with pytest.raises(ValueError, match=f"{setting} must be positive, got 0"):
        BilateralAggregation(**{setting: 0.0})
