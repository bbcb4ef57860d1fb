"""Damaged files and settings that cannot be are refused by name."""

from dataclasses import replace

import pytest
import torch
from small_trainings import left_off_at

from recon.training.recipe import Recipe
from recon.training.train import train


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
    left_off_at(settings, 2)
    checkpoint = settings.out / "checkpoint.pt"
    checkpoint.write_bytes(damage(checkpoint.read_bytes()))

    with pytest.raises(ValueError, match=r"checkpoint\.pt is not a checkpoint of this network"):
        train(settings)


@pytest.mark.parametrize("contents", [{}, {"step": 1, "settings": 3}, [1]])
def test_a_foreign_checkpoint_is_refused_by_name(settings, contents):
    settings.out.mkdir()
    torch.save(contents, settings.out / "checkpoint.pt")

    with pytest.raises(ValueError, match=r"checkpoint\.pt is not a checkpoint of this network"):
        train(settings)


def test_a_checkpoint_with_a_part_missing_is_refused_by_name(settings):
    left_off_at(settings, 2)
    path = settings.out / "checkpoint.pt"
    state = torch.load(path)
    del state["network"]["network.mix.bias"]
    torch.save(state, path)

    with pytest.raises(ValueError, match=r"checkpoint\.pt is not a checkpoint .*mix\.bias"):
        train(settings)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"steps": 8}, "is of a run with steps 6, not 8; give another --out"),
        ({"variant": "other"}, "is of a run with variant small, not other"),
        ({"source": "fresh"}, "is of a run with source pool, not fresh"),
    ],
)
def test_a_checkpoint_of_other_settings_is_refused(settings, changes, message):
    left_off_at(settings, 2)

    with pytest.raises(ValueError, match=message):
        train(replace(settings, **changes))


def test_an_unknown_variant_is_refused_with_those_there_are(settings):
    with pytest.raises(ValueError, match="unknown variant 'fats'; there are fast, wide, small"):
        train(replace(settings, variant="fats"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"size": (96, 48)}, "pool holds pairs of size 96 x 64, not 96 x 48; give another"),
        ({"recipe": Recipe(light=False)}, "pool holds pairs of recipe [0-9a-f]{12}, not "),
    ],
)
def test_a_pool_of_other_pairs_is_refused(settings, changes, message):
    with pytest.raises(ValueError, match=message):
        train(replace(settings, **changes))


def test_a_pool_that_does_not_say_what_it_holds_is_refused(settings):
    (settings.pool / "pool.json").unlink()

    with pytest.raises(ValueError, match=r"pool holds pairs but no pool\.json that says which"):
        train(settings)


@pytest.mark.parametrize("contents", ["", "[1]", "3"])
def test_a_damaged_record_of_a_pool_is_refused_by_name(settings, contents):
    (settings.pool / "pool.json").write_text(contents)

    with pytest.raises(ValueError, match=r"pool\.json is damaged"):
        train(settings)


@pytest.mark.parametrize("length", [0, 100, 20_000])
def test_a_damaged_pair_is_refused_by_name(settings, length):
    path = settings.pool / "pair_000004.npz"
    path.write_bytes(path.read_bytes()[:length])

    with pytest.raises(ValueError, match=r"pair_000004\.npz is not a generated pair \(.*cut off"):
        train(settings)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("pairs", 2, "pairs must be more than the 2 that are kept for validation, got 2"),
        ("crop_rows", 65, "crop_rows must be from 1 to the height of the pairs, 64, got 65"),
        ("crop_rows", 0, "crop_rows must be from 1"),
        ("steps", 0, "steps must be positive, got 0"),
        ("batch", 0, "batch must be positive, got 0"),
        ("learning_rate", -1.0, r"learning_rate must be positive, got -1\.0"),
        ("max_minutes", 0.0, r"max_minutes must be positive, got 0\.0"),
        ("workers", -1, "workers must not be negative, got -1"),
    ],
)
def test_a_setting_that_cannot_be_is_refused(settings, name, value, message):
    with pytest.raises(ValueError, match=message):
        replace(settings, **{name: value})
