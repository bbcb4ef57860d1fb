"""Which preset `auto` is."""

import pytest

from recon import choice as module
from recon.choice import CORE_SECONDS, ENLARGED_PX, Pace, choose_preset
from recon.enlargement import Enlargement
from recon.settings import load_preset, preset_names


@pytest.fixture
def paces(monkeypatch):
    seconds = {"context": Pace(40.0), "best": Pace(30.0), "fast": Pace(9.0)}
    monkeypatch.setattr(module, "CORE_SECONDS", seconds)


def test_only_presets_that_there_are_are_chosen_from():
    assert CORE_SECONDS.keys() <= set(preset_names())


@pytest.mark.usefixtures("paces")
@pytest.mark.parametrize(
    ("size", "candidates", "cores", "preset"),
    [
        ((700, 500), 75, 2, "context"),
        ((1400, 1000), 250, 2, "best"),
        ((1400, 1000), 250, 8, "context"),
        ((2900, 2000), 760, 2, "fast"),
        ((2900, 2000), 760, 64, "context"),
    ],
)
def test_it_is_the_most_accurate_one_within_a_minute_or_else_the_quickest(
    size, candidates, cores, preset
):
    choice = choose_preset(size, range(candidates), cores=cores)

    assert choice.preset == preset
    assert choice.reason.startswith(f"{preset}, about ")
    assert f"{size[0]} x {size[1]} pixels x {candidates} disparities on {cores} cores" in (
        choice.reason
    )


@pytest.mark.usefixtures("paces")
def test_on_a_gpu_it_is_the_most_accurate_one():
    assert choose_preset((2900, 2000), range(760), device="cuda", cores=1).preset == "context"


def test_an_unknown_range_counts_as_a_quarter_of_the_width():
    known, unknown = (choose_preset((1400, 1000), one, cores=2) for one in (range(350), None))

    assert known == unknown


def seconds_said(size, candidates):
    words = choose_preset(size, range(candidates), cores=2).reason
    return int(words.split("about ")[1].split(" s")[0])


def test_the_seconds_grow_with_what_is_searched(monkeypatch):
    monkeypatch.setattr(module, "CORE_SECONDS", {"context": Pace(200.0)})

    assert seconds_said((1000, 1000), 10) == 10
    assert seconds_said((1000, 1000), 30) == 30
    assert seconds_said((2000, 1000), 30) == 60


def test_what_is_small_enough_is_searched_again(monkeypatch):
    monkeypatch.setattr(module, "CORE_SECONDS", {"context": Pace(200.0, 100.0)})

    assert seconds_said((1000, 500), 10) == 5 + 25
    assert seconds_said((1000, 1000), 10) == 10 + 50
    assert seconds_said((1000, 1001), 10) == 10


def test_it_knows_which_views_are_enlarged():
    assert Enlargement().most_pixels == ENLARGED_PX
    for name, pace in CORE_SECONDS.items():
        assert (load_preset(name).matcher.enlargement is not None) == (pace.enlargement > 0)
