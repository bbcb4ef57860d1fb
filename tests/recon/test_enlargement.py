"""The second search, at twice the size."""

from dataclasses import replace

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from turned import workshop

from recon import enlargement
from recon.aggregation import BilateralAggregation
from recon.enlargement import QUICK, Enlargement
from recon.matcher import Matcher
from recon.matching_cost import Census, LearnedCost
from recon.types import DisparityMap, PixelStatus

HEIGHT, WIDTH = 40, 90
SEARCHED = range(16)
COST = LearnedCost("fast")
NAN = float("nan")


def found(values):
    """A map as an optimisation gives it."""
    there = ~values.isnan()
    status = torch.where(there, int(PixelStatus.MATCHED), int(PixelStatus.OUTSIDE))
    return DisparityMap(values, status.to(torch.uint8), 0.25 * there.float())


def constant(value):
    return found(torch.full((HEIGHT, WIDTH), float(value)))


@pytest.fixture
def shifted(smooth_texture):
    """Return a maker of views of a wall at a disparity that is a multiple of 1/8 px."""

    def make(disparity):
        texture = smooth_texture(HEIGHT, WIDTH + 16).permute(2, 0, 1)[None]
        sharp = F.interpolate(texture, (HEIGHT, 8 * (WIDTH + 16)), mode="bicubic")
        step = round(8 * disparity)
        views = (sharp[..., step * part :][..., : 8 * WIDTH] for part in (0, 1))
        return tuple(F.avg_pool2d(view, (1, 8))[0].permute(1, 2, 0).contiguous() for view in views)

    return make


@pytest.fixture
def wall(texture):
    """Two views of a wall at 6 px with a stripe at 9 px in front, and its disparities."""
    behind, before = texture(HEIGHT, WIDTH + 16), texture(HEIGHT, WIDTH)
    left, right = behind[:, :WIDTH].clone(), behind[:, 6 : 6 + WIDTH].clone()
    left[:, 50:60], right[:, 41:51] = before[:, 50:60], before[:, 50:60]
    values = torch.full((HEIGHT, WIDTH), 6.0)
    values[:, 50:60] = 9.0
    return (left, right), values


@pytest.mark.parametrize("disparity", [6.0, 6.25, 6.5, 6.625])
@pytest.mark.parametrize("start", [6.0, 7.0])
@pytest.mark.parametrize(("cost", "bias"), [("same", 0.02), ("soft_census", 0.06)])
def test_both_views_come_nearer_to_the_truth(cost, bias, disparity, start, shifted):
    before = constant(start), constant(start)

    after = Enlargement(cost=cost)(COST, shifted(disparity), before, SEARCHED)

    for values in (after[0].values[:, 16:], after[1].values[:, :-16]):
        assert (values - disparity).median().abs() < bias
        assert ((values - disparity).abs() < 0.2).float().mean() > 0.9


def test_status_and_confidence_stay(wall):
    views, values = wall
    values[3:6, 20:40] = NAN
    before = found(values), constant(6)

    after = Enlargement(cost="same")(COST, views, before, SEARCHED)

    for was, is_ in zip(before, after, strict=True):
        assert torch.equal(was.status, is_.status)
        assert torch.equal(was.confidence, is_.confidence)


def test_an_edge_that_was_misplaced_moves_to_where_it_is(wall):
    views, values = wall
    misplaced = values.roll(2, 1)

    after, _ = Enlargement(cost="same")(COST, views, (found(misplaced), constant(6)), SEARCHED)
    kept, _ = Enlargement(cost="same", around_px=0)(
        COST, views, (found(misplaced), constant(6)), SEARCHED
    )

    near = slice(45, 65)
    wrong = [((each - values)[:, near].abs() > 1).float().mean() for each in
             (misplaced, after.values, kept.values)]  # fmt: skip
    assert wrong[0] == pytest.approx(0.2)
    assert wrong[1] < 0.05
    assert wrong[2] > 0.15  # the background beside an edge is never searched for the stripe


def test_the_first_search_decides_where_the_views_say_nothing():
    grey = torch.full((HEIGHT, WIDTH, 3), 0.5)
    slope = torch.linspace(3, 9, WIDTH).expand(HEIGHT, WIDTH).contiguous()

    after, _ = Enlargement(cost="same")(COST, (grey, grey), (found(slope), constant(6)), SEARCHED)
    freely, _ = Enlargement(cost="same", trust=0)(
        COST, (grey, grey), (found(slope), constant(6)), SEARCHED
    )

    inside = slice(12, -4)
    assert (after.values - slope)[:, inside].abs().max() < 0.5
    assert (freely.values - slope)[:, inside].abs().max() > 0.6


def test_nothing_is_found_outside_what_was_searched(wall):
    views, values = wall
    values = values.clamp(max=6.0)
    values[10:30, 30:40] = NAN

    after, _ = Enlargement(cost="same")(COST, views, (found(values), constant(6)), range(7))

    assert torch.equal(after.values.isnan(), values.isnan())
    assert after.values.nan_to_num(6.0).max() <= 6


def test_the_right_view_is_treated_as_the_left_one_in_a_mirror(wall, assert_close):
    (left, right), values = wall
    before = found(values), constant(6)
    mirrored = [replace(each, values=each.values.flip(1)) for each in before[::-1]]
    flipped = right.flip(1).contiguous(), left.flip(1).contiguous()

    _, of_right = Enlargement(cost="same")(Colours(), (left, right), before, SEARCHED)
    as_left, _ = Enlargement(cost="same")(Colours(), flipped, tuple(mirrored), SEARCHED)

    assert_close(of_right.values, as_left.values.flip(1), atol=1e-3)


class Colours:
    """Vectors that are the same in a mirror: the colours."""

    margin_px = 0

    def __call__(self, *_, **__):
        raise AssertionError

    def vectors(self, image, *, rows=slice(None)):
        return F.normalize(image, dim=2)[rows]


def test_strips_change_nothing(wall, monkeypatch, assert_close):
    views, values = wall
    before = found(values), constant(6)
    whole = Enlargement(cost="same")(COST, views, before, SEARCHED)

    monkeypatch.setattr(enlargement, "BYTES_AT_ONCE", 1)
    strips = Enlargement(cost="same")(COST, views, before, SEARCHED)

    for one, other in zip(whole, strips, strict=True):
        assert_close(one.values, other.values, atol=1e-3)


def test_large_views_stay_as_they_are():
    pair, searched, seen = workshop(), range(48), {}
    plain = Matcher(LearnedCost("fast"), BilateralAggregation(radius_px=2), filling=None)
    pixels = pair.left.shape[0] * pair.left.shape[1]
    enlarging = replace(plain, enlargement=Enlargement(most_pixels=pixels))
    too_small = replace(plain, enlargement=Enlargement(most_pixels=pixels - 1))

    expected = plain(pair, searched).values
    finer = enlarging(pair, searched, observe=seen.__setitem__).values

    assert np.array_equal(too_small(pair, searched).values, expected, equal_nan=True)
    assert not np.array_equal(finer, expected, equal_nan=True)
    assert {"small/left", "small/right"} <= seen.keys()
    assert (np.abs(finer - expected) < 1)[~np.isnan(finer - expected)].mean() > 0.9


def test_a_cost_without_vectors_cannot_be_the_same():
    with pytest.raises(ValueError, match=r"compares vectors, such as cnn, got Census; .*soft_cens"):
        Matcher(Census(), BilateralAggregation(), enlargement=Enlargement(cost="same"))

    assert Enlargement().compared_by(Census()) == QUICK
    assert Enlargement(cost="same").compared_by(COST) is COST


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ({"around_px": -1}, "around_px must not be negative, got -1"),
        ({"cost": "sad"}, "cost must be same or soft_census, got 'sad'"),
        ({"trust_px": 0.0}, "trust_px must be positive, got 0.0"),
        ({"sigma_colour": 0.0}, "sigma_colour must be positive, got 0.0"),
        ({"small_step": 3.0}, r"small_step <= large_step, got 3.0 and 2.5"),
    ],
)
def test_settings_out_of_range_are_refused(setting, words):
    with pytest.raises(ValueError, match=words):
        Enlargement(**setting)
