"""A training can be repeated, stopped and resumed."""

import time
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors import safe_open
from small_trainings import CPU, PAIRS, Killed, draw_bands, killed_at, left_off_at, weights_of

from recon.networks import FeatureNetwork, architecture, save_features
from recon.training.batches import pairs_for
from recon.training.feature_run import FeatureRun
from recon.training.progress import Scores, Stopped
from recon.training.train import train


def test_the_same_seed_gives_the_same_weights_and_another_gives_others(settings, tmp_path):
    one = train(settings)
    same = train(replace(settings, out=tmp_path / "same"))
    other = train(replace(settings, out=tmp_path / "other", seed=1))

    assert torch.equal(weights_of(one), weights_of(same))
    assert not torch.equal(weights_of(one), weights_of(other))


@pytest.mark.parametrize("source", ["pool", "fresh"])
@pytest.mark.parametrize("step", [2, 4])
def test_a_run_that_was_killed_and_resumed_ends_at_the_same_weights(
    settings, tmp_path, source, step
):
    settings = replace(settings, source=source)
    whole = train(replace(settings, out=tmp_path / "whole"))

    left_off_at(settings, step)
    resumed = train(settings)

    assert torch.equal(weights_of(resumed), weights_of(whole))


def test_a_run_in_parts_of_few_minutes_ends_at_the_same_weights(settings, tmp_path):
    whole = train(replace(settings, out=tmp_path / "whole"))
    in_parts, stops = replace(settings, max_minutes=1e-9), []

    parts = [train(in_parts, observe=lambda _, result: stops.append(result)) for _ in range(6)]

    assert parts[:5] == [None] * 5
    assert torch.equal(weights_of(parts[5]), weights_of(whole))
    assert [stop.step for stop in stops if isinstance(stop, Stopped)] == [1, 2, 3, 4, 5]


def test_how_often_it_saves_changes_no_weight(settings, tmp_path):
    often = train(settings)
    seldom = train(replace(settings, out=tmp_path / "seldom", save_every=100))

    assert torch.equal(weights_of(often), weights_of(seldom))


def test_a_finished_run_writes_the_same_weights_again(settings):
    once = train(settings)

    again = train(settings)

    assert torch.equal(weights_of(once), weights_of(again))


def test_time_that_is_up_while_pairs_are_drawn_keeps_the_pairs(settings, tmp_path, monkeypatch):
    def draw_slowly(*words, **more):
        time.sleep(0.1)
        return draw_bands(*words, **more)

    monkeypatch.setattr("recon.training.pool.draw", draw_slowly)
    settings = replace(settings, pool=tmp_path / "new", max_minutes=1e-9)

    found = train(settings)

    assert found is None
    assert not settings.out.exists()
    drawn = [path.name for path in sorted((tmp_path / "new").glob("*.npz"))]
    assert drawn[0] == "pair_000000.npz"
    assert len(drawn) < PAIRS


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
class TestOnADevice:
    def test_it_trains_on_fresh_pairs_and_is_taken_up_where_it_was_killed(self, settings):
        told = []
        with pytest.raises(Killed):
            train(settings, device="cuda", observe=killed_at(4))

        network = train(settings, device="cuda", observe=lambda _, result: told.append(result))

        with safe_open(settings.out / "small.safetensors", framework="pt") as file:
            assert file.metadata()["source"] == "fresh"
        assert [result.step for result in told if isinstance(result, Scores)] == [6]
        assert weights_of(network).isfinite().all()

    def test_the_first_losses_are_those_of_the_cpu(self, settings):
        """Without augmentation, whose randomness differs; in bfloat16, hence the tolerance."""
        kinds = ("photometric", "geometric", "occluders")
        settings = replace(settings, source="pool", **dict.fromkeys(kinds, False))

        losses = []
        for name in ("cpu", "cuda"):
            run = FeatureRun(settings, torch.device(name))
            with pairs_for(settings, name) as source:
                losses.append(float(run.update(source).loss))

        assert losses[0] == pytest.approx(losses[1], rel=0.03)


def test_a_wider_network_goes_on_from_the_weights_of_a_narrower_one(settings, tmp_path):
    narrow = replace(architecture.VARIANTS["small"], channels=(8,))
    network = FeatureNetwork(narrow).eval()
    stored = str(tmp_path / "narrow.safetensors")
    save_features(Path(stored), network, about={})
    further = replace(settings, begin_from=stored)
    image = torch.rand(1, 3, 32, 48)

    run = FeatureRun(further, CPU)

    torch.testing.assert_close(run.ready()(image), network(image))
    assert all(weight.requires_grad for weight in run.trained.parameters())
    assert not torch.allclose(train(further)(image), network(image), atol=1e-3)
