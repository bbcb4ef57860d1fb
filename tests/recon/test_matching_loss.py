"""The loss and the score: what the network is rewarded for."""

import pytest
import torch

from recon.training.loss import (
    best_disparity,
    matching_loss,
    near_edges,
    similarities,
    within_one_pixel,
)


@pytest.fixture
def features(generator):
    """Unit vectors of two rows, seen by the right camera 3 px further left."""
    left = torch.nn.functional.normalize(torch.randn(1, 32, 2, 40, generator=generator), dim=1)
    return left, left.roll(-3, dims=3)


@pytest.fixture
def row(features):
    return similarities(*features)


def test_similarities_are_products_at_every_disparity_and_nothing_outside(features):
    left, right = features

    found = similarities(left, right)

    assert found.shape == (1, 2, 40, 13)  # 0.32 of the width, and 0
    for d in range(13):
        expected = (left[..., d:] * right[..., : 40 - d]).sum(1)
        torch.testing.assert_close(found[:, :, d:, d], expected)
        assert (found[:, :, :d, d] == 0).all()


def test_the_truth_surprises_least(row):
    sharpness = torch.tensor(20.0)
    weight = torch.ones(1, 2, 40)
    weight[:, :, -5:] = 0

    losses = [
        float(matching_loss(row, torch.full((1, 2, 40), d), weight, sharpness))
        for d in (2.0, 2.5, 3.0, 3.5, 4.0)
    ]

    assert losses.index(min(losses)) == 2


def test_the_parabola_of_the_best_costs_has_its_vertex_at_the_truth():
    similarity = torch.zeros(1, 1, 40, 13, requires_grad=True)
    disparity, weight = torch.full((1, 1, 40), 6.3), torch.ones(1, 1, 40)
    descent = torch.optim.Adam([similarity], 0.05)
    for _ in range(2000):
        descent.zero_grad()
        matching_loss(similarity, disparity, weight, torch.tensor(1.0)).backward()
        descent.step()

    before, best, after = similarity.detach()[0, 0, 30, 5:8]

    assert 6 + (after - before) / (2 * (2 * best - before - after)) == pytest.approx(6.3, abs=0.02)


def test_no_pixel_surprises_more_than_false_labels_may(row):
    wrong = torch.full((1, 2, 40), 7.0)

    loss = matching_loss(row, wrong, torch.ones(1, 2, 40), torch.tensor(1000.0))

    assert float(loss) == pytest.approx(-torch.tensor(0.03).log())


def test_a_sharpness_that_is_learned_gets_a_gradient(row):
    sharpness = torch.tensor(1.0, requires_grad=True)

    matching_loss(row, torch.full((1, 2, 40), 3.0), torch.ones(1, 2, 40), sharpness).backward()

    assert float(sharpness.grad) < 0  # sharper fits better


def test_pixels_without_weight_and_without_partner_do_not_count(row):
    disparity, weight = torch.full((1, 2, 40), 3.0), torch.ones(1, 2, 40)
    weight[:, :, 20:] = 0
    changed = disparity.clone()
    changed[:, :, 20:] = 9.0
    sharpness = torch.tensor(5.0)

    one = matching_loss(row, disparity, weight, sharpness)
    weight[:, :, :3] = 7  # their partners lie outside

    assert torch.equal(matching_loss(row, changed, weight, sharpness), one)


def test_a_pixel_of_twice_the_weight_counts_twice(row):
    disparity = torch.full((1, 2, 40), 3.0)
    disparity[:, 0] = 5.0
    only_wrong, both = torch.zeros(1, 2, 40), torch.ones(1, 2, 40)
    only_wrong[:, 0] = 1
    sharpness = torch.tensor(5.0)

    def loss(weight):
        weight = weight.clone()
        weight[:, :, :6] = 0  # their partners may lie outside
        return float(matching_loss(row, disparity, weight, sharpness))

    wrong, right = loss(only_wrong), loss(both - only_wrong)
    assert loss(both) == pytest.approx((wrong + right) / 2)
    assert loss(both + only_wrong) == pytest.approx((2 * wrong + right) / 3)


def test_nothing_to_learn_from_is_no_loss(row):
    loss = matching_loss(row, torch.ones(1, 2, 40), torch.zeros(1, 2, 40), torch.tensor(5.0))

    assert loss == 0


def test_the_score_is_the_share_of_visible_pixels_within_one(row):
    visible = torch.zeros(1, 2, 40, dtype=torch.bool)
    visible[:, :, 5:35] = True

    scores = [within_one_pixel(row, torch.full((1, 2, 40), d), visible) for d in (3.0, 4.0, 4.1)]

    assert scores == [1.0, 1.0, 0.0]
    assert within_one_pixel(row, torch.full((1, 2, 40), 3.0), ~visible) < 1


def test_nothing_visible_scores_nothing(row):
    assert within_one_pixel(row, torch.ones(1, 2, 40), torch.zeros(1, 2, 40) > 0) == 0


def test_the_best_disparity_is_that_of_the_partner(row):
    assert (best_disparity(row)[:, :, 3:] == 3).all()


def test_edges_are_where_disparity_jumps_and_seven_pixels_around():
    disparity = torch.zeros(1, 1, 40)
    disparity[..., 20:] = 5.0

    near = near_edges(disparity)[0, 0]

    assert near.nonzero()[:, 0].tolist() == list(range(13, 28))
    assert not near_edges(torch.linspace(0, 30, 40).expand(1, 5, 40)).any()
