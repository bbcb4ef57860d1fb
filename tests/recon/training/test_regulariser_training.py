"""The training of the regulariser: what it follows from, what it writes, and that it learns."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors import safe_open
from small_trainings import CPU, KEPT, PAIRS, SIZE, left_off_at, weights_of

from recon.matching_cost import LearnedCost
from recon.networks import RegulariserShape, load_regulariser
from recon.optimisation.learned import hints
from recon.training import regulariser_run
from recon.training.batches import pairs_for
from recon.training.progress import Scores
from recon.training.regulariser_run import RegulariserRun
from recon.training.settings import FeatureTraining, RegulariserTraining
from recon.training.train import train

SMALL = RegulariserShape(cells=(4, 6, 8, 8), context=(4, 6, 6, 8, 8, 8), fine=6)


@pytest.fixture
def settings(pool, tmp_path, monkeypatch):
    monkeypatch.setattr(regulariser_run, "RegulariserShape", lambda: SMALL)
    return RegulariserTraining(
        source="pool",
        out=tmp_path / "out",
        pool=pool,
        pairs=PAIRS,
        validation_pairs=KEPT,
        workers=0,
        steps=4,
        crop_rows=32,
        warm_up=2,
        size=SIZE,
        save_every=2,
    )


def test_the_same_seed_gives_the_same_weights_and_another_gives_others(settings, tmp_path):
    def trained(name, **changes):
        return weights_of(train(replace(settings, out=tmp_path / name, **changes)))

    first = trained("first")

    assert torch.equal(trained("again"), first)
    assert not torch.equal(trained("other", seed=1), first)


def test_a_run_that_was_killed_ends_at_the_same_weights(settings, tmp_path):
    whole = weights_of(train(replace(settings, out=tmp_path / "whole")))

    left_off_at(settings, 2)

    assert torch.equal(weights_of(train(settings)), whole)


def test_training_goes_on_from_given_weights(settings, tmp_path):
    first = train(replace(settings, out=tmp_path / "first"))
    stored = str(tmp_path / "first" / "regulariser.safetensors")

    further = replace(settings, out=tmp_path / "further", begin_from=stored)

    at_first = RegulariserRun(further, CPU)
    assert torch.equal(weights_of(at_first.trained), weights_of(first))
    assert not torch.equal(weights_of(train(further)), weights_of(first))
    with pytest.raises(ValueError, match="no such file"):
        RegulariserRun(replace(further, begin_from=str(tmp_path / "none.safetensors")), CPU)


def test_weights_and_card_say_what_they_are(settings):
    scores = []
    network = train(settings, observe=lambda _, result: scores.append(result))

    written = load_regulariser(str(settings.out / "regulariser.safetensors"))
    assert written.shape == SMALL
    torch.testing.assert_close(weights_of(written), weights_of(network.fused()))
    with safe_open(settings.out / "regulariser.safetensors", framework="pt") as file:
        header = file.metadata()
    assert header["command"].startswith("reconstruct train regulariser --source pool --pairs 5")
    said = [header[name] for name in ("cost_weights", "direct_share", "census_share")]
    assert said == ["fast", "0.4", "0.0"]
    card = (settings.out / "regulariser.md").read_text()
    (last,) = [one for one in scores if isinstance(one, Scores) and one.step == 4]
    assert "# `regulariser`: weights of the regulariser" in card
    assert f"{last.plain:.1%}; with augmentation {last.augmented:.1%}" in card
    assert (settings.out / "log" / "step_000004.png").exists()


def test_a_checkpoint_of_the_other_network_is_refused(settings):
    train(settings)
    other = FeatureTraining(out=settings.out, pool=settings.pool, pairs=PAIRS, size=SIZE,
                            validation_pairs=KEPT, source="pool", crop_rows=32)  # fmt: skip

    with pytest.raises(ValueError, match=r"checkpoint\.pt is of a run with "):
        train(other)


def test_the_network_sees_what_the_matcher_computes(settings):
    cost = LearnedCost("fast", direct_share=0.4, census_share=0.5)
    run = RegulariserRun(replace(settings, census_share=0.5), CPU)
    left, right = torch.rand(2, 2, 3, 20, 30, generator=torch.Generator().manual_seed(4))

    costs, paths, winner = regulariser_run._seen(run.cost, left, right, 12)

    view, other = (pair[1].permute(1, 2, 0).contiguous() for pair in (left, right))
    expected = regulariser_run.AGGREGATION(cost(view, other, range(12)), guide=view).cost
    assert torch.equal(costs[1], expected)
    for found, hint in zip((paths[1], winner[1]), hints(expected, view), strict=True):
        assert torch.equal(found, hint)


def test_more_candidates_are_searched_than_there_are_but_not_too_many(settings):
    run = RegulariserRun(replace(settings, spare_range=1.0, most_candidates=64), CPU)

    counts = {run._candidates(torch.tensor([30.0])) for _ in range(50)}
    tight = RegulariserRun(replace(settings, spare_range=0.0), CPU)

    assert counts == {48, 64}
    assert tight._candidates(torch.tensor([30.0])) == 48
    assert tight._candidates(torch.tensor([28.5])) == 32


@pytest.mark.slow
def test_the_loss_falls(settings):
    run = RegulariserRun(replace(settings, steps=120, learning_rate=5e-3, warm_up=5), CPU)

    with pairs_for(settings, "cpu") as source:
        losses = [float(run.update(source).loss) for _ in range(120)]

    assert np.mean(losses[-10:]) < 0.4 * np.mean(losses[:5])
