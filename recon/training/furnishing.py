"""Random rooms, clutter, foliage and fences.

Everything is placed by inverse depth and by its size in pixels, so that every baseline and every
focal length gives a full image.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from recon.training.composition import (
    Coat,
    Scene,
    Thing,
    View,
    assemble,
    rotation_about,
    turned,
)
from recon.training.shapes import KINDS
from recon.training.textures import STYLES, noise_table

__all__ = ["KINDS_OF_SCENE", "compose"]

NEAR_M = 1.0
MOST_WITH_SHADOW = 80
X, Y, Z = torch.eye(3)


@dataclass(frozen=True)
class Dice:
    """Random numbers of the kinds a scene needs, all from one generator."""

    generator: torch.Generator

    def uniform(self, low: float, high: float) -> float:
        """Return a number in [low, high)."""
        return low + (high - low) * float(
            torch.rand((), generator=self.generator, device=self.generator.device)
        )

    def log_uniform(self, low: float, high: float) -> float:
        """Return a number in [low, high) whose logarithm is uniform."""
        return math.exp(self.uniform(math.log(low), math.log(high)))

    def whole(self, low: int, high: int) -> int:
        """Return a whole number in [low, high]."""
        return int(self.uniform(low, high + 1))

    def one_of(self, choices: tuple[str, ...]) -> str:
        """Return one of `choices`."""
        return choices[self.whole(0, len(choices) - 1)]

    def rotation(self, most: float = math.pi) -> Tensor:
        """Return a (3, 3) rotation by up to `most` radians about a random axis."""
        axis = torch.randn(3, generator=self.generator, device=self.generator.device).cpu()
        return rotation_about(axis / axis.norm(), self.uniform(-most, most))

    def colours(self) -> Tensor:
        """Return two linear RGB colours (2, 3), sometimes close to each other."""
        device = self.generator.device
        first = torch.rand(3, generator=self.generator, device=device) ** 1.5
        grey = first.mean() * torch.ones(3, device=device)
        first = torch.lerp(first, grey, self.uniform(0, 0.9))
        step = torch.randn(3, generator=self.generator, device=device)
        step = torch.lerp(step, step.mean().expand(3), self.uniform(0.2, 1.0))
        second = first + step * self.log_uniform(0.04, 0.6)
        return torch.stack((first, second)).clamp(0.01, 0.95)


@dataclass(frozen=True)
class Stage:
    """Where things can be put: turns pixels and disparities into metres.

    Attributes:
        dice: randomness.
        view: the cameras.
        far_px: smallest disparity.
    """

    dice: Dice
    view: View
    far_px: float

    @property
    def near_px(self) -> float:
        """Largest disparity, that of `NEAR_M`."""
        return self.view.focal_px * self.view.baseline_m / NEAR_M

    def depth(self, low: float = 0.0, high: float = 1.0) -> float:
        """Return a depth whose disparity is uniform; 0 is the back, 1 the front."""
        share = self.dice.uniform(low, high)
        disparity = self.far_px + share * (self.near_px - self.far_px)
        return self.view.focal_px * self.view.baseline_m / disparity

    def place(self, depth: float, spread: float = 0.55) -> tuple[float, float, float]:
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
        dice = self.dice
        style = "noise" if dice.uniform(0, 1) < 0.4 else dice.one_of(styles)
        return Coat(
            style,
            dice.colours(),
            frequency=1 / self.metres(dice.log_uniform(3, 60), depth),
            turn=dice.uniform(0, 2 * math.pi),
            slope=dice.uniform(0.0, 0.9),
            grain=dice.log_uniform(0.05, 1.0),
            gloss=max(0.0, dice.uniform(-0.5, 0.4)),
            offset=(dice.uniform(0, 500), dice.uniform(0, 500)),
        )


def _sheet(stage: Stage, depth: float, rotation: Tensor, half_px: float) -> Thing:
    """Return a large rectangle at `depth`, straight ahead."""
    half = stage.metres(half_px, depth)
    return Thing("rectangle", (0, 0, depth), (half, half, 1), rotation, stage.painted(depth))


def _backdrop(stage: Stage) -> list[Thing]:
    """Return a wall at the back, slanted a little, with texture always."""
    depth = stage.depth(0, 0.15)
    return [_sheet(stage, depth, stage.dice.rotation(0.5), 4 * stage.view.width)]


def _room(stage: Stage) -> list[Thing]:
    """Return a floor, side walls, perhaps a ceiling, and a back wall."""
    dice = stage.dice
    back = stage.depth(0, 0.05)
    turn_floor = rotation_about(X, math.pi / 2)
    turn_side = rotation_about(Y, math.pi / 2)
    tilt = dice.rotation(0.25)
    below = NEAR_M * dice.uniform(0.4, 1.2) * stage.view.height / stage.view.focal_px
    aside = back * dice.uniform(0.3, 0.8) * stage.view.width / stage.view.focal_px
    walls = [((0.0, below, 0.0), turn_floor), ((-aside, 0.0, 0.0), turn_side)]
    walls += [((aside, 0.0, 0.0), turn_side), ((0.0, -2.5 * below - aside, 0.0), turn_floor)]
    walls += [((0.0, 0.0, back), torch.eye(3))]
    kept = [wall for wall in walls if wall[0][1] > 0 or wall[0][2] > 0 or dice.uniform(0, 1) < 0.6]
    return [
        Thing(
            "rectangle",
            turned(tilt, centre),
            (3 * back, 3 * back, 1.0),
            tilt @ turn,
            stage.painted(stage.depth(0, 0.5)),
        )
        for centre, turn in kept
    ] + [_sheet(stage, 1.6 * back, torch.eye(3), 6 * stage.view.width)]


def _solids(stage: Stage, count: int, kinds: tuple[str, ...] = tuple(KINDS)) -> list[Thing]:
    """Return separate things of all shapes, turned anyhow."""
    dice, things = stage.dice, []
    for _ in range(count):
        depth = stage.depth(0.05)
        half = stage.metres(dice.log_uniform(0.03, 0.3) * stage.view.width, depth)
        width, height, length = (half * dice.log_uniform(0.3, 1.0) for _ in range(3))
        if dice.uniform(0, 1) < 0.2:  # a pole
            width = height = stage.metres(dice.log_uniform(0.8, 4), depth)
            length = 3 * half
        things.append(
            Thing(
                dice.one_of(kinds),
                stage.place(depth),
                (width, height, length),
                dice.rotation(),
                stage.painted(depth),
            )
        )
    return things


def _foliage(stage: Stage, count: int) -> list[Thing]:
    """Return clouds of small leaves that share one paint."""
    dice, things = stage.dice, []
    for _ in range(dice.whole(1, 3)):
        depth = stage.depth(0.2)
        middle = stage.place(depth, 0.35)
        reach = stage.metres(dice.uniform(0.08, 0.25) * stage.view.width, depth)
        leaf = stage.metres(dice.log_uniform(3, 25), depth)
        paint = stage.painted(depth, ("noise", "gradient", "stripes", "wood"))
        for _ in range(count):
            x, y, z = (c + reach * dice.uniform(-1, 1) for c in middle)
            where = (x, y, max(z, 0.7 * NEAR_M))
            things.append(Thing("disc", where, (leaf, leaf * 0.4, 1.0), dice.rotation(), paint))
    return things


def _fence(stage: Stage) -> list[Thing]:
    """Return a row of equal slats, the classic repeated structure."""
    dice, things = stage.dice, []
    depth = stage.depth(0.2, 0.9)
    count = dice.whole(5, 16)
    gap = stage.metres(dice.uniform(0.2, 0.9) * stage.view.width / count, depth)
    size = (gap * dice.uniform(0.1, 0.4), stage.metres(stage.view.width, depth), gap * 0.1)
    middle, turn = stage.place(depth, 0.3), dice.rotation(0.6)
    turn = turn @ rotation_about(Z, dice.uniform(-1.6, 1.6))
    paint = stage.painted(depth)
    for number in range(count):
        x, y, z = turned(turn, (gap * (number - count / 2), 0.0, 0.0))
        where = (middle[0] + x, middle[1] + y, middle[2] + z)
        things.append(Thing("box", where, size, turn, paint))
    return things


def _furnished_room(stage: Stage) -> list[Thing]:
    return _room(stage) + _solids(stage, stage.dice.whole(8, 25))


def _clutter(stage: Stage) -> list[Thing]:
    return _backdrop(stage) + _solids(stage, stage.dice.whole(15, 50))


def _garden(stage: Stage) -> list[Thing]:
    return _backdrop(stage) + _foliage(stage, 60) + _solids(stage, stage.dice.whole(2, 8))


def _fenced(stage: Stage) -> list[Thing]:
    first = _room(stage) if stage.dice.uniform(0, 1) < 0.5 else _backdrop(stage)
    return first + _fence(stage) + _solids(stage, stage.dice.whole(2, 10))


def _sheets(stage: Stage) -> list[Thing]:
    """Return few, large, strongly slanted planes: a close-up."""
    sheets = []
    for _ in range(stage.dice.whole(2, 6)):
        depth = stage.depth(0.1, 0.8)
        sheet = _sheet(
            stage, depth, stage.dice.rotation(1.1), stage.dice.uniform(0.1, 0.4) * stage.view.width
        )
        where = stage.place(depth, 0.5)
        sheets.append(replace(sheet, centre=where))
    return _backdrop(stage) + sheets + _solids(stage, stage.dice.whole(0, 5))


KINDS_OF_SCENE: dict[str, Callable[[Stage], list[Thing]]] = {
    "room": _furnished_room,
    "clutter": _clutter,
    "garden": _garden,
    "fence": _fenced,
    "sheets": _sheets,
}


def compose(generator: torch.Generator, size: tuple[int, int]) -> tuple[Scene, View]:
    """Return a random scene and the cameras that look at it.

    Args:
        generator: source of all randomness.
        size: (width, height) of the images in pixels.
    """
    dice = Dice(generator)
    width, height = size
    focal_px = width * dice.log_uniform(0.7, 2.5)
    near_px = width * dice.uniform(0.05, 0.25)
    view = View(width, height, focal_px, near_px * NEAR_M / focal_px)
    stage = Stage(dice, view, near_px * dice.uniform(0.08, 0.6))
    things = KINDS_OF_SCENE[dice.one_of(tuple(KINDS_OF_SCENE))](stage)
    to_light = torch.tensor([dice.uniform(-0.7, 0.7), -1.0, dice.uniform(-1.2, 0.2)])
    scene = assemble(
        things,
        noise_table(generator),
        to_light / to_light.norm(),
        shadows=len(things) < MOST_WITH_SHADOW and dice.uniform(0, 1) < 0.5,
    )
    return scene, view
