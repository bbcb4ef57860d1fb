"""Train a network on generated pairs: `python -m recon.training.train --help`.

The same as `reconstruct train`, on machines that have torch, NumPy and safetensors only; the
regulariser needs numba too, unless it is trained on a CUDA device.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from functools import partial
from typing import Any

import torch
from torch import nn

from recon.observer import Observer, ignore
from recon.training.arguments import parsed
from recon.training.batches import Source, pairs_for
from recon.training.card import about, card
from recon.training.feature_run import FeatureRun
from recon.training.picture import write_picture
from recon.training.pool import fill_pool, missing_pairs
from recon.training.progress import Drawn, Lines, Saved, Scores, Step, Stopped
from recon.training.regulariser_run import RegulariserRun
from recon.training.run import Run, Update
from recon.training.settings import FeatureTraining, RegulariserTraining, Training

__all__ = ["Training", "main", "run_for", "train"]

SILENT_SECONDS = 10.0


RUNS: dict[type[Training], type[Run[Any]]] = {
    FeatureTraining: FeatureRun,
    RegulariserTraining: RegulariserRun,
}
"""What is trained under which settings."""


def run_for(settings: Training, device: torch.device) -> Run[Any]:
    """Return the run of some settings; see `Run`."""
    return RUNS[type(settings)](settings, device)


def train(
    settings: Training, *, device: str = "cpu", observe: Observer = ignore
) -> nn.Module | None:
    """Draw what is missing, train, write weights and their card.

    A training that was stopped goes on from its last checkpoint and, on a CPU with as many
    threads, ends at the same weights.

    Args:
        settings: what to train.
        device: where to compute.
        observe: told how far it is; see `recon.training.progress`.

    Returns:
        The network, or nothing if `max_minutes` were over first.

    Raises:
        ValueError: if the checkpoint or the pool is damaged or of other settings.
    """
    clock = _Clock(settings.max_minutes)
    run = run_for(_decided(settings, device), torch.device(device))
    scores, filled = None, _fill(run.settings, clock, observe)
    if filled:
        with pairs_for(run.settings, device) as source:
            scores = _update(run, source, clock, observe)
    if not filled or run.step < settings.steps:
        observe("stopped", Stopped(run.step, settings.steps, clock.minutes))
        return None
    return _finish(run, scores or run.scores(), observe)


def _decided(settings: Training, device: str) -> Training:
    """Return the settings with a source of pairs that fits the device."""
    if settings.source != "auto":
        return settings
    on_cpu = torch.device(device).type == "cpu"
    return replace(settings, source="pool" if on_cpu else "fresh")


class _Clock:
    """How long it has been, and whether that is enough."""

    def __init__(self, most_minutes: float | None) -> None:
        self._most = most_minutes
        self._began = time.monotonic()

    @property
    def minutes(self) -> float:
        return (time.monotonic() - self._began) / 60

    @property
    def over(self) -> bool:
        return self._most is not None and self.minutes >= self._most


def _fill(settings: Training, clock: _Clock, observe: Observer) -> bool:
    """Draw the pairs that are kept; return whether all are there before the time is up."""
    kept = range(settings.pairs) if settings.source == "pool" else settings.validation_seeds
    total = len(missing_pairs(settings.pool, kept))
    drawn = fill_pool(
        settings.pool, kept, settings.size, recipe=settings.recipe, workers=settings.workers
    )
    for count, _ in enumerate(drawn, 1):
        observe("pair", Drawn(count, total))
        if clock.over:
            drawn.close()
            return False
    return True


def _update(run: Run[Any], source: Source, clock: _Clock, observe: Observer) -> Scores | None:
    """Update until the last step or until the time is up, but once at least.

    Returns:
        The scores after the last step, or nothing if it did not come to that.
    """
    settings, scores = run.settings, None
    while run.step < settings.steps:
        update = _stretch(run, source, clock, observe)
        if run.step % settings.save_every == 0 or run.step == settings.steps:
            run.save()
            scores = _look(run, update, observe)
        if clock.over:
            run.save()
            break
    return scores


def _stretch(run: Run[Any], source: Source, clock: _Clock, observe: Observer) -> Update:
    """Update until there is something to say or to save."""
    settings, first, began = run.settings, run.step, time.monotonic()
    until = min(settings.steps, first + settings.save_every - first % settings.save_every)
    update = run.update(source)
    while run.step < until and time.monotonic() - began < SILENT_SECONDS and not clock.over:
        update = run.update(source)
    loss = float(update.loss)  # waits for the device
    pace = settings.batch * (run.step - first) / (time.monotonic() - began)
    share = update.within_one_pixel()
    observe("step", Step(run.step, settings.steps, loss, share, pace))
    return update


def _look(run: Run[Any], update: Update, observe: Observer) -> Scores:
    """Draw what the network sees, and return how good it is."""
    path = run.settings.folder / "log" / f"step_{run.step:06d}.png"
    if write_picture(path, run.picture(update.pairs)):
        observe("picture", Saved(path))
    scores: Scores = run.scores()
    observe("scores", scores)
    return scores


def _finish(run: Run[Any], scores: Scores, observe: Observer) -> nn.Module:
    """Write the weights and their card."""
    weights = run.settings.folder / f"{run.settings.name}.safetensors"
    run.write(weights, about=about(run, scores))
    unfinished = weights.with_suffix(".part")
    unfinished.write_text(card(run, scores), encoding="utf-8")
    unfinished.replace(weights.with_suffix(".md"))
    observe("weights", Saved(weights))
    return run.ready().cpu()


def main(arguments: list[str] | None = None) -> None:
    """Read the settings from the command line and train."""
    try:
        settings, device = parsed(arguments, __doc__)
        train(settings, device=device, observe=Lines(partial(print, flush=True)))
    except ValueError as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()
