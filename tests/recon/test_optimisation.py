"""What every choice of a candidate promises, and how fine it is."""

import pytest
import torch

from recon.matching_cost import MATCHING_COSTS
from recon.networks import Regulariser, RegulariserShape, save_regulariser
from recon.optimisation import OPTIMISATIONS, SemiGlobal, WinnerTakesAll
from recon.types import CostVolume, PixelStatus

INF = float("inf")


def chosen(volume, method=None):
    """Choose on a guide without edges."""
    method = WinnerTakesAll() if method is None else method
    return method(volume, guide=torch.zeros(*volume.cost.shape[:2], 3))


@pytest.fixture(params=sorted(OPTIMISATIONS))
def optimisation(request, tmp_path):
    settings = {}
    if request.param == "learned":
        shape = RegulariserShape(cells=(4, 4, 4, 4), context=(4, 4, 4, 4, 4, 4), fine=4)
        settings["weights"] = str(tmp_path / "untrained.safetensors")
        save_regulariser(tmp_path / "untrained.safetensors", Regulariser(shape), about={})
    method = OPTIMISATIONS[request.param](**settings)
    return lambda volume: chosen(volume, method)


def volume_of(*pixels, first=0):
    """One row of pixels, each a list of costs."""
    cost = torch.tensor([pixels], dtype=torch.float32)
    return CostVolume(cost, range(first, first + cost.shape[2]))


@pytest.mark.parametrize("method", [SemiGlobal(), WinnerTakesAll()])
def test_a_clear_winner_is_chosen_in_units_of_disparity(method):
    disparity = chosen(volume_of([1, 1, 0, 1, 1], [1, 0, 1, 1, 1], first=-7), method)

    assert disparity.values.round().tolist() == [[-5, -6]]
    assert (disparity.status == int(PixelStatus.MATCHED)).all()


def test_a_pixel_without_candidates_is_outside(optimisation):
    disparity = optimisation(volume_of([INF, INF, INF], [INF, 0.5, INF]))

    assert disparity.status.tolist() == [[int(PixelStatus.OUTSIDE), int(PixelStatus.MATCHED)]]
    assert disparity.values.isnan().tolist() == [[True, False]]
    assert disparity.confidence[0, 0] == 0


def test_the_volume_is_left_alone(optimisation, generator):
    cost = torch.rand((4, 5, 6), generator=generator)
    before = cost.clone()

    optimisation(CostVolume(cost, range(6)))

    assert torch.equal(cost, before)


def test_confidence_grows_with_the_margin_of_the_winner():
    equal, slight, clear, sure = (
        [rival, 1, 1 - 0.001, 1, rival] if rival == 1 else [rival, 0.5, 0.1, 0.5, rival]
        for rival in (1, 0.2, 0.4, 1000.0)
    )

    confidence = chosen(volume_of(equal, slight, clear, sure)).confidence[0]

    assert (confidence.diff() > 0).all()
    assert confidence[0] < 0.01
    assert confidence[-1] > 0.99


def test_the_neighbours_of_the_winner_are_no_rivals():
    confidence = chosen(volume_of([1.0, 0.1001, 0.1, 0.1001, 1.0])).confidence

    assert confidence.item() == pytest.approx(0.9)


class TestSubpixel:
    @pytest.mark.parametrize("lowest_at", [1.6, 2.0, 2.3, 2.49])
    def test_the_lowest_point_of_a_parabola_is_found(self, lowest_at):
        cost = [(k - lowest_at) ** 2 for k in range(5)]

        assert chosen(volume_of(cost)).values.item() == pytest.approx(lowest_at, 1e-5)

    @pytest.mark.parametrize("lowest_at", [1.6, 2.0, 2.3, 2.49])
    def test_the_crossing_of_two_equally_steep_lines_is_found(self, lowest_at):
        cost = [abs(k - lowest_at) for k in range(5)]

        found = chosen(volume_of(cost), WinnerTakesAll(shared_slope=0.0)).values.item()

        assert found == pytest.approx(lowest_at, 1e-5)

    def test_a_slope_that_both_sides_share_is_taken_off(self):
        """Sides of 0.6 and 0.3 with half of the lesser taken off: (0.6 - 0.3) / 2 (0.6 - 0.15)."""
        found = chosen(volume_of([0.8, 0.2, 0.5]), WinnerTakesAll(shared_slope=0.5)).values.item()

        assert found == pytest.approx(1 + 1 / 3)

    @pytest.mark.parametrize("method", [WinnerTakesAll, SemiGlobal])
    @pytest.mark.parametrize("share", [-1.1, 1.0])
    def test_a_slope_that_cannot_be_shared_is_refused(self, method, share):
        with pytest.raises(ValueError, match="shared_slope must be in"):
            method(shared_slope=share)

    @pytest.mark.parametrize(
        "cost",
        [[0.1, 0.2, 0.9], [0.9, 0.2, 0.1], [INF, 0.1, 0.2], [0.2, 0.1, INF], [0.5, 0.5, 0.5]],
        ids=["first", "last", "beside_missing", "before_missing", "flat"],
    )
    def test_without_two_higher_neighbours_the_candidate_itself_is_kept(self, cost):
        value = chosen(volume_of(cost)).values.item()

        assert value == min(range(3), key=cost.__getitem__)

    def test_it_can_be_left_out(self):
        assert chosen(volume_of([0.9, 0.1, 0.2]), WinnerTakesAll(subpixel=False)).values.item() == 1

    @pytest.mark.parametrize("method", ["ssd", "zncc"])
    @pytest.mark.parametrize("true_disparity", [3.25, 3.5, 4.1])
    def test_a_shifted_smooth_texture_is_located_within_a_fifth_of_a_pixel(
        self, method, true_disparity, smooth_texture
    ):
        left = smooth_texture(40, 80)
        columns = torch.arange(80) + true_disparity
        low = columns.floor().long().clamp(max=78)
        share = (columns - low).clamp(0, 1)[None, :, None]
        right = left[:, low] * (1 - share) + left[:, low + 1] * share

        volume = MATCHING_COSTS[method]()(left, right, range(9))
        error = chosen(volume).values[8:-8, 16:-16] - true_disparity

        assert error.abs().mean() < 0.2
        assert (
            chosen(volume, WinnerTakesAll(subpixel=False)).values[8:-8, 16:-16].frac().abs().max()
            == 0
        )


def test_a_pair_of_pixels_has_one_cost_from_either_view(generator):
    volume = CostVolume(torch.rand((3, 12, 7), generator=generator), range(-2, 5))

    right = volume.seen_from_right()

    for x in range(12):
        for k, d in enumerate(volume.disparities):
            expected = volume.cost[:, x + d, k] if 0 <= x + d < 12 else torch.full((3,), INF)
            assert torch.equal(right.cost[:, x, k], expected)


class TestSemiGlobal:
    def test_an_ambiguous_pixel_takes_the_disparity_of_its_neighbours(self):
        sure, torn = [9.0, 0.0, 9.0, 9.0, 9.0], [9.0, 0.31, 9.0, 9.0, 0.3]
        volume = volume_of(sure, sure, torn, sure, sure)

        alone, together = chosen(volume), chosen(volume, SemiGlobal(large_step=0.4))

        assert alone.values[0].round().tolist() == [1, 1, 4, 1, 1]
        assert together.values[0].round().tolist() == [1, 1, 1, 1, 1]

    def test_a_step_costs_less_across_an_edge_of_the_view(self):
        near, far = [0.0, 9.0, 9.0, 9.0], [0.05, 9.0, 9.0, 0.0]  # two of eight paths pay a step
        volume = CostVolume(torch.tensor([[near, near, far, near, near]]), range(4))
        guide = torch.zeros(1, 5, 3)
        guide[0, 2] = 1.0
        method = SemiGlobal(small_step=0.05, large_step=0.4, across_edge=0.2)

        plain, edged = chosen(volume, method), method(volume, guide=guide)

        assert plain.values[0, 2].round() == 0
        assert edged.values[0, 2].round() == 3

    @pytest.mark.parametrize(
        ("settings", "message"),
        [
            ({"small_step": 0.5, "large_step": 0.4}, "0 <= small_step <= large_step, got 0.5"),
            ({"small_step": -0.1}, "0 <= small_step"),
            ({"directions": 5}, "directions must be 4 or 8, got 5"),
            ({"across_edge": 1.5}, r"across_edge must be in \[0, 1\], got 1.5"),
        ],
    )
    def test_settings_that_cannot_be_are_refused(self, settings, message):
        with pytest.raises(ValueError, match=message):
            SemiGlobal(**settings)
