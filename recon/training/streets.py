"""A road between houses: smooth asphalt, glossy cars, empty sky, as a car sees it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from recon.training.composition import Coat, Place, Thing, rotation_about, turned
from recon.training.furnishing import rod, sky, tree
from recon.training.staging import NEAR_M, Stage

__all__ = ["street"]

X, Y, _ = torch.eye(3)
FLAT = rotation_about(X, math.pi / 2)
EYE_ABOVE_ROAD_M = 1.6
FACADES = ("brick", "checks", "stripes", "noise", "glyphs", "cells")


@dataclass(frozen=True, eq=False)
class _Road:
    """A straight road, in metres as people measure them.

    Attributes:
        stage: randomness and paint.
        metre: how long a metre is in the scene.
        turn: (3, 3) from along, across and above the road to the frame of the camera.
        half_width: metres.
        length: metres from the camera to where it ends.
    """

    stage: Stage
    metre: float
    turn: Tensor
    half_width: float
    length: float

    def at(self, across: float, above: float, along: float) -> Place:
        """Return a place right of the camera, above the road and ahead, in the scene."""
        local = (across, EYE_ABOVE_ROAD_M - above, along)
        return turned(self.turn, (local[0] * self.metre, local[1] * self.metre, along * self.metre))

    def block(self, middle: Place, size: Place, coat: Coat, kind: str = "box") -> Thing:
        """Return a box of a whole `size` (across, above, along) with its middle there."""
        half = tuple(0.5 * self.metre * extent for extent in size)
        return Thing(kind, self.at(*middle), (half[0], half[1], half[2]), self.turn, coat)

    def depth(self, along: float) -> float:
        """Return a depth in the scene, no nearer than things are put."""
        return max(NEAR_M, along * self.metre)


def street(stage: Stage) -> list[Thing]:
    """Return a road, what is painted on it, houses, parked cars, posts, trees and the sky."""
    dice = stage.dice
    eye = NEAR_M * dice.uniform(1.0, 2.0) * 0.5 * stage.view.height / stage.view.focal_px
    yaw = dice.uniform(-0.12, 0.12) if dice.chance(0.7) else dice.uniform(-0.7, 0.7)
    metre = eye / EYE_ABOVE_ROAD_M
    road = _Road(
        stage,
        metre,
        dice.rotation(0.03) @ rotation_about(Y, yaw),
        half_width=dice.uniform(3, 8),
        length=1.5 * NEAR_M / stage.far / metre,
    )
    heaven = sky(stage)
    if dice.chance(0.6):
        bright = 0.85 + 0.1 * torch.rand(3, generator=dice.generator)
        heaven = replace(heaven, coat=Coat("flat", torch.stack((bright, bright)), 1.0, grain=0.0))
    found = [*_surface(road), heaven, *_markings(road)]
    for side in (-1, 1):
        found += _houses(road, side) + _parked(road, side) + _posts(road, side)
    return found


def _surface(road: _Road) -> list[Thing]:
    """Return the asphalt and a raised pavement on either side."""
    stage, far = road.stage, 2 * road.length * road.metre
    near = road.depth(6)
    asphalt = stage.blank(near) if stage.dice.chance(0.6) else stage.papered(near, ("earth",))
    asphalt = replace(asphalt, gloss=0.0)
    ground = Thing("rectangle", road.at(0, 0, 0), (far, far, 1.0), road.turn @ FLAT, asphalt)
    if stage.dice.chance(0.3):
        return [ground]
    stones = stage.papered(near, ("checks", "brick", "noise", "cells", "earth"))
    stones = replace(stones, gloss=0.0)
    width, size = stage.dice.uniform(1.5, 4), 2 * road.length
    return [ground] + [
        road.block((side * (road.half_width + width / 2), 0.0, 0.0), (width, 0.3, size), stones)
        for side in (-1, 1)
    ]


def _markings(road: _Road) -> list[Thing]:
    """Return dashes or lines of paint."""
    dice = road.stage.dice
    white = Coat("flat", dice.colours(0.01, 0.02).clamp_min(0.5), 1.0, grain=0.02)
    dash, gap = dice.uniform(1, 4), dice.uniform(1, 6)
    start, across = dice.uniform(0, 5), dice.uniform(-1.5, 1.5)
    return [
        road.block((across, 0.0, start + step * (dash + gap)), (0.15, 0.01, dash), white)
        for step in range(dice.whole(0, 8))
    ]


def _houses(road: _Road, side: int) -> list[Thing]:
    """Return houses one after the other, with gaps here and there."""
    dice, found = road.stage.dice, []
    along, aside = dice.uniform(-5, 10), road.half_width + dice.uniform(2, 10)
    for _ in range(dice.whole(2, 7)):
        long, tall, deep = dice.uniform(6, 25), dice.uniform(3, 14), dice.uniform(6, 15)
        coat = road.stage.papered(road.depth(along), FACADES)
        middle = (side * (aside + deep / 2), tall / 2, along + long / 2)
        found.append(road.block(middle, (deep, tall, long), coat))
        if dice.chance(0.5):
            found += _windows(road, side * aside, along, long, tall)
        along += long + (dice.uniform(1, 12) if dice.chance(0.4) else 0.0)
        if along > road.length:
            break
    return found


def _windows(road: _Road, across: float, along: float, long: float, tall: float) -> list[Thing]:
    """Return panes that stand out of a front by a hand."""
    pane = road.stage.blank(road.depth(along + long / 2))
    columns, floors = max(1, int(long / 3.5)), max(1, int(tall / 3))
    return [
        road.block((across, 3 * floor + 1.7, along + 3.5 * column + 1.7), (0.2, 1.4, 1.3), pane)
        for column in range(min(columns, 5))
        for floor in range(min(floors, 3))
    ]


def _parked(road: _Road, side: int) -> list[Thing]:
    """Return cars along the kerb, or on the road."""
    dice, found = road.stage.dice, []
    for _ in range(dice.whole(0, 5)):
        along = max(1.2 * NEAR_M / road.metre + 2.5, dice.log_uniform(5, 60))
        across = side * road.half_width * dice.uniform(0.45, 1.0)
        found += _car(road, across, along)
    return found


def _car(road: _Road, across: float, along: float) -> list[Thing]:
    """Return a body, a cabin of glass and wheels."""
    dice, depth = road.stage.dice, road.depth(along)
    paint = replace(road.stage.blank(depth), gloss=dice.uniform(0, 0.6))
    dark = replace(road.stage.blank(depth), colours=dice.colours(0.02, 0.1) * 0.05)
    wide, tall, long = dice.uniform(1.6, 2.0), dice.uniform(0.6, 1.2), dice.uniform(3.5, 5.5)
    cabin = dice.one_of(("box", "ellipsoid"))
    parts = [
        road.block((across, 0.3 + tall / 2, along), (wide, tall, long), paint),
        road.block((across, 0.3 + tall, along), (0.85 * wide, 1.1, 0.6 * long), dark, cabin),
    ]
    for corner in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        middle = (across + corner[0] * 0.42 * wide, 0.32, along + corner[1] * 0.32 * long)
        parts.append(road.block(middle, (0.4, 0.64, 0.64), dark, "ellipsoid"))
    return parts


def _posts(road: _Road, side: int) -> list[Thing]:
    """Return lamp posts, signs and trees beside the road."""
    dice, stage, found = road.stage.dice, road.stage, []
    for _ in range(dice.whole(0, 6)):
        along = dice.log_uniform(1.5 * NEAR_M / road.metre, 60)
        across = side * (road.half_width + dice.uniform(0.2, 3))
        coat, tall = stage.painted(road.depth(along)), dice.uniform(2, 7)
        if dice.chance(0.4):
            crown = stage.painted(road.depth(along), ("noise", "earth"))
            size = tall / 2 * road.metre
            found += tree(stage, road.at(across, 0, along), size, coat, crown)
            continue
        thick = dice.uniform(0.03, 0.15) * road.metre
        found.append(rod(road.at(across, 0, along), road.at(across, tall, along), thick, coat))
        if dice.chance(0.5):
            sign = stage.painted(road.depth(along))
            found.append(road.block((across, tall - 0.4, along), (0.8, 0.8, 0.05), sign))
    return found
