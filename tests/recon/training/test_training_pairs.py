"""Where pairs come from, and what of them a network sees."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from small_trainings import CPU, PAIRS, SIZE

from recon.training import scenes
from recon.training.batches import pairs_for, random_crops
from recon.training.pool import draw_pair, fill_pool, read_pair


def test_a_pair_follows_from_its_seed():
    one, same, other = (draw_pair(seed, SIZE) for seed in (3, 3, 4))

    assert all(np.array_equal(one[name], same[name]) for name in one)
    assert not np.array_equal(one["left"], other["left"])


def test_the_pool_is_drawn_from_scenes_and_what_is_there_is_kept(tmp_path, monkeypatch):
    monkeypatch.setattr("recon.training.pool.draw", scenes.draw)
    size = (32, 24)
    list(fill_pool(tmp_path, range(2), size, workers=0))
    before = (tmp_path / "pair_000000.npz").stat().st_mtime_ns

    drawn = list(fill_pool(tmp_path, range(3), size, workers=0))

    assert drawn == [tmp_path / "pair_000002.npz"]
    assert (tmp_path / "pair_000000.npz").stat().st_mtime_ns == before
    pair = read_pair(tmp_path, 2)
    assert pair["left"].shape == pair["right"].shape == (24, 32, 3)
    assert pair["left"].dtype == np.uint8
    assert pair["disparity"].dtype == np.float32
    assert pair["visible"].dtype == np.bool_


def test_crops_stay_pairs_whatever_is_turned(settings, generator):
    """Every visible pixel has the colour of its partner, at the disparity of the crop."""
    with pairs_for(replace(settings, source="pool"), "cpu") as source:
        for _ in range(5):
            crops = random_crops(source, 0, settings, generator=generator, device=CPU)

            partner = (torch.arange(96) - crops.disparity).long().clamp_min(0)
            found = crops.right.gather(3, partner[:, None].expand_as(crops.right))
            visible = crops.visible[:, None].expand_as(found)
            assert torch.equal(found[visible], crops.left[visible])
            assert crops.left.shape == (2, 3, 32, 96)


def test_fresh_pairs_are_in_as_many_batches_as_asked_for(settings):
    offered = {}
    with pairs_for(replace(settings, source="fresh"), "cpu") as source:
        for step in range(30):
            for seed in source.seeds(step):
                offered[seed] = offered.get(seed, 0) + 1

    chosen = settings.batch / settings.window  # how often a pair on offer is in the batch
    middle = [offered[seed] for seed in range(PAIRS + 5, PAIRS + 25)]
    assert np.mean(middle) * chosen == pytest.approx(settings.uses, rel=0.1)


def test_fresh_pairs_out_of_the_window_are_forgotten(settings):
    with pairs_for(replace(settings, source="fresh"), "cpu") as source:
        first = source.seeds(0)[0]
        source.pair(first)
        source.seeds(5)

        with pytest.raises(KeyError):
            source.pair(first)
