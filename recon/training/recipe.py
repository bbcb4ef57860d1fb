"""What generated scenes may be made of: leave an ingredient out to see what it is worth."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

__all__ = ["FULL", "HARD", "REPEATING", "SCENES", "VERSION", "Recipe", "recipe_hash"]

VERSION = 1
"""Raised whenever the same seed and recipe begin to give another pair."""

SCENES = (
    "room",
    "clutter",
    "dense",
    "garden",
    "fence",
    "lattice",
    "sheets",
    "landscape",
    "close_up",
    "colonnade",
    "relief",
)
"""Kinds of scene that are drawn if nobody says, see `recon.training.scenery`."""

HARD = ("street", "bare_room", "white_room")
"""Kinds of scene where only the surroundings tell the disparity: named to be drawn."""

REPEATING = ("fence", "lattice", "colonnade")
"""Kinds of scene that are about repeated structures."""


@dataclass(frozen=True)
class Recipe:
    """Ingredients of scenes.

    Attributes:
        scenes: kinds of scene to draw from, each as often as the others; one that is named twice
            comes twice as often.
        wide_baselines: spread the largest disparity from 3 % to 25 % of the width; else 8 to 12 %.
        textured_background: pattern on walls, grounds and backdrops; else flat paint.
        weak_texture: leave a share of the surfaces nearly blank, as walls of rooms are.
        shared_textures: give some things the paint of another, often of what is behind them.
        repeated_structures: `REPEATING` scenes, and patterns that repeat exactly.
        reliefs: surfaces with hills and folds; else smooth shapes only.
        light: shading, shadows, lamps and highlights; else colours as they were painted.

    Raises:
        ValueError: if a kind of scene is unknown or none is left.
    """

    scenes: tuple[str, ...] = SCENES
    wide_baselines: bool = True
    textured_background: bool = True
    weak_texture: bool = True
    shared_textures: bool = True
    repeated_structures: bool = True
    reliefs: bool = True
    light: bool = True

    def __post_init__(self) -> None:
        unknown = [name for name in self.scenes if name not in SCENES + HARD]
        if unknown:
            there = ", ".join(SCENES + HARD)
            raise ValueError(f"unknown scene {unknown[0]!r}; there are {there}")
        if not self.kinds:
            raise ValueError(
                f"no kind of scene is left of {self.scenes} without "
                + ("reliefs" if self.repeated_structures else "repeated structures")
            )

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of scene that the other ingredients leave."""
        left_out: tuple[str, ...] = () if self.repeated_structures else REPEATING
        left_out += () if self.reliefs else ("relief",)
        return tuple(name for name in self.scenes if name not in left_out)


FULL = Recipe()


def recipe_hash(*settings: DataclassInstance) -> str:
    """Return 12 hexadecimal digits that follow from what the pairs are made of and from `VERSION`.

    Args:
        settings: frozen dataclasses, such as a `Recipe` and an `Augmentation`, in this order.
    """
    contents = [VERSION, *({type(one).__name__: asdict(one)} for one in settings)]
    text = json.dumps(contents, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:12]
