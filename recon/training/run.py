"""A training in progress, which can be left and taken up again."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path
from pickle import UnpicklingError
from typing import Any

import torch
from torch import Tensor

from recon.networks import FeatureNetwork
from recon.networks.architecture import architecture_named
from recon.training.augmentation import Augmentation
from recon.training.batches import Source, random_crops
from recon.training.loss import matching_loss, near_edges, similarities, within_one_pixel
from recon.training.misalignment import Pairs
from recon.training.recipe import recipe_hash
from recon.training.settings import Training
from recon.training.support import Support

__all__ = ["Run", "Update"]

UNREADABLE = (
    *(AttributeError, EOFError, KeyError, OSError, RuntimeError, TypeError, ValueError),
    UnpicklingError,
)
FIRST_SHARPNESS = 20.0
WEIGHT_DECAY = 1e-4


@dataclass(frozen=True, eq=False)
class Update:
    """One step of a run; nothing waits for the device until it is looked at.

    Attributes:
        pairs: as the network saw it, after the augmentation.
        similarity: (N, h, W, D) of the candidates, after the support.
        loss: ().
    """

    pairs: Pairs
    similarity: Tensor
    loss: Tensor

    def within_one_pixel(self) -> float:
        """Return the share of visible pixels whose best candidate is within 1 px of the truth."""
        return within_one_pixel(self.similarity, self.pairs.disparity, self.pairs.visible)


class Run:
    """Weights, optimiser and randomness, all of which a checkpoint holds.

    Args:
        settings: what to train.
        device: where to compute; a checkpoint may be taken up on another one.

    Raises:
        ValueError: if the checkpoint is damaged or of other settings.
    """

    def __init__(self, settings: Training, device: torch.device) -> None:
        self.settings = settings
        self.device = device
        self.architecture = architecture_named(settings.variant)
        self.augmentation = Augmentation(
            photometric=settings.photometric,
            geometric=settings.geometric,
            occluders=settings.occluders,
        )
        self.step = 0
        self._generator = torch.Generator().manual_seed(settings.seed)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(settings.seed)
            network = FeatureNetwork(self.architecture, normalised=True)
        network.to(device)
        network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.network = network
        self.sharpness = torch.nn.Parameter(torch.tensor(FIRST_SHARPNESS, device=device).log())
        parameters = [*network.parameters(), self.sharpness]
        self.optimiser = torch.optim.AdamW(
            parameters, settings.learning_rate, weight_decay=WEIGHT_DECAY, fused=True
        )
        self._seconds_before, self._began = 0.0, time.monotonic()
        if self.checkpoint.exists():
            self._resume()

    @property
    def checkpoint(self) -> Path:
        """The file from which this run can be taken up."""
        return self.settings.folder / "checkpoint.pt"

    @property
    def seconds(self) -> float:
        """How long the run took so far, over all its parts."""
        return self._seconds_before + time.monotonic() - self._began

    def identity(self) -> dict[str, str | int | float]:
        """Return all that the weights follow from; a checkpoint must agree with it."""
        return {
            **self.settings.decisive(),
            "architecture": str(self.architecture),
            "augmentation": recipe_hash(self.augmentation),
        }

    def save(self) -> None:
        """Write everything needed to go on, to a temporary name first."""
        self.checkpoint.parent.mkdir(parents=True, exist_ok=True)
        unfinished = self.checkpoint.with_suffix(".part")
        state = {
            "step": self.step,
            "seconds": self.seconds,
            "network": self.network.state_dict(),
            "sharpness": self.sharpness.data,
            "optimiser": self.optimiser.state_dict(),
            "generator": self._generator.get_state(),
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
        self.network.load_state_dict(state["network"])
        self.sharpness.data.copy_(state["sharpness"])
        self.optimiser.load_state_dict(state["optimiser"])
        self._generator.set_state(state["generator"])
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
        settings, generator = self.settings, self._generator
        crops = random_crops(source, self.step, settings, generator=generator, device=self.device)
        pairs = self.augmentation.whole(crops, generator)
        weight = pairs.visible.float()
        if self.step >= settings.edges_from:
            weight = weight * (1 + settings.edge_weight * near_edges(pairs.disparity))
        self.network.train()
        both = torch.cat((pairs.left, pairs.right)).contiguous(memory_format=torch.channels_last)
        with torch.autocast(self.device.type, torch.bfloat16):
            features = self.network(both)
        similarity = similarities(*features.chunk(2))
        if settings.support_px:
            similarity = Support(settings.support_px)(similarity, pairs.left)
        loss = matching_loss(similarity, pairs.disparity, weight, self.sharpness.exp())
        for group in self.optimiser.param_groups:
            group["lr"] = self._rate()
        self.optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self.optimiser.step()
        self.step += 1
        return Update(pairs, similarity.detach(), loss.detach())
