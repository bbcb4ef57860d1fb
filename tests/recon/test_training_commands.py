"""Both command lines of training: what they read, and what they show."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest
import tyro
from rich.console import Console

from recon.cli import main as reconstruct
from recon.cli import train as cli_train
from recon.training import train as training
from recon.training.arguments import parsed
from recon.training.progress import Drawn, Saved, Step
from recon.training.recipe import Recipe
from recon.training.settings import FeatureTraining, RegulariserTraining
from recon.training.train import main

CONFIG = (
    tyro.conf.FlagCreatePairsOff,
    tyro.conf.DisallowNone,
    tyro.conf.PositionalMetavarFromFieldName,
)


@pytest.fixture
def asked(monkeypatch):
    """What a command asked to be trained; nothing is."""
    found = []

    def train(settings, *, device, observe):
        found.append(settings)

    monkeypatch.setattr(training, "train", train)
    return found


def reconstruct_train(words):
    command = cli_train.train
    if words[0] == "regulariser":
        command, words = cli_train.train_regulariser, words[1:]
    tyro.cli(command, args=words, config=CONFIG)


CASES = {
    "": FeatureTraining(),
    "--variant wide --steps 7": FeatureTraining(variant="wide", steps=7),
    "--size 64 48 --learning-rate 0.5": FeatureTraining(size=(64, 48), learning_rate=0.5),
    "--source fresh --draw-on cpu": FeatureTraining(source="fresh", draw_on="cpu"),
    "--out here --pool there": FeatureTraining(out=Path("here"), pool=Path("there")),
    "--no-photometric --no-occluders": FeatureTraining(photometric=False, occluders=False),
    "--max-minutes 9.5 --workers 3": FeatureTraining(max_minutes=9.5, workers=3),
    "regulariser": RegulariserTraining(),
    "regulariser --batch 3 --most-candidates 64": RegulariserTraining(batch=3, most_candidates=64),
    "--recipe.no-light --recipe.scenes room fence": FeatureTraining(
        recipe=Recipe(light=False, scenes=("room", "fence"))
    ),
}


@pytest.mark.parametrize("words", CASES)
def test_both_command_lines_read_the_same_settings(words, asked):
    reconstruct_train([*words.split(), "--device", "cpu"])
    main(words.split())

    assert asked == [CASES[words]] * 2


@pytest.mark.parametrize("settings", CASES.values())
def test_the_recorded_command_trains_the_same_weights(settings):
    words = settings.command().split()

    again, _ = parsed(words[2:], None)

    assert words[:2] == ["reconstruct", "train"]
    assert again.decisive() == settings.decisive()


def test_two_words_name_the_network(asked):
    for words in ("train regulariser", "train features", "train"):
        reconstruct([*words.split(), "--device", "cpu"])

    assert [type(one) for one in asked] == [RegulariserTraining, FeatureTraining, FeatureTraining]


def test_every_setting_is_explained(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])

    shown = " ".join(capsys.readouterr().out.split())
    assert "--max-minutes MAX_MINUTES stop with a checkpoint after so long" in shown
    assert "spread the largest disparity from 3 % to 25 % of the width" in shown


def test_a_mistake_ends_with_one_message(tmp_path):
    with pytest.raises(SystemExit) as end:
        main(["--variant", "fats", "--out", str(tmp_path)])

    assert end.value.code == "error: unknown variant 'fats'; there are fast, wide"


def test_an_interrupted_training_says_that_it_can_go_on(monkeypatch, capsys):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(training, "train", interrupted)

    with pytest.raises(SystemExit) as end:
        reconstruct_train(["--device", "cpu"])

    assert end.value.code == 130
    assert "the same command goes on from the last checkpoint" in capsys.readouterr().out


@pytest.mark.parametrize("terminal", [True, False])
def test_progress_is_shown_with_and_without_a_terminal(monkeypatch, terminal):
    console = Console(force_terminal=terminal, file=sys.stdout, record=True, width=120)
    monkeypatch.setattr(cli_train, "console", console)

    def train(settings, *, device, observe):
        observe("pair", Drawn(1, 2))
        for step in (1, 2):
            observe("step", Step(step, 4, 1.5, 0.25, 8.0))
        observe("weights", Saved(Path("some.safetensors")))

    monkeypatch.setattr(training, "train", train)

    reconstruct_train(["--device", "cpu"])

    shown = console.export_text()
    assert "wrote some.safetensors" in shown
    assert ("loss 1.500, within 1 px 25.0%, 8.0 pairs/s" in shown) == terminal
    assert ("drew pair 1 of 2" in shown) != terminal


def test_the_folder_is_named_after_the_variant_unless_given():
    assert FeatureTraining(variant="wide").folder == Path("checkpoints/wide")
    assert replace(FeatureTraining(), out=Path("here")).folder == Path("here")
