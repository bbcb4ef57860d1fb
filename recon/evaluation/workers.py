"""Tasks in processes of their own, so that one that dies takes nothing with it."""

from __future__ import annotations

import signal
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Generic, TypeVar

__all__ = ["Failure", "run_in_processes"]

Task = TypeVar("Task")
Result = TypeVar("Result")
PATIENCE_S = 5.0


@dataclass(frozen=True)
class Failure:
    """Why a task has no result.

    Attributes:
        reason: one sentence.
        details: the traceback, if the program and not its input is to blame.
    """

    reason: str
    details: str = ""


@dataclass(eq=False)
class _Worker(Generic[Task]):
    """A process, how to talk to it, and what it is busy with."""

    process: BaseProcess
    connection: Connection
    task: Task


def run_in_processes(
    function: Callable[[Task], Result],
    tasks: Sequence[Task],
    *,
    jobs: int,
    prepare: Callable[[int], None],
) -> Iterator[tuple[Task, Result | Failure]]:
    """Call a function on every task in other processes, and yield results as they come.

    A task that raises, or whose process is killed (as the kernel does when memory runs out),
    yields a `Failure`; the others go on.

    Args:
        function: of a module, so that another process can find it.
        tasks: taken in order.
        jobs: processes at once.
        prepare: called with `jobs` in every new process, before its first task.

    Yields:
        A task and what came of it, in the order in which they end.
    """
    waiting = list(reversed(tasks))
    workers = [
        _started(function, prepare, jobs, waiting.pop()) for _ in range(min(jobs, len(waiting)))
    ]
    try:
        while workers:
            busy = {worker.connection: worker for worker in workers}
            for connection in wait(list(busy)):
                worker = busy[connection]  # type: ignore[index]
                done, result = worker.task, _answer(worker)
                alive = worker.process.is_alive() and not isinstance(result, _Died)
                if waiting and alive:
                    worker.task = waiting.pop()
                    worker.connection.send(worker.task)
                else:
                    workers.remove(worker)
                    _end(worker)
                    if waiting:
                        workers.append(_started(function, prepare, jobs, waiting.pop()))
                yield done, result
    finally:
        for worker in workers:
            worker.process.terminate()
            _end(worker)


class _Died(Failure):
    """The process is gone."""


def _started(
    function: Callable[[Task], Result], prepare: Callable[[int], None], jobs: int, task: Task
) -> _Worker[Task]:
    """Start a process with its first task."""
    context = get_context("spawn")  # forked threads of OpenMP would hang
    ours, theirs = context.Pipe()
    process = context.Process(target=_work, args=(theirs, function, prepare, jobs), daemon=True)
    process.start()
    theirs.close()
    ours.send(task)
    return _Worker(process, ours, task)


def _work(
    connection: Connection,
    function: Callable[[Task], object],
    prepare: Callable[[int], None],
    jobs: int,
) -> None:
    """Answer tasks until there are no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the parent, which ends this
    prepare(jobs)
    while True:
        try:
            connection.send(_attempt(function, connection.recv()))
        except (EOFError, ConnectionError):  # closed, or the parent is gone
            return


def _attempt(function: Callable[[Task], object], task: Task) -> object:
    """Return what the function returns, or why it does not."""
    try:
        return function(task)
    except (ValueError, OSError, MemoryError) as error:
        return Failure(str(error) or type(error).__name__)
    except Exception as error:  # noqa: BLE001  a mistake in one method must not end the others
        return Failure(f"{type(error).__name__}: {error}", traceback.format_exc())


def _answer(worker: _Worker[Task]) -> Any:  # noqa: ANN401  whatever the function returns
    """Return what a process sends, or how it died."""
    try:
        return worker.connection.recv()
    except (EOFError, ConnectionError):
        worker.process.join(PATIENCE_S)
        code = worker.process.exitcode or 0
        how = f"was killed by signal {-code}" if code < 0 else f"ended with status {code}"
        likely = "; did memory run out?" if code == -signal.SIGKILL else ""
        return _Died(f"its process {how}{likely}")


def _end(worker: _Worker[Task]) -> None:
    """Let a process go: it returns when its connection is closed."""
    worker.connection.close()
    worker.process.join(PATIENCE_S)
    if worker.process.is_alive():
        worker.process.kill()
        worker.process.join()
