"""Training: it learns, it can be repeated, and it can be stopped and resumed."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch
from safetensors import safe_open

from recon.networks import Architecture, FeatureNetwork, load_features
from recon.training import train
from recon.training.augmentation import Augmentation
from recon.training.loss import matching_loss, near_edges, within_one_pixel
from recon.training.pool import draw_pair
from recon.training.train import Training

SIZE = (96, 64)
KEPT_FOR_VALIDATION = 2
PAIRS = KEPT_FOR_VALIDATION + 3


@pytest.fixture(scope="module")
def pool(tmp_path_factory):
    """Pairs that are drawn here: a pool of processes would take longer to start."""
    folder = tmp_path_factory.mktemp("pool")
    for seed in range(PAIRS):
        np.savez(folder / f"pair_{seed:06d}.npz", **draw_pair(seed, SIZE, samples=1))
    return folder


@pytest.fixture(autouse=True)
def small_network(monkeypatch):
    small = Architecture(channels=(8, 8), depth=1, features=8)
    monkeypatch.setattr(train, "Architecture", lambda: small)
    monkeypatch.setattr(train, "VALIDATION_PAIRS", KEPT_FOR_VALIDATION)


@pytest.fixture
def settings(pool, tmp_path):
    return Training(
        out=tmp_path / "out",
        pool=pool,
        pairs=PAIRS,
        steps=6,
        batch=1,
        crop_rows=32,
        edges_from=3,
        size=SIZE,
        save_every=2,
    )


def silent(line):
    pass


def weights_of(network):
    return torch.cat([value.flatten().double() for value in network.state_dict().values()])


class Stopped(Exception):  # noqa: N818  not an error
    pass


def stop_after(step, line):
    if line.startswith(f"step {step} within"):
        raise Stopped


def test_the_same_seed_gives_the_same_weights_and_another_gives_others(settings, tmp_path):
    one = settings(silent)
    same = replace(settings, out=tmp_path / "same")(silent)
    other = replace(settings, out=tmp_path / "other", seed=1)(silent)

    assert torch.equal(weights_of(one), weights_of(same))
    assert not torch.equal(weights_of(one), weights_of(other))


@pytest.mark.parametrize("step", [2, 4])
def test_a_run_that_was_killed_and_resumed_ends_at_the_same_weights(settings, tmp_path, step):
    whole = replace(settings, out=tmp_path / "whole")(silent)

    with pytest.raises(Stopped):
        settings(partial(stop_after, step))
    resumed = settings(silent)

    assert torch.equal(weights_of(resumed), weights_of(whole))


def test_how_often_it_saves_changes_no_weight(settings, tmp_path):
    often = settings(silent)
    seldom = replace(settings, out=tmp_path / "seldom", save_every=100)(silent)

    assert torch.equal(weights_of(often), weights_of(seldom))


def test_the_weights_are_written_with_the_settings_and_without_paths(settings, tmp_path):
    network = settings(silent)

    path = settings.out / "fast.safetensors"
    assert torch.equal(weights_of(load_features(str(path))), weights_of(network))
    with safe_open(path, framework="pt") as file:
        header = file.metadata()
    assert header["command"] == "python -m recon.training.train"
    assert header["steps"] == "6"
    assert header["size"] == "96 x 64"
    assert 0 <= float(header["generated pairs, within 1 px"]) <= 1
    assert not [value for value in header.values() if "/" in value]
    assert sorted(p.name for p in settings.out.iterdir()) == ["checkpoint.pt", "fast.safetensors"]


@pytest.mark.slow
def test_it_learns(settings):
    run = train._Run(replace(settings, steps=60, batch=2, edge_weight=0.0, learning_rate=2e-2))

    losses = [run.update() for _ in range(60)]

    assert np.mean(losses[-10:]) < np.mean(losses[:10]) - 0.08


@pytest.mark.parametrize(
    "damage",
    [
        lambda contents: b"",
        lambda contents: contents[:100],
        lambda contents: contents[: len(contents) // 2],
        lambda contents: b"not a checkpoint at all",
    ],
    ids=["empty", "short", "half", "text"],
)
def test_a_damaged_checkpoint_is_refused_by_name(settings, damage):
    with pytest.raises(Stopped):
        settings(partial(stop_after, 2))
    checkpoint = settings.out / "checkpoint.pt"
    checkpoint.write_bytes(damage(checkpoint.read_bytes()))

    with pytest.raises(ValueError, match=r"checkpoint\.pt is not a checkpoint of this network \("):
        settings(silent)


@pytest.mark.parametrize("contents", [{}, {"step": 1, "network": {}}, [1]])
def test_a_foreign_checkpoint_is_refused_by_name(settings, contents):
    settings.out.mkdir()
    torch.save(contents, settings.out / "checkpoint.pt")

    with pytest.raises(ValueError, match=r"checkpoint\.pt is not a checkpoint of this network \("):
        settings(silent)


def test_a_checkpoint_of_other_settings_is_refused(settings):
    with pytest.raises(Stopped):
        settings(partial(stop_after, 2))

    with pytest.raises(ValueError, match=r"is of a run with steps 6, not 8; give another --out"):
        replace(settings, steps=8)(silent)


def test_a_pool_of_another_size_is_refused(settings):
    with pytest.raises(ValueError, match=r"holds pairs of 96 x 64, not 96 x 48 \(width x height"):
        replace(settings, size=(96, 48))(silent)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("pairs", 2, r"pairs must be more than the 2 that are kept for validation, got 2"),
        ("crop_rows", 65, "crop_rows must be from 1 to the height of the pairs, 64, got 65"),
        ("crop_rows", 0, "crop_rows must be from 1"),
        ("steps", 0, "steps must be positive, got 0"),
        ("batch", 0, "batch must be positive, got 0"),
        ("learning_rate", -1.0, r"learning_rate must be positive, got -1\.0"),
    ],
)
def test_a_setting_that_cannot_be_is_refused(settings, name, value, message):
    with pytest.raises(ValueError, match=message):
        replace(settings, **{name: value})


class TestLoss:
    @pytest.fixture
    def row(self, generator):
        """Unit features of a row, seen by the right camera 3 px further left."""
        features = F_normalised(torch.randn(1, 32, 2, 40, generator=generator))
        return features, features.roll(-3, dims=3)

    def test_the_truth_surprises_least(self, row):
        sharpness = torch.tensor(20.0)
        weight = torch.ones(1, 2, 40)
        weight[:, :, -5:] = 0

        losses = [
            float(matching_loss(*row, torch.full((1, 2, 40), d), weight, sharpness))
            for d in (2.0, 2.5, 3.0, 3.5, 4.0)
        ]

        assert losses.index(min(losses)) == 2
        assert losses[2] < 0.1

    def test_pixels_without_weight_and_without_partner_do_not_count(self, row, generator):
        disparity, weight = torch.full((1, 2, 40), 3.0), torch.ones(1, 2, 40)
        weight[:, :, 20:] = 0
        changed = disparity.clone()
        changed[:, :, 20:] = 9.0
        sharpness = torch.tensor(5.0)

        one = matching_loss(*row, disparity, weight, sharpness)
        weight[:, :, :3] = 7  # their partners lie outside

        assert torch.equal(matching_loss(*row, changed, weight, sharpness), one)

    def test_nothing_to_learn_from_is_no_loss(self, row):
        loss = matching_loss(*row, torch.ones(1, 2, 40), torch.zeros(1, 2, 40), torch.tensor(5.0))

        assert loss == 0

    def test_the_score_is_the_share_of_pixels_within_one(self, row):
        visible = torch.zeros(1, 2, 40, dtype=torch.bool)
        visible[:, :, 5:35] = True

        scores = [
            within_one_pixel(*row, torch.full((1, 2, 40), d), visible) for d in (3.0, 4.0, 4.1)
        ]

        assert scores == [1.0, 1.0, 0.0]

    def test_edges_are_where_disparity_jumps_and_seven_pixels_around(self):
        disparity = torch.zeros(1, 1, 40)
        disparity[..., 20:] = 5.0

        near = near_edges(disparity)[0, 0]

        assert near.nonzero()[:, 0].tolist() == list(range(13, 28))
        assert not near_edges(torch.linspace(0, 30, 40).expand(1, 5, 40)).any()


def F_normalised(values):  # noqa: N802
    return torch.nn.functional.normalize(values, dim=1)


class TestAugmentation:
    def test_the_pair_stays_a_pair_of_images(self, generator):
        left, right = (torch.rand(3, 3, 20, 30, generator=generator) for _ in range(2))
        before = left.clone()

        changed = Augmentation()(left, right, generator)

        for view in changed:
            assert view.shape == left.shape
            assert view.min() >= 0
            assert view.max() <= 1
        assert torch.equal(left, before)
        assert not torch.equal(changed[0], left)

    def test_the_same_seed_changes_in_the_same_way(self):
        left = torch.rand(2, 3, 16, 16, generator=torch.Generator().manual_seed(0))

        one, same = (Augmentation()(left, left, torch.Generator().manual_seed(4)) for _ in range(2))

        assert all(torch.equal(a, b) for a, b in zip(one, same, strict=True))

    def test_columns_stay_where_they_are(self):
        """Only rows move, and the left view does not move at all: the truth stays true."""
        dots = torch.zeros(1, 3, 41, 41)
        dots[..., 20, 20] = 1.0
        quiet = Augmentation(shared=0.0, apart=0.0, most_noise=0.0, most_rows_px=0.9)

        left, right = quiet(dots, dots, torch.Generator().manual_seed(2))

        column = torch.arange(41.0)
        for view in (left, right):
            bright = (view - view.min()).sum(dim=(0, 1, 2))
            assert float((bright * column).sum() / bright.sum()) == pytest.approx(20, abs=0.01)


def test_the_network_that_is_trained_is_the_one_that_ships():
    assert FeatureNetwork(Architecture()).margin_px % FeatureNetwork(Architecture()).stride_px == 0
