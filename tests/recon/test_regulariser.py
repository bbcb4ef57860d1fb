"""The network that looks around among the costs, its file, and the optimisation made of it."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors import safe_open

from recon.networks import Regulariser, RegulariserShape, load_regulariser, save_regulariser
from recon.networks.regulariser import BLOCK, _blocks, _peak, _sample
from recon.networks.weights import SHIPPED
from recon.optimisation import LearnedOptimisation, SemiGlobal
from recon.optimisation.learned import PATHS, hints
from recon.settings import load_preset
from recon.training.confidence import match_generated
from recon.training.misalignment import Pairs
from recon.training.regulariser_loss import regulariser_loss
from recon.training.regulariser_run import AGGREGATION
from recon.types import CostVolume, PixelStatus

SMALL = RegulariserShape(cells=(4, 6, 8, 8), context=(4, 6, 6, 8, 8, 8), fine=6)


@pytest.fixture
def network():
    torch.manual_seed(3)
    return Regulariser(SMALL).eval()


@pytest.fixture
def weights(network, tmp_path):
    path = tmp_path / "small.safetensors"
    save_regulariser(path, network, about={"commit": "none"})
    return path


def random_costs(height, width, count):
    """Return costs of a left view, +inf where there is no partner."""
    cost = torch.rand(height, width, count, generator=torch.Generator().manual_seed(7))
    outside = torch.arange(width)[:, None] < torch.arange(count)
    return cost.masked_fill(outside, torch.inf)


def random_view(height, width):
    return torch.rand(height, width, 3, generator=torch.Generator().manual_seed(8))


def inputs(cost, view):
    """Return what the network takes, a batch of one."""
    return [part[None] for part in (cost, *hints(cost, view), view.permute(2, 0, 1))]


@torch.inference_mode()
def estimate(network, cost, view):
    return network(*inputs(cost, view))


class TestNetwork:
    @pytest.mark.parametrize("size", [(32, 64, 16), (33, 47, 5), (5, 40, 1), (64, 32, 50)])
    def test_any_size_and_any_number_of_candidates_give_a_disparity_a_pixel(self, network, size):
        height, width, _ = size

        found = estimate(network, random_costs(*size), random_view(height, width))

        for part in (found.disparity, found.log_scale, found.occlusion, found.enlarged):
            assert part.shape == (1, height, width)
            assert part.isfinite().all()

    def test_pixels_without_any_candidate_do_no_harm(self, network):
        cost = random_costs(32, 64, 16)
        cost[:, :20] = torch.inf

        found = estimate(network, cost, random_view(32, 64))

        assert found.disparity.isfinite().all()

    def test_a_block_holds_the_costs_of_its_pixels_and_candidates(self):
        volume = torch.arange(8 * 8 * 8.0).reshape(1, 8, 8, 8)

        blocks = _blocks(volume)

        assert blocks.shape == (1, 2, 2, 2, BLOCK**3)
        assert blocks[0, 1, 0, 1].tolist() == volume[0, 4:, :4, 4:].flatten().tolist()

    def test_the_peak_is_the_mean_near_the_best_and_ignores_a_second_one_far_off(self):
        logits = torch.full((1, 1, 1, 40), -20.0)
        logits[..., 10], logits[..., 11] = 5.0, 5.0
        logits[..., 30] = 4.9

        place, chance = _peak(logits)

        assert place.item() == pytest.approx(10.5, abs=1e-3)
        assert chance.item() == pytest.approx(2 / (2 + np.exp(-0.1)), abs=1e-3)

    def test_costs_are_read_between_candidates_and_are_nothing_outside(self):
        cost = torch.tensor([0.75, 0.25, 0.5, float("inf")]).expand(1, 1, 1, 4)
        wanted = torch.tensor([0.5, 1.25, 2.0, 2.5, 3.0, -2.0, 4.0]).reshape(1, 7, 1, 1)

        read = _sample(cost, wanted).flatten().tolist()

        assert read == [0.5, 0.6875, 0.5, 0.25, 0.0, 0.0, 0.0]

    def test_what_lies_beyond_the_image_is_like_nothing(self):
        cost = torch.full((1, 2, 3, 4), 0.25)

        read = _sample(cost, torch.ones(1, 5, 4, 8))

        assert read[..., :2, :3].eq(0.75).all()
        assert read.sum() == 0.75 * 5 * 2 * 3

    def test_the_volume_may_be_seen_some_rows_at_a_time(self, network, monkeypatch):
        cost, view = random_costs(30, 50, 13), random_view(30, 50)
        whole = estimate(network, cost, view)

        monkeypatch.setattr("recon.networks.regulariser.CELLS_AT_ONCE", 8 * 50 * 13)

        for one, other in zip(whole, estimate(network, cost, view), strict=True):
            torch.testing.assert_close(one, other)

    def test_folding_the_normalisation_changes_nothing(self, network):
        cost, view = random_costs(32, 64, 16), random_view(32, 64)
        network.train()
        for _ in range(3):  # means and spreads that are not 0 and 1
            estimate(network, cost, view)
        network.eval()

        fused = network.fused()

        assert not any("BatchNorm" in type(layer).__name__ for layer in fused.modules())
        for one, other in zip(
            estimate(network, cost, view), estimate(fused, cost, view), strict=True
        ):
            torch.testing.assert_close(one, other, rtol=1e-3, atol=1e-3)

    def test_the_winner_of_the_paths_is_a_hypothesis_of_its_pixel(self, network):
        cost, view = random_costs(32, 64, 16), random_view(32, 64)
        chooser = network.pixel_weights[-1]
        with torch.no_grad():
            chooser.bias[-1] = 1e3  # nothing else is chosen

        found = estimate(network, cost, view)

        torch.testing.assert_close(found.enlarged[0], hints(cost, view)[1])

    @pytest.mark.parametrize(("neighbour", "down", "across"), [(4, 0, 0), (0, -1, -1), (5, 0, 1)])
    def test_a_pixel_may_choose_any_block_around_its_own(self, network, neighbour, down, across):
        blocks, pixels = network.block_weights, network.pixel_weights[-1]
        with torch.no_grad():
            for part in (*blocks.parameters(), *pixels.parameters()):
                part.zero_()
            blocks.bias.reshape(9, BLOCK**2)[neighbour] = 1e3  # nothing else is chosen

        found = estimate(network, random_costs(32, 64, 16), random_view(32, 64))

        peaks, _ = _peak(found.logits)
        chosen = peaks[0].roll((-down, -across), (0, 1))[1:-1, 1:-1]
        inside = found.enlarged[0, BLOCK:-BLOCK, BLOCK:-BLOCK]
        torch.testing.assert_close(inside[::BLOCK, ::BLOCK], chosen)
        torch.testing.assert_close(inside[BLOCK - 1 :: BLOCK, BLOCK - 1 :: BLOCK], chosen)

    def test_paths_take_part_in_the_logits(self, network):
        cost, paths, winner, guide = inputs(random_costs(32, 64, 16), random_view(32, 64))

        with torch.inference_mode():
            ours = network(cost, paths, winner, guide).logits
            others = network(cost, paths.flip(1), winner, guide).logits

        assert not torch.allclose(ours, others)

    def test_it_learns_where_the_cost_is_lowest(self):
        torch.manual_seed(0)
        network = Regulariser(SMALL)
        optimiser = torch.optim.Adam(network.parameters(), 1e-2)
        disparity = torch.full((64, 64), 3.0)
        disparity[:, 32:] = 9.0
        cost = (0.1 * (torch.arange(16) - disparity[..., None]).abs()).clamp_max(0.8)
        view = torch.zeros(64, 64, 3)
        view[:, 32:] = 1.0
        given = inputs(cost, view)
        visible = torch.ones(1, 64, 64, dtype=torch.bool)
        pairs = Pairs(given[-1], given[-1], disparity[None], visible)

        losses = []
        for _ in range(60):
            loss = regulariser_loss(network(*given), pairs)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            losses.append(loss.item())

        found = network(*given).disparity
        assert losses[-1] < 0.3 * losses[0]
        assert (found - disparity).abs().median() < 0.5

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"cells": (16, 16)}, "has 4 sizes of cells and 6 of context"),
            ({"fine": 0}, "cells, context and fine must be positive"),
        ],
    )
    def test_a_shape_that_cannot_be_is_refused(self, changes, message):
        with pytest.raises(ValueError, match=message):
            RegulariserShape(**changes)


class TestLoss:
    def test_hidden_pixels_count_less(self, network):
        truth = torch.full((1, 32, 64), 4.0)
        truth[..., 32:] = 40.0  # beyond the candidates: nothing but the errors counts there
        everything = torch.ones_like(truth, dtype=torch.bool)
        with torch.no_grad():
            found = network(*inputs(random_costs(32, 64, 16), torch.zeros(32, 64, 3)))
        wrong = found._replace(disparity=torch.full_like(truth, 4.0), enlarged=truth)
        view = torch.zeros(1, 3, 32, 64)

        def error(visible):
            pairs = Pairs(view, view, truth, visible)
            right = regulariser_loss(wrong._replace(disparity=truth), pairs)
            return (regulariser_loss(wrong, pairs) - right).item()

        hidden = everything.clone()
        hidden[..., 32:] = False
        assert 0 < error(hidden) < 0.6 * error(everything)

    def test_what_is_said_of_error_and_occlusion_is_held_against_the_truth(self, network):
        view, truth = torch.zeros(1, 3, 32, 64), torch.full((1, 32, 64), 4.0)
        visible = torch.arange(64).expand(1, 32, 64) >= 32
        with torch.no_grad():
            found = network(*inputs(random_costs(32, 64, 16), torch.zeros(32, 64, 3)))
        found = found._replace(disparity=truth + 2.0, enlarged=truth)

        def loss(**said):
            told = found._replace(**{k: torch.full_like(truth, v) for k, v in said.items()})
            return regulariser_loss(told, Pairs(view, view, truth, visible)).item()

        scale = {b: loss(log_scale=np.log(b)) for b in (0.5, 2.0, 8.0)}
        assert min(scale, key=scale.get) == 2.0
        hidden = torch.where(visible, -5.0, 5.0)
        right, wrong = (
            regulariser_loss(found._replace(occlusion=sign * hidden),
                             Pairs(view, view, truth, visible)).item()
            for sign in (1, -1)
        )  # fmt: skip
        assert right < wrong


class TestWeights:
    def test_what_is_saved_is_loaded_again(self, network, weights):
        loaded = load_regulariser(str(weights))

        cost, view = random_costs(32, 64, 16), random_view(32, 64)
        ours, theirs = (estimate(one, cost, view).disparity for one in (network, loaded))
        torch.testing.assert_close(ours, theirs)
        assert loaded.shape == SMALL

    def test_weights_of_a_feature_network_are_refused_by_name(self):
        with pytest.raises(ValueError, match=r"fast\.safetensors does not hold .* a regulariser"):
            load_regulariser("fast")

    def test_a_damaged_file_is_refused_by_name(self, weights):
        weights.write_bytes(weights.read_bytes()[:2000])

        with pytest.raises(ValueError, match=r"small\.safetensors does not hold .* a regulariser"):
            load_regulariser(str(weights))


@pytest.mark.slow
def test_the_weights_that_ship_find_more_than_the_paths_alone():
    """On pairs far from those of any training; the weights were made to do so."""
    ours, theirs = (
        match_generated(load_preset(name).matcher, range(30_000_000, 30_000_008)).right
        for name in ("context", "best")
    )

    assert ours.float().mean() > theirs.float().mean() + 0.01


class TestHints:
    def test_the_weights_know_the_stages_of_the_preset_best(self):
        best = load_preset("best").matcher

        assert replace(best.optimisation, large_step=3.75) == PATHS
        assert best.aggregation == AGGREGATION

    def test_the_weights_know_the_cost_of_the_preset_context(self):
        cost = load_preset("context").matcher.matching_cost
        with safe_open(SHIPPED / "regulariser.safetensors", framework="pt") as file:
            header = file.metadata()

        census = header.get("census_share", "0.0")  # older trainings knew none
        trained_on = header["cost_weights"], header["direct_share"], census
        assert trained_on == (cost.weights, str(cost.direct_share), str(cost.census_share))

    def test_the_paths_are_those_of_semi_global_matching(self):
        cost, view = random_costs(8, 20, 6), random_view(8, 20)
        matching = SemiGlobal(0.5, 3.75, across_edge=0.2, directions=4, shared_slope=-0.4)

        paths, winner = hints(cost, view)

        torch.testing.assert_close(winner, matching(CostVolume(cost, range(6)), guide=view).values)
        assert torch.equal(paths.isfinite(), cost.isfinite())
        assert (paths >= cost)[cost.isfinite()].all()  # a path never costs less than its end

    def test_a_pixel_without_candidates_has_a_number_all_the_same(self):
        cost = random_costs(8, 20, 6)
        cost[:, :3] = torch.inf

        paths, winner = hints(cost, random_view(8, 20))

        assert paths[:, :3].isinf().all()
        assert (winner[:, :3] == 0).all()


class TestOptimisation:
    def test_the_right_view_is_the_left_view_of_the_mirrored_pair(self, weights):
        optimisation = LearnedOptimisation(str(weights))
        cost, view = random_costs(32, 64, 16), random_view(32, 64)
        of_left = optimisation(CostVolume(cost, range(16)), guide=view)

        mirrored = CostVolume(cost.flip(1), range(16), of_right=True)
        of_right = optimisation(mirrored, guide=view.flip(1))

        torch.testing.assert_close(of_right.values, of_left.values.flip(1))
        torch.testing.assert_close(of_right.confidence, of_left.confidence.flip(1))

    def test_where_the_paths_say_nearly_the_same_the_mean_is_taken(self, weights):
        cost, view = random_costs(32, 64, 16), random_view(32, 64)
        volume = CostVolume(cost, range(16))
        _, winner = hints(cost, view)

        alone = LearnedOptimisation(str(weights), averaged_px=0)(volume, guide=view).values
        mixed = LearnedOptimisation(str(weights), averaged_px=3)(volume, guide=view).values

        near = (alone - winner).abs() <= 3
        assert 0.05 < near.float().mean() < 0.95
        torch.testing.assert_close(mixed[near], ((alone + winner) / 2)[near])
        assert torch.equal(mixed[~near], alone[~near])

    def test_what_the_network_doubts_is_decided_by_the_paths(self, network, tmp_path):
        torch.nn.init.normal_(network.correction[-1].weight)  # else it doubts all alike
        weights = tmp_path / "doubting.safetensors"
        save_regulariser(weights, network, about={})
        cost, view = random_costs(32, 64, 16), random_view(32, 64)
        volume = CostVolume(cost, range(16))
        _, winner = hints(cost, view)
        optimisation = LearnedOptimisation(str(weights), averaged_px=0, precision="float32")
        alone = optimisation(volume, guide=view)
        scale = -1 / torch.log1p(-alone.confidence)  # confidence is 1 - exp(-1 / b)
        limit = float(scale.median())

        found = replace(optimisation, doubted_px=limit)(volume, guide=view)

        hidden = estimate(network.fused(), cost, view).occlusion[0] >= 0
        doubted, sure = scale > limit * (1 + 1e-5), scale < limit * (1 - 1e-5)
        for part in (doubted & ~hidden, doubted & hidden, sure):
            assert part.float().mean() > 0.02
        torch.testing.assert_close(found.values[doubted & ~hidden], winner[doubted & ~hidden])
        assert torch.equal(found.values[doubted & hidden], alone.values[doubted & hidden])
        assert torch.equal(found.values[sure], alone.values[sure])
        assert torch.equal(found.confidence, alone.confidence)

    def test_a_negative_distance_is_refused(self):
        with pytest.raises(ValueError, match="averaged_px must not be negative, got -1"):
            LearnedOptimisation(averaged_px=-1)
        with pytest.raises(ValueError, match="doubted_px must not be negative, got nan"):
            LearnedOptimisation(doubted_px=float("nan"))

    def test_a_volume_of_the_right_view_says_so(self):
        volume = CostVolume(random_costs(4, 20, 6), range(6))

        assert not volume.of_right
        assert volume.seen_from_right().of_right

    def test_disparities_count_from_the_first_candidate_and_stay_among_them(self, weights):
        optimisation = LearnedOptimisation(str(weights))
        cost, view = random_costs(32, 64, 16), random_view(32, 64)

        here = optimisation(CostVolume(cost, range(16)), guide=view)
        there = optimisation(CostVolume(cost, range(-5, 11)), guide=view)

        torch.testing.assert_close(here.values - 5, there.values)
        assert here.values.min() >= 0
        assert here.values.max() <= 15

    def test_only_pixels_without_any_candidate_are_outside(self, weights):
        cost = random_costs(32, 64, 16)
        cost[:, :20] = torch.inf

        found = LearnedOptimisation(str(weights))(
            CostVolume(cost, range(16)), guide=random_view(32, 64)
        )

        outside = found.status == int(PixelStatus.OUTSIDE)
        assert outside[:, :20].all()
        assert not outside[:, 20:].any()
        assert found.confidence.min() >= 0
        assert found.confidence.max() <= 1
