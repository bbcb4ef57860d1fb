"""A training in progress, which can be left and taken up again."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from pickle import UnpicklingError
from typing import Any, Generic, TypeVar

import torch
from torch import Tensor, nn

from recon.training.augmentation import Augmentation
from recon.training.batches import Source, random_crops
from recon.training.misalignment import Pairs
from recon.training.progress import Scores
from recon.training.recipe import recipe_hash
from recon.training.settings import Training
from recon.types import Array

__all__ = ["Run", "Update"]

UNREADABLE = (
    *(AttributeError, EOFError, KeyError, OSError, RuntimeError, TypeError, ValueError),
    UnpicklingError,
)
WEIGHT_DECAY = 1e-4

SettingsT = TypeVar("SettingsT", bound=Training)


@dataclass(frozen=True, eq=False)
class Update:
    """One step of a run; nothing waits for the device until it is looked at.

    Attributes:
        pairs: as the network saw it, after the augmentation.
        loss: ().
        within_one_pixel: returns the share of visible pixels that are within 1 px of the truth.
    """

    pairs: Pairs
    loss: Tensor
    within_one_pixel: Callable[[], float]


class Run(ABC, Generic[SettingsT]):
    """Weights, optimiser and randomness, all of which a checkpoint holds.

    What is trained, and to do what, is the business of a subclass.

    Args:
        settings: what to train.
        device: where to compute; a checkpoint may be taken up on another one.

    Raises:
        ValueError: if the checkpoint is damaged or of other settings.
    """

    longest_gradient: float | None = None
    """Longer gradients are shortened to this; none if nothing is said."""

    def __init__(self, settings: SettingsT, device: torch.device) -> None:
        self.settings = settings
        self.device = device
        self.augmentation = Augmentation(
            photometric=settings.photometric,
            geometric=settings.geometric,
            occluders=settings.occluders,
        )
        self.step = 0
        self.generator = torch.Generator().manual_seed(settings.seed)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(settings.seed)
            trained = self.begin()
        self.trained = trained.to(device)
        self.optimiser = torch.optim.AdamW(
            self.trained.parameters(),
            settings.learning_rate,
            weight_decay=WEIGHT_DECAY,
            fused=True,
        )
        self._seconds_before, self._began = 0.0, time.monotonic()
        if self.checkpoint.exists():
            self._resume()

    @abstractmethod
    def begin(self) -> nn.Module:
        """Return everything that is trained, with its first weights."""

    @abstractmethod
    def look(self, pairs: Pairs) -> Update:
        """Return how wrong the network is on pairs."""

    @abstractmethod
    def ready(self) -> nn.Module:
        """Return the network as it is used."""

    @abstractmethod
    def scores(self) -> Scores:
        """Return how good the network is by now, on pairs that it never trained on."""

    @abstractmethod
    def picture(self, pairs: Pairs) -> Array:
        """Draw what the network sees, (H, W, 3) uint8."""

    @abstractmethod
    def write(self, path: Path, *, about: dict[str, str]) -> None:
        """Write the weights, to a temporary name first."""

    @abstractmethod
    def shape(self) -> str:
        """Return the shape of the network as a repeatable text."""

    @abstractmethod
    def shape_in_words(self) -> str:
        """Return what people want to know of its shape, in Markdown."""

    @property
    @abstractmethod
    def purpose(self) -> str:
        """What the network is, as in "weights of the ..."."""

    @property
    @abstractmethod
    def judged(self) -> str:
        """Which disparities the scores are about."""

    @property
    def checkpoint(self) -> Path:
        """The file from which this run can be taken up."""
        return self.settings.folder / "checkpoint.pt"

    @property
    def seconds(self) -> float:
        """How long the run took so far, over all its parts."""
        return self._seconds_before + time.monotonic() - self._began

    def identity(self) -> dict[str, str | int | float | None]:
        """Return all that the weights follow from; a checkpoint must agree with it."""
        return {
            **self.settings.decisive(),
            "architecture": self.shape(),
            "augmentation": recipe_hash(self.augmentation),
        }

    def save(self) -> None:
        """Write everything needed to go on, to a temporary name first."""
        self.checkpoint.parent.mkdir(parents=True, exist_ok=True)
        unfinished = self.checkpoint.with_suffix(".part")
        state = {
            "step": self.step,
            "seconds": self.seconds,
            "network": self.trained.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "generator": self.generator.get_state(),
            "settings": self.identity(),
        }
        torch.save(state, unfinished)
        unfinished.replace(self.checkpoint)

    def _resume(self) -> None:
        """Go on from the checkpoint."""
        try:
            state = torch.load(self.checkpoint, map_location="cpu", weights_only=True)
            theirs = dict(state["settings"])
        except UNREADABLE as bad:
            raise ValueError(self._refusal(bad)) from bad
        self._refuse_other_settings(theirs)
        try:
            self._take_up(state)
        except UNREADABLE as bad:
            raise ValueError(self._refusal(bad)) from bad

    def _take_up(self, state: dict[str, Any]) -> None:
        self.trained.load_state_dict(state["network"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.generator.set_state(state["generator"])
        self.step = int(state["step"])
        self._seconds_before = float(state["seconds"])

    def _refusal(self, bad: Exception) -> str:
        return (
            f"{self.checkpoint} is not a checkpoint of this network "
            f"({' '.join(str(bad).split())[:200]}); was it cut off? Move it away to start anew"
        )

    def _refuse_other_settings(self, theirs: dict[str, Any]) -> None:
        for name, value in self.identity().items():
            if theirs.get(name) != value:
                raise ValueError(
                    f"{self.checkpoint} is of a run with {name} {theirs.get(name)}, not {value}; "
                    "give another --out, or move it away to start anew"
                )

    def _rate(self) -> float:
        """Return the learning rate of this step."""
        settings = self.settings
        rising = min(1.0, (self.step + 1) / settings.warm_up)
        falling = 0.5 * (1 + math.cos(math.pi * min(1.0, self.step / settings.steps)))
        return settings.learning_rate * rising * falling

    def update(self, source: Source) -> Update:
        """Do one step with pairs of `source`."""
        settings, generator = self.settings, self.generator
        crops = random_crops(source, self.step, settings, generator=generator, device=self.device)
        self.trained.train()
        update = self.look(self.augmentation.whole(crops, generator))
        for group in self.optimiser.param_groups:
            group["lr"] = self._rate()
        self.optimiser.zero_grad()
        update.loss.backward()  # type: ignore[no-untyped-call]
        if self.longest_gradient is not None:
            nn.utils.clip_grad_norm_(self.trained.parameters(), self.longest_gradient)
        self.optimiser.step()
        self.step += 1
        return replace(update, loss=update.loss.detach())
