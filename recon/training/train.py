"""Train the matching cost network on generated pairs: `python -m recon.training.train --help`."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from pickle import UnpicklingError

import numpy as np
import torch
from torch import Tensor

from recon.networks import Architecture, FeatureNetwork, save_features
from recon.training.augmentation import Augmentation
from recon.training.loss import matching_loss, near_edges, within_one_pixel
from recon.training.pool import fill_pool, read_pair

__all__ = ["Training", "matching_loss", "within_one_pixel"]

VALIDATION_PAIRS = 24
UNREADABLE = (EOFError, KeyError, OSError, RuntimeError, TypeError, ValueError, UnpicklingError)
ROW_STEP = 2  # neighbouring rows say nearly the same; the softmax over a row is what costs


@dataclass(frozen=True)
class Training:
    """Settings of one run; the weights follow from them alone.

    Attributes:
        out: folder of the checkpoint and of the weights.
        pool: folder of generated pairs; drawn first where missing.
        pairs: how many pairs to draw.
        steps: updates of the weights.
        batch: pairs an update.
        crop_rows: rows of each pair an update sees, over the full width.
        edge_weight: how much more the pixels near a depth edge count. A network that sees far finds
            the foreground before it finds the edge, and fattens it unless told to look.
        edges_from: the step from which they do.
        learning_rate: the largest one; it rises for 100 steps, then falls along a cosine.
        seed: of the weights, of the order of the pairs and of the augmentation.
        size: (width, height) of the pairs in pixels.
        save_every: steps between checkpoints.

    Raises:
        ValueError: if a setting is out of range.
    """

    out: Path = Path("checkpoints/fast")
    pool: Path = Path("checkpoints/pool")
    pairs: int = 264
    steps: int = 1000
    batch: int = 4
    crop_rows: int = 48
    edge_weight: float = 2.0
    edges_from: int = 250
    learning_rate: float = 1.5e-3
    seed: int = 0
    size: tuple[int, int] = (416, 256)
    save_every: int = 250

    def __post_init__(self) -> None:
        if self.pairs <= VALIDATION_PAIRS:
            raise ValueError(
                f"pairs must be more than the {VALIDATION_PAIRS} that are kept for validation, "
                f"got {self.pairs}"
            )
        if not 0 < self.crop_rows <= self.size[1]:
            raise ValueError(
                f"crop_rows must be from 1 to the height of the pairs, {self.size[1]}, "
                f"got {self.crop_rows}"
            )
        for name in ("steps", "batch", "learning_rate", "save_every"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")

    def __call__(self, report: Callable[[str], None]) -> FeatureNetwork:
        """Draw what is missing, train, write the weights and return the network.

        A run that was stopped goes on from its last checkpoint and ends at the same weights.

        Args:
            report: told how far it is, in lines for people.

        Raises:
            ValueError: if the checkpoint is damaged or of other settings.
        """
        for number, path in enumerate(fill_pool(self.pool, range(self.pairs), self.size)):
            if number % 50 == 0:
                report(f"drew {path.name}")
        run = _Run(self)
        started = time.monotonic()
        while run.step < self.steps:
            loss = run.update()
            if run.step % 50 == 0:
                report(f"step {run.step} loss {loss:.4f} {time.monotonic() - started:.0f} s")
            if run.step % self.save_every == 0 or run.step == self.steps:
                run.save()
                report(f"step {run.step} within 1 px: {run.validate():.4f}")
        about = {
            "command": "python -m recon.training.train",
            **{name: str(value) for name, value in self.decisive().items()},
            "generated pairs, within 1 px": f"{run.validate():.4f}",
        }
        network = run.network.fused()
        save_features(self.out / "fast.safetensors", network, about=about)
        return network

    def decisive(self) -> dict[str, str | float]:
        """Return the settings that the weights follow from: all but folders and habits."""
        habits = ("out", "pool", "save_every")
        settings = {name: value for name, value in asdict(self).items() if name not in habits}
        return {**settings, "size": "{} x {}".format(*self.size)}


class _Run:
    """A run in progress: weights, optimiser and randomness, all of which a checkpoint holds."""

    def __init__(self, settings: Training) -> None:
        self.settings = settings
        self.step = 0
        self.generator = torch.Generator().manual_seed(settings.seed)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(settings.seed)
            self.network = FeatureNetwork(Architecture(), normalised=True)
        self.network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.sharpness = torch.nn.Parameter(torch.tensor(20.0).log())
        parameters = [*self.network.parameters(), self.sharpness]
        self.optimiser = torch.optim.AdamW(parameters, settings.learning_rate, weight_decay=1e-4)
        self.augmentation = Augmentation()
        if self._checkpoint.exists():
            self._resume()

    @property
    def _checkpoint(self) -> Path:
        return self.settings.out / "checkpoint.pt"

    def save(self) -> None:
        """Write everything needed to go on, to a temporary name first."""
        self.settings.out.mkdir(parents=True, exist_ok=True)
        unfinished = self._checkpoint.with_suffix(".part")
        state = {
            "step": self.step,
            "network": self.network.state_dict(),
            "sharpness": self.sharpness.data,
            "optimiser": self.optimiser.state_dict(),
            "generator": self.generator.get_state(),
            "settings": self.settings.decisive(),
        }
        torch.save(state, unfinished)
        unfinished.replace(self._checkpoint)

    def _resume(self) -> None:
        """Go on from the checkpoint; refuse one of other settings."""
        try:
            state = torch.load(self._checkpoint, weights_only=True)
            self.step = state["step"]
            self.network.load_state_dict(state["network"])
            self.sharpness.data = state["sharpness"]
            self.optimiser.load_state_dict(state["optimiser"])
            self.generator.set_state(state["generator"])
        except UNREADABLE as bad:
            raise ValueError(
                f"{self._checkpoint} is not a checkpoint of this network "
                f"({' '.join(str(bad).split())[:200]}); was it cut off? Move it away to start anew"
            ) from bad
        ours = self.settings.decisive()
        for name, value in state.get("settings", {}).items():
            if ours.get(name) != value:
                raise ValueError(
                    f"{self._checkpoint} is of a run with {name} {value}, not {ours.get(name)}; "
                    "give another --out, or move it away to start anew"
                )

    def _rate(self) -> float:
        """Return the share of the largest learning rate that this step takes."""
        rising = min(1.0, (self.step + 1) / 100)
        return rising * 0.5 * (1 + math.cos(math.pi * min(1.0, self.step / self.settings.steps)))

    def _pair(self, seed: int) -> dict[str, np.ndarray]:
        """Read a pair; the pool may be one of pairs of another size."""
        arrays = read_pair(self.settings.pool, seed)
        height, width = arrays["disparity"].shape
        if (width, height) != self.settings.size:
            raise ValueError(
                f"{self.settings.pool} holds pairs of {width} x {height}, not "
                f"{self.settings.decisive()['size']} (width x height); give another --pool"
            )
        return arrays

    def _batch(self) -> list[Tensor]:
        """Return left, right (N, 3, h, W), disparity and visible (N, h, W) of random crops."""
        columns: list[list[Tensor]] = [[], [], [], []]
        usable = self.settings.pairs - VALIDATION_PAIRS
        for seed in torch.randint(usable, (self.settings.batch,), generator=self.generator):
            arrays = self._pair(int(seed))
            room = self.settings.size[1] - self.settings.crop_rows
            top = int(torch.randint(room + 1, (), generator=self.generator))
            upside_down = bool(torch.rand((), generator=self.generator) < 0.5)
            swap = torch.randperm(3, generator=self.generator)
            for column, (name, array) in zip(columns, arrays.items(), strict=True):
                part = torch.from_numpy(array[top : top + self.settings.crop_rows])
                part = part.flip(0) if upside_down else part
                if name in ("left", "right"):
                    part = part[..., swap].permute(2, 0, 1).float() / 255
                column.append(part)
        return [torch.stack(column) for column in columns]

    def update(self) -> float:
        """Do one step and return its loss."""
        left, right, disparity, visible = self._batch()
        weight = visible.float()
        if self.step >= self.settings.edges_from:
            weight = weight * (1 + self.settings.edge_weight * near_edges(disparity))
        left, right = self.augmentation(left, right, self.generator)
        self.network.train()
        both = torch.cat((left, right)).contiguous(memory_format=torch.channels_last)
        with torch.autocast("cpu", torch.bfloat16):
            features = self.network(both)
        of_left, of_right = features[:, :, ::ROW_STEP].float().chunk(2)
        truth = disparity[:, ::ROW_STEP], weight[:, ::ROW_STEP]
        loss = matching_loss(of_left, of_right, *truth, self.sharpness.exp())
        for group in self.optimiser.param_groups:
            group["lr"] = self.settings.learning_rate * self._rate()
        self.optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self.optimiser.step()
        self.step += 1
        return float(loss.detach())

    @torch.inference_mode()
    def validate(self) -> float:
        """Return `within_one_pixel` over the pairs that are never trained on."""
        network = self.network.fused()
        shares = []
        for seed in range(self.settings.pairs - VALIDATION_PAIRS, self.settings.pairs):
            arrays = self._pair(seed)
            both = torch.stack([torch.from_numpy(arrays[name]) for name in ("left", "right")])
            left, right = network(both.permute(0, 3, 1, 2).float() / 255).chunk(2)
            truth = torch.from_numpy(arrays["disparity"])[None]
            visible = torch.from_numpy(arrays["visible"])[None]
            shares.append(within_one_pixel(left, right, truth, visible))
        return float(np.mean(shares))


def main() -> None:
    """Read the settings from the command line and train."""
    import tyro

    tyro.cli(Training, description=__doc__)(lambda line: print(line, flush=True))  # noqa: T201


if __name__ == "__main__":
    main()
