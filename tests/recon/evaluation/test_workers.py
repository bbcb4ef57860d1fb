"""Tasks that raise or die are answers; the others go on."""

import os
import signal

import pytest

from recon.evaluation.workers import Failure, run_in_processes

pytestmark = pytest.mark.slow  # every process imports torch


def do_as_told(task):
    if task == "raise":
        raise ValueError("the file x.png is empty")
    if task == "bug":
        raise TypeError("cannot add")
    if task == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    if task == "leave":
        os._exit(3)
    return f"{task} done"


def note_jobs(jobs):
    os.environ["JOBS_OF_THIS_RUN"] = str(jobs)


def told_jobs(task):
    return os.environ["JOBS_OF_THIS_RUN"]


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_task_is_answered_whatever_happens_to_the_others(jobs):
    tasks = ["a", "raise", "die", "b", "bug", "leave", "c"]

    answers = dict(run_in_processes(do_as_told, tasks, jobs=jobs, prepare=note_jobs))

    assert {task: answers[task] for task in "abc"} == {task: f"{task} done" for task in "abc"}
    assert answers["raise"] == Failure("the file x.png is empty")
    assert "killed by signal 9; did memory run out?" in answers["die"].reason
    assert "ended with status 3" in answers["leave"].reason
    assert answers["bug"].reason == "TypeError: cannot add"
    assert "do_as_told" in answers["bug"].details


def test_a_process_is_prepared_before_its_first_task():
    answers = list(run_in_processes(told_jobs, ["a", "b"], jobs=2, prepare=note_jobs))

    assert sorted(answers) == [("a", "2"), ("b", "2")]


def test_a_run_that_is_left_early_ends_its_processes():
    run = run_in_processes(do_as_told, ["a", "b", "c"], jobs=1, prepare=note_jobs)

    first = next(run)
    run.close()

    assert first == ("a", "a done")


def test_no_task_is_no_answer():
    assert list(run_in_processes(do_as_told, [], jobs=2, prepare=note_jobs)) == []
