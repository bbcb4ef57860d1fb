"""Weights, header, card, pictures, and what is said on the way."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from safetensors import safe_open
from small_trainings import CPU, weights_of

from recon.colours import MISSING_COLOUR
from recon.networks import load_features
from recon.training.batches import pairs_for
from recon.training.card import commit
from recon.training.feature_run import FeatureRun
from recon.training.picture import GAP_PX, picture
from recon.training.progress import Drawn, Lines, Saved, Scores, Step
from recon.training.recipe import recipe_hash
from recon.training.train import train

ROOT = Path(__file__).parents[3]


class TestWriting:
    def test_weights_checkpoint_pictures_and_card_are_written(self, settings):
        network = train(settings)

        out = settings.out
        assert torch.equal(
            weights_of(load_features(str(out / "small.safetensors"))), weights_of(network)
        )
        names = ["checkpoint.pt", "log", "small.md", "small.safetensors"]
        assert sorted(path.name for path in out.iterdir()) == names
        pictures = [f"step_{step:06d}.png" for step in (2, 4, 6)]
        assert sorted(path.name for path in (out / "log").iterdir()) == pictures

    def test_the_header_says_how_without_paths(self, settings):
        train(settings)

        with safe_open(settings.out / "small.safetensors", framework="pt") as file:
            header = file.metadata()
        assert header["steps"] == "6"
        assert header["size"] == "96 x 64"
        assert header["source"] == "pool"
        assert header["recipe"] == recipe_hash(settings.recipe)
        assert header["commit"] == commit()
        assert 0 <= float(header["generated pairs, within 1 px"]) <= 1
        assert 0 <= float(header["generated pairs with augmentation, within 1 px"]) <= 1
        assert not [value for value in header.values() if "/" in value]

    def test_the_card_says_the_same_to_people(self, settings):
        scores = []
        train(settings, observe=lambda _, result: scores.append(result))
        (last,) = [one for one in scores if isinstance(one, Scores) and one.step == 6]

        card = (settings.out / "small.md").read_text()

        for words in (
            "# `small`",
            "reconstruct train --source pool --pairs 5",
            "--variant small",
            recipe_hash(settings.recipe),
            commit(),
            f"torch {torch.__version__}",
            "5 pairs, seeds 0 to 4, of which the last 2 only for validation",
            "6 of 2 crops of 32 rows",
            f"{last.plain:.1%}; with augmentation {last.augmented:.1%}",
        ):
            assert words in card

    def test_a_picture_shows_both_views_the_truth_and_the_winner(self, settings, pool):
        run = FeatureRun(settings, CPU)
        with pairs_for(replace(settings, source="pool"), "cpu") as source:
            batch = run.update(source).pairs

        drawn = picture(run.ready(), batch)

        left, right, truth, winner = (
            drawn[top : top + 32] for top in range(0, 4 * (32 + GAP_PX), 32 + GAP_PX)
        )
        assert drawn.shape == (4 * 32 + 3 * GAP_PX, 96, 3)
        for shown, view in ((left, batch.left), (right, batch.right)):
            assert np.abs(shown / 255 - view[0].permute(1, 2, 0).numpy()).max() < 0.002
        missing = (truth == MISSING_COLOUR).all(-1)
        assert np.array_equal(missing, ~batch.visible[0].numpy())
        assert not (winner == MISSING_COLOUR).all(-1).any()

    def test_a_picture_is_a_png(self, settings):
        train(settings)

        with Image.open(settings.out / "log" / "step_000006.png") as shown:
            assert shown.size == (96, 4 * 32 + 3 * GAP_PX)

    def test_without_pillow_there_are_no_pictures(self, settings, monkeypatch):
        monkeypatch.setitem(sys.modules, "PIL", None)

        train(settings)

        assert not (settings.out / "log").exists()

    def test_outside_git_the_commit_is_unknown(self, monkeypatch, tmp_path):
        monkeypatch.setattr("recon.training.card.HERE", tmp_path)

        assert commit() == "unknown"

    @pytest.mark.slow
    def test_torch_numpy_and_safetensors_are_enough(self, settings):
        """As on a bare machine with an accelerator."""
        missing = "cv2 open3d rerun numba tyro rich PIL pydantic trimesh matplotlib jinja2"
        words = settings.command().split()[2:]
        words += ["--pool", str(settings.pool), "--out", str(settings.out), "--workers", "0"]
        code = (
            "import sys\n"
            f"sys.modules.update(dict.fromkeys({missing.split()!r}))\n"
            "from recon.networks import Architecture, architecture\n"
            "architecture.VARIANTS = {'small': Architecture((8, 8), 1, 8)}\n"
            "from recon.training.train import main\n"
            f"main({words!r})\n"
        )

        subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)

        assert (settings.out / "small.safetensors").exists()


class TestProgress:
    def test_counts_are_said_seldom_and_scores_always(self):
        said = []
        lines = Lines(said.append, every_seconds=100.0)

        for done in range(3):
            lines("pair", Drawn(done + 1, 3))
            lines("scores", Scores(done, 0.5, 0.25))

        assert said[0] == "drew pair 1 of 3"
        assert said[1:] == [
            f"step {done}: kept pairs within 1 px 50.00%, augmented 25.00%" for done in range(3)
        ]

    def test_only_pairs_that_are_missing_are_counted(self, settings):
        (settings.pool / "pair_000002.npz").unlink()
        told = []

        train(settings, observe=lambda _, result: told.append(result))

        assert [result for result in told if isinstance(result, Drawn)] == [Drawn(1, 1)]

    def test_a_training_tells_its_steps_scores_and_files(self, settings):
        told = []

        train(settings, observe=lambda stage, result: told.append((stage, result)))

        steps = [result for _, result in told if isinstance(result, Step)]
        assert [step.step for step in steps][-1] == 6
        assert all(step.loss > 0 and 0 <= step.within_1px <= 1 for step in steps)
        assert all(step.pairs_per_second > 0 for step in steps)
        assert [result.step for _, result in told if isinstance(result, Scores)] == [2, 4, 6]
        assert told[-1] == ("weights", Saved(settings.out / "small.safetensors"))
