"""The stopwatch that watches from outside."""

import itertools

import numba
import pytest

from recon import timing
from recon.timing import Stopwatch, compilation_watched


@pytest.fixture
def clock(monkeypatch):
    """Seconds that a test decides."""
    now = itertools.count()
    moments = {"now": 0.0}
    monkeypatch.setattr(timing.time, "perf_counter", lambda: moments["now"] + 0 * next(now))
    return moments


def test_the_time_before_a_result_is_that_of_its_stage(clock):
    watch = Stopwatch()
    for stage, seconds in (("cost", 2.0), ("fill", 0.5)):
        clock["now"] += seconds
        watch(stage, None)

    assert watch.seconds == {"cost": 2.0, "observing": 0.0, "fill": 0.5}


def test_strips_of_one_stage_add_up(clock):
    watch = Stopwatch()
    for stage in ("cost", "fill", "cost"):
        clock["now"] += 1.0
        watch(stage, None)

    assert watch.seconds["cost"] == 2.0
    assert watch.seconds["fill"] == 1.0


def test_watching_is_no_part_of_a_stage(clock):
    def slow(stage, result):
        clock["now"] += 10.0

    watch = Stopwatch(slow)
    for stage in ("cost", "fill"):
        clock["now"] += 1.0
        watch(stage, None)

    assert watch.seconds == {"cost": 1.0, "observing": 20.0, "fill": 1.0}


def test_results_are_passed_on_as_they_are():
    results, result = {}, object()

    Stopwatch(results.__setitem__)("cost", result)

    assert results == {"cost": result}


def test_compilation_is_measured_once():
    @numba.njit
    def double(value):
        return 2 * value

    with compilation_watched() as first:
        double(1)
    with compilation_watched() as second:
        double(1)

    assert first() > 0
    assert second() == 0
