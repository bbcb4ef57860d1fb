"""Which preset `auto` is."""

import pytest

from recon import choice as module
from recon.choice import CORE_SECONDS, choose_preset
from recon.settings import preset_names


@pytest.fixture
def paces(monkeypatch):
    monkeypatch.setattr(module, "CORE_SECONDS", {"context": 40.0, "best": 30.0, "fast": 9.0})


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


def test_the_seconds_grow_with_what_is_searched():
    seconds = CORE_SECONDS["context"] * 700 * 500 * 75 / 1e8 / 2

    assert f"about {round(seconds)} s" in choose_preset((700, 500), range(75), cores=2).reason
