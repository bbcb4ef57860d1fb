"""What a training follows from. Imports nothing heavy: the command line reads it for --help."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, Literal

from recon.training.recipe import FULL, Recipe, recipe_hash

__all__ = ["FeatureTraining", "RegulariserTraining", "Training"]

HABITS = ("out", "pool", "workers", "save_every", "max_minutes")
"""Settings that change no weight."""


@dataclass(frozen=True)
class Training:
    """Settings that every training has; its weights follow from them alone.

    Attributes:
        recipe: what the scenes are made of.
        source: train on a pool of pairs that is kept, or on fresh pairs that are drawn meanwhile;
            auto keeps a pool on a CPU only, where drawing is what takes longest.
        out: folder of checkpoint, log and weights; checkpoints/NAME if not given.
        pool: folder of generated pairs; drawn first where missing.
        pairs: how many pairs are in the pool.
        validation_pairs: how many of them, the last ones, are never trained on.
        uses: in how many batches a fresh pair takes part, in the mean.
        window: among how many fresh pairs a batch is chosen.
        draw_on: whether fresh pairs are drawn on the device that trains or beside it on the CPU.
        workers: processes that draw pairs; one a core if not given, 0 for this process alone.
        steps: updates of the weights.
        batch: pairs an update.
        crop_rows: rows of each pair an update sees, over the full width.
        learning_rate: the largest one; it falls along a cosine.
        warm_up: steps in which it rises first.
        photometric: change light, tone, sharpness and noise of what the network sees.
        geometric: move its rows and colours by fractions of a pixel, and zoom.
        occluders: cover a part of one view.
        seed: of the weights, of the order of the pairs and of the augmentation.
        size: width and height of the pairs in pixels.
        save_every: steps between checkpoints, scores and pictures.
        max_minutes: stop with a checkpoint after so long; the same command goes on from there.
        begin_from: weights to begin from, a name that ships or a file; random ones if not given.

    Raises:
        ValueError: if a setting is out of range.
    """

    command_words: ClassVar[str] = "reconstruct train"

    recipe: Recipe = FULL
    source: Literal["auto", "pool", "fresh"] = "auto"
    out: Path | None = None
    pool: Path = Path("checkpoints/pool")
    pairs: int = 264
    validation_pairs: int = 24
    uses: int = 4
    window: int = 256
    draw_on: Literal["device", "cpu"] = "device"
    workers: int | None = None
    steps: int = 1000
    batch: int = 4
    crop_rows: int = 48
    learning_rate: float = 1.5e-3
    warm_up: int = 100
    photometric: bool = True
    geometric: bool = True
    occluders: bool = True
    seed: int = 0
    size: tuple[int, int] = (416, 256)
    save_every: int = 250
    max_minutes: float | None = None
    begin_from: str | None = None

    def __post_init__(self) -> None:
        if self.pairs <= self.validation_pairs:
            raise ValueError(
                f"pairs must be more than the {self.validation_pairs} that are kept for "
                f"validation, got {self.pairs}"
            )
        if not 0 < self.crop_rows <= self.size[1]:
            raise ValueError(
                f"crop_rows must be from 1 to the height of the pairs, {self.size[1]}, "
                f"got {self.crop_rows}"
            )
        positive = ("validation_pairs", "uses", "window", "steps", "batch", "learning_rate")
        for name in (*positive, "warm_up", "save_every"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        if self.workers is not None and self.workers < 0:
            raise ValueError(f"workers must not be negative, got {self.workers}")
        if self.max_minutes is not None and not self.max_minutes > 0:
            raise ValueError(f"max_minutes must be positive, got {self.max_minutes}")

    @property
    def name(self) -> str:
        """What the weights are called."""
        raise NotImplementedError

    @property
    def folder(self) -> Path:
        """Where everything is written."""
        return self.out or Path("checkpoints") / self.name

    @property
    def training_seeds(self) -> range:
        """Pairs of the pool that are trained on."""
        return range(self.pairs - self.validation_pairs)

    @property
    def validation_seeds(self) -> range:
        """Pairs of the pool that are not."""
        return range(self.pairs - self.validation_pairs, self.pairs)

    def decisive(self) -> dict[str, str | int | float | None]:
        """Return the settings that the weights follow from: all but folders and habits."""
        settings = {name: value for name, value in asdict(self).items() if name not in HABITS}
        size, recipe = "{} x {}".format(*self.size), recipe_hash(self.recipe)
        return {**settings, "size": size, "recipe": recipe}

    def command(self) -> str:
        """Return the command line that trains the same weights, without folders and habits."""
        return " ".join([self.command_words, *_flags(self, "")])


@dataclass(frozen=True)
class FeatureTraining(Training):
    """Settings of a training of the matching cost network.

    Attributes:
        variant: the network to train, fast or wide.
        support_px: radius of the bilateral window through which the loss looks at the costs, as the
            matcher will; 0 looks at raw costs.
        edge_weight: how much more the pixels near a depth edge count. A network that sees far finds
            the foreground before it finds the edge, and fattens it unless told to look.
        edges_from: the step from which they do.
    """

    variant: str = "fast"
    support_px: int = 6
    edge_weight: float = 2.0
    edges_from: int = 250

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.support_px < 0:
            raise ValueError(f"support_px must not be negative, got {self.support_px}")

    @property
    def name(self) -> str:
        """See `Training`."""
        return self.variant


@dataclass(frozen=True)
class RegulariserTraining(Training):
    """Settings of a training of the regulariser, on the costs of a network that is ready.

    Attributes:
        cost_weights: of the matching cost network: a name that ships, or a file.
        direct_share: see `recon.matching_cost.LearnedCost`.
        census_share: likewise.
        most_candidates: disparities that are searched at most.
        spare_range: how much more than the largest disparity of a batch is searched, at most, as a
            share: nobody knows the range exactly.
    """

    command_words: ClassVar[str] = "reconstruct train regulariser"

    pairs: int = 800
    steps: int = 4000
    batch: int = 2
    crop_rows: int = 128
    learning_rate: float = 1e-3
    cost_weights: str = "fast"
    direct_share: float = 0.4
    census_share: float = 0.0
    most_candidates: int = 144
    spare_range: float = 0.6

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.most_candidates < 1:
            raise ValueError(f"most_candidates must be positive, got {self.most_candidates}")
        if self.spare_range < 0:
            raise ValueError(f"spare_range must not be negative, got {self.spare_range}")

    @property
    def name(self) -> str:
        """See `Training`."""
        return "regulariser"


def _flags(settings: Training | Recipe, prefix: str) -> Iterator[str]:
    """Give the options that differ from what they are if nobody says."""
    for field in fields(settings):
        value: Any = getattr(settings, field.name)
        name = field.name.replace("_", "-")
        if field.name in HABITS or value == field.default:
            continue
        if isinstance(value, Recipe):
            yield from _flags(value, f"{name}.")
        elif isinstance(value, bool):
            yield f"--{prefix}{name}" if value else f"--{prefix}no-{name}"
        else:
            yield f"--{prefix}{name}"
            yield " ".join(map(str, value)) if isinstance(value, tuple) else str(value)
