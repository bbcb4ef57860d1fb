"""Where things can be put and how they are painted, in pixels and disparities instead of metres."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from recon.training.composition import Coat, Place, View, rotation_about
from recon.training.patterns import PERIODIC, STYLES
from recon.training.recipe import Recipe

__all__ = ["NEAR_M", "Dice", "Stage"]

NEAR_M = 1.0
PLAIN = ("flat", "gradient")
WEAK_WALLS = 0.18
WEAK_THINGS = 0.06


@dataclass(frozen=True)
class Dice:
    """Random numbers of the kinds a scene needs, all from one generator on the CPU."""

    generator: torch.Generator

    def uniform(self, low: float, high: float) -> float:
        """Return a number in [low, high)."""
        return low + (high - low) * float(torch.rand((), generator=self.generator))

    def log_uniform(self, low: float, high: float) -> float:
        """Return a number in [low, high) whose logarithm is uniform."""
        return math.exp(self.uniform(math.log(low), math.log(high)))

    def whole(self, low: int, high: int) -> int:
        """Return a whole number in [low, high]."""
        return int(self.uniform(low, high + 1))

    def chance(self, share: float) -> bool:
        """Return true in `share` of the cases."""
        return self.uniform(0, 1) < share

    def one_of(self, choices: tuple[str, ...]) -> str:
        """Return one of `choices`."""
        return choices[self.whole(0, len(choices) - 1)]

    def rotation(self, most: float = math.pi) -> Tensor:
        """Return a (3, 3) rotation by up to `most` radians about a random axis."""
        axis = torch.randn(3, generator=self.generator)
        return rotation_about(axis / axis.norm(), self.uniform(-most, most))

    def colours(self, least: float = 0.08, most: float = 0.8) -> Tensor:
        """Return two linear RGB colours (2, 3), `least` to `most` apart as they are displayed."""
        first = 0.05 + 0.9 * torch.rand(3, generator=self.generator)
        first = torch.lerp(first, first.mean().expand(3), self.uniform(0, 1) ** 0.5)
        step = torch.randn(3, generator=self.generator)
        step = torch.lerp(step, step.mean().expand(3), self.uniform(0.3, 1.0))
        step *= self.log_uniform(least, most) / step.abs().amax()
        step = torch.where((first + step - 0.5).abs().amax() > 0.6, -step, step)  # stay in range
        return torch.stack((first, first + step)).clamp(0.03, 0.97) ** 2.2


@dataclass(frozen=True)
class Stage:
    """Where things can be put: turns pixels and disparities into metres.

    Attributes:
        dice: randomness.
        view: the cameras; their baseline does not matter yet.
        recipe: what may be used.
        far: smallest disparity, as a share of that of `NEAR_M`.
        weak_walls: share of walls, grounds and backdrops that are nearly blank.
        weak_things: share of other things that are.
    """

    dice: Dice
    view: View
    recipe: Recipe
    far: float
    weak_walls: float = WEAK_WALLS
    weak_things: float = WEAK_THINGS

    def depth(self, low: float = 0.0, high: float = 1.0) -> float:
        """Return a depth whose disparity is uniform; 0 is the back, 1 the front."""
        share = self.dice.uniform(low, high)
        return NEAR_M / (self.far + share * (1 - self.far))

    def place(self, depth: float, spread: float = 0.55) -> Place:
        """Return a place at `depth` that projects into the image or just beside it."""
        reach_x = spread * self.view.width / self.view.focal_px * depth
        reach_y = spread * self.view.height / self.view.focal_px * depth
        return (
            self.dice.uniform(-reach_x, reach_x),
            self.dice.uniform(-reach_y, reach_y),
            depth,
        )

    def metres(self, pixels: float, depth: float) -> float:
        """Return the length that covers `pixels` at `depth`."""
        return pixels * depth / self.view.focal_px

    def painted(self, depth: float, styles: tuple[str, ...] = tuple(STYLES)) -> Coat:
        """Return random paint for something at `depth`."""
        if self.recipe.weak_texture and self.dice.chance(self.weak_things):
            return self.blank(depth)
        return self._patterned(depth, styles)

    def papered(self, depth: float, styles: tuple[str, ...] = tuple(STYLES)) -> Coat:
        """Return random paint for a wall, a ground or a backdrop, seen at about `depth`.

        `weak_walls` of them are nearly blank, and no others.
        """
        if not self.recipe.textured_background:
            return Coat("flat", self.dice.colours(1e-4, 2e-4), self._frequency(depth), grain=0.0)
        if self.recipe.weak_texture and self.dice.chance(self.weak_walls):
            return self.blank(depth)
        rich = tuple(style for style in styles if style not in PLAIN)
        return self._patterned(depth, rich)

    def _frequency(self, depth: float, least: float = 3, most: float = 60) -> float:
        """Return a frequency whose period covers `least` to `most` pixels at `depth`."""
        return 1 / self.metres(self.dice.log_uniform(least, most), depth)

    def _patterned(self, depth: float, styles: tuple[str, ...]) -> Coat:
        dice = self.dice
        banned = () if self.recipe.repeated_structures else PERIODIC
        allowed = tuple(style for style in styles if style not in banned)
        noisy = "noise" in allowed and dice.chance(0.3)
        style = "noise" if noisy else dice.one_of(allowed)
        return Coat(
            style,
            dice.colours(),
            frequency=self._frequency(depth),
            turn=dice.uniform(0, 2 * math.pi),
            slope=dice.uniform(-0.2, 0.9),
            grain=dice.log_uniform(0.05, 1.0),
            gloss=max(0.0, dice.uniform(-0.5, 0.4)),
            offset=(dice.uniform(0, 500), dice.uniform(0, 500)),
        )

    def blank(self, depth: float) -> Coat:
        """Return nearly even paint with faint grain of a few pixels, as on a wall of a room."""
        dice = self.dice
        return Coat(
            dice.one_of(PLAIN),
            dice.colours(0.04, 0.2),
            frequency=self._frequency(depth, 15, 60),
            slope=dice.uniform(0.0, 0.5),
            grain=dice.log_uniform(0.3, 1.2),
            gloss=max(0.0, dice.uniform(-0.5, 0.3)),
            offset=(dice.uniform(0, 500), dice.uniform(0, 500)),
        )
