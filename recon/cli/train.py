"""`reconstruct train`: both networks, from scenes that are generated."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)
from tyro.conf import arg

from recon.cli.terminal import Device, console, device_named
from recon.training.settings import FeatureTraining, RegulariserTraining, Training

if TYPE_CHECKING:
    from recon.observer import Observer
    from recon.training.progress import Step

__all__ = ["train", "train_regulariser"]

FEATURES = FeatureTraining()
REGULARISER = RegulariserTraining()


def train(
    settings: Annotated[FeatureTraining, arg(name="")] = FEATURES, *, device: Device = "auto"
) -> None:
    """Train the network of the matching cost on generated pairs, from nothing.

    Writes weights, their card, a checkpoint and pictures of what the network sees into --out. What
    was stopped goes on when the same command is given again. `reconstruct train regulariser`
    trains the other network, which looks around among the costs.

    Args:
        settings: what to train.
        device: where to compute.
    """
    _train(settings, device)


def train_regulariser(
    settings: Annotated[RegulariserTraining, arg(name="")] = REGULARISER,
    *,
    device: Device = "auto",
) -> None:
    """Train the regulariser on generated pairs and the costs of a network that is ready.

    Writes weights, their card, a checkpoint and pictures of what the network finds into --out. What
    was stopped goes on when the same command is given again.

    Args:
        settings: what to train.
        device: where to compute.
    """
    _train(settings, device)


def _train(settings: Training, device: Device) -> None:
    """Train with a bar of progress."""
    from recon.training.train import train as run

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    where = device_named(device)
    with Progress(*columns, console=console, disable=not console.is_terminal) as bars:
        try:
            run(settings, device=where, observe=_observer(bars))
        except KeyboardInterrupt:
            console.print("stopped; the same command goes on from the last checkpoint")
            sys.exit(130)


def _observer(bars: Progress) -> Observer:
    """Return what shows counts as bars and says the rest; without a terminal all is said."""
    from recon.training.progress import Drawn, Lines, Step

    lines = Lines(lambda line: console.print(line, soft_wrap=True))
    if not console.is_terminal:
        return lines
    shown: dict[str, TaskID] = {}

    def show(stage: str, done: int, total: int, words: str) -> None:
        if stage not in shown:
            shown[stage] = bars.add_task(words, total=total)
        bars.update(shown[stage], completed=done, description=words)

    def observe(stage: str, result: object) -> None:
        if isinstance(result, Drawn):
            show(stage, result.done, result.total, "drawing pairs")
        elif isinstance(result, Step):
            show(stage, result.step, result.steps, _words(result))
        else:
            lines(stage, result)

    return observe


def _words(step: Step) -> str:
    return (
        f"loss {step.loss:.3f}, within 1 px {step.within_1px:.1%}, "
        f"{step.pairs_per_second:.1f} pairs/s"
    )
