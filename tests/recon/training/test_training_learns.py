"""What the weights follow from, and that the loss falls."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from small_trainings import CPU, draw_bands, weights_of

from recon.networks import Architecture, FeatureNetwork, architecture
from recon.training import scenes
from recon.training.batches import pairs_for
from recon.training.feature_run import FeatureRun, winners
from recon.training.pool import fill_pool
from recon.training.settings import FeatureTraining
from recon.training.train import train
from recon.training.validation import validate


def test_the_rate_rises_first_and_ends_near_zero(settings):
    run, rates = FeatureRun(settings, CPU), []
    with pairs_for(replace(settings, source="pool"), "cpu") as source:
        for _ in range(settings.steps):
            run.update(source)
            rates.append(run.optimiser.param_groups[0]["lr"] / settings.learning_rate)

    assert rates[0] == pytest.approx(0.5)
    assert max(rates) == rates[1]
    assert rates[1:] == sorted(rates[1:], reverse=True)
    assert rates[-1] < 0.1


def test_what_the_right_view_does_not_see_teaches_nothing(settings, tmp_path, monkeypatch):
    def trained(hidden_px):
        def draw(*words, **more):
            sample = draw_bands(*words, **more)
            disparity, visible = sample.disparity_left.clone(), sample.visible.clone()
            disparity[:, 40:60], visible[:, 40:60] = hidden_px, False
            return replace(sample, disparity_left=disparity, visible=visible)

        monkeypatch.setattr("recon.training.pool.draw", draw)
        folder = tmp_path / str(hidden_px)
        return train(
            replace(
                settings,
                pool=folder / "pool",
                out=folder / "out",
                edges_from=settings.steps,
                geometric=False,
                occluders=False,
            )
        )

    assert torch.equal(weights_of(trained(9.0)), weights_of(trained(3.5)))


def test_without_augmentation_the_network_sees_the_pairs_as_they_are(settings):
    kinds = ("photometric", "geometric", "occluders")
    bare = replace(settings, source="pool", **dict.fromkeys(kinds, False))

    def seen(settings):
        with pairs_for(bare, "cpu") as source:
            return FeatureRun(settings, CPU).update(source).pairs

    plain = seen(bare)
    assert (plain.left * 255 - (plain.left * 255).round()).abs().max() < 1e-3
    for kind in kinds:
        one = seen(replace(bare, **{kind: True}))
        assert not all(torch.equal(*parts) for parts in zip(one, plain, strict=True))


def test_edges_count_more_only_from_their_step_on(settings, tmp_path):
    def trained(**changes):
        folder = "_".join(map(str, changes.values()))
        return weights_of(train(replace(settings, out=tmp_path / folder, **changes)))

    never = trained(edges_from=6)

    assert torch.equal(trained(edge_weight=0.0, edges_from=0), never)
    assert not torch.equal(trained(edges_from=5), never)


def test_the_pairs_for_validation_are_never_trained_on(settings):
    for source in ("pool", "fresh"):
        with pairs_for(replace(settings, source=source), "cpu") as pairs:
            offered = {seed for step in range(6) for seed in pairs.seeds(step)}

        assert offered
        assert not offered & set(settings.validation_seeds)


def test_scores_are_those_of_fixed_pairs_with_and_without_augmentation(settings):
    network = FeatureNetwork(Architecture()).eval()

    first, second = (
        validate(winners(network), settings.pool, settings.validation_seeds, step=0, device=CPU)
        for _ in range(2)
    )

    assert first == second
    assert first.augmented != first.plain
    assert min(first.augmented, first.plain) > 0
    assert max(first.augmented, first.plain) <= 1


@pytest.mark.slow
def test_two_hundred_steps_on_generated_scenes_lower_the_loss_by_a_fifth(tmp_path, monkeypatch):
    monkeypatch.setattr("recon.training.pool.draw", scenes.draw)
    plain = Architecture(channels=(16, 16), depth=2, features=16)
    monkeypatch.setattr(architecture, "VARIANTS", {"plain": plain})
    settings = FeatureTraining(
        variant="plain",
        source="pool",
        out=tmp_path,
        pool=tmp_path / "pool",
        pairs=16,
        validation_pairs=4,
        steps=200,
        batch=2,
        crop_rows=32,
        learning_rate=1e-2,
        warm_up=20,
        edges_from=200,
        size=(160, 96),
    )
    list(fill_pool(settings.pool, range(16), settings.size, workers=0))
    run = FeatureRun(settings, CPU)

    with pairs_for(settings, "cpu") as source:
        losses = [float(run.update(source).loss) for _ in range(200)]

    assert np.mean(losses[-20:]) < 0.8 * np.mean(losses[:10])
