"""Things that repeat: fences, grids, wires, columns, windows and steps."""

from __future__ import annotations

import math
from itertools import pairwise

import torch
from torch import Tensor

from recon.training.composition import Place, Thing, rotation_about, turned
from recon.training.furnishing import rod
from recon.training.staging import NEAR_M, Stage

__all__ = ["columns", "facade", "fence", "grid", "steps", "wires"]

X, Y, Z = torch.eye(3)


def _moved(middle: Place, turn: Tensor, by: Place) -> Place:
    """Return the place `by` from `middle`, in turned axes."""
    x, y, z = turned(turn, by)
    return middle[0] + x, middle[1] + y, middle[2] + z


def _row_of_bars(stage: Stage, depth: float, middle: Place, turn: Tensor) -> list[Thing]:
    """Return equal bars side by side, boxes or rods, along the turned y axis."""
    dice = stage.dice
    count = dice.whole(4, 14)
    gap = stage.metres(dice.uniform(0.3, 1.0) * stage.view.width / count, depth)
    thick, long = gap * dice.log_uniform(0.04, 0.4), stage.metres(0.9 * stage.view.width, depth)
    kind = dice.one_of(("box", "cylinder"))
    size = (thick, long, 0.3 * thick) if kind == "box" else (thick, thick, long)
    upright = turn if kind == "box" else turn @ rotation_about(X, math.pi / 2)
    paint = stage.painted(depth)
    steps = [(gap * (number - count / 2), 0.0, 0.0) for number in range(count)]
    return [Thing(kind, _moved(middle, turn, step), size, upright, paint) for step in steps]


def fence(stage: Stage) -> list[Thing]:
    """Return a row of equal slats, the classic repeated structure."""
    depth = stage.depth(0.2, 0.9)
    turn = stage.dice.rotation(0.6) @ rotation_about(Z, stage.dice.uniform(-1.6, 1.6))
    return _row_of_bars(stage, depth, stage.place(depth, 0.3), turn)


def grid(stage: Stage) -> list[Thing]:
    """Return two rows of bars that cross."""
    depth = stage.depth(0.3, 0.95)
    middle = stage.place(depth, 0.2)
    turn = stage.dice.rotation(0.5) @ rotation_about(Z, stage.dice.uniform(-0.8, 0.8))
    crossing = turn @ rotation_about(Z, stage.dice.uniform(0.9, 2.2))
    return [
        *_row_of_bars(stage, depth, middle, turn),
        *_row_of_bars(stage, depth, middle, crossing),
    ]


def wires(stage: Stage, count: int) -> list[Thing]:
    """Return cables that hang between two ends, as chains of thin rods."""
    dice, things = stage.dice, []
    for _ in range(count):
        depths = stage.depth(0.1), stage.depth(0.1)
        start, end = (stage.place(depth, 0.8) for depth in depths)
        radius = stage.metres(dice.log_uniform(0.5, 2.5), min(depths))
        sag = dice.uniform(0, 0.25) * math.dist(start, end)
        paint = stage.painted(min(depths))
        links = dice.whole(4, 9)
        nodes: list[Place] = []
        for step in range(links + 1):
            share = step / links
            x, y, z = (a + share * (b - a) for a, b in zip(start, end, strict=True))
            nodes.append((x, y + 4 * sag * share * (1 - share), z))
        things += [rod(a, b, radius, paint) for a, b in pairwise(nodes)]
    return things


def columns(stage: Stage) -> list[Thing]:
    """Return rows of equal columns that stand on one level and recede."""
    dice = stage.dice
    kind = dice.one_of(("cylinder", "box"))
    turn = rotation_about(Y, dice.uniform(-0.8, 0.8))
    depth = stage.depth(0.4, 0.9)
    gap = stage.metres(dice.uniform(0.12, 0.35) * stage.view.width, depth)
    thick, tall = gap * dice.uniform(0.12, 0.3), stage.metres(stage.view.height, depth)
    upright = turn @ rotation_about(X, math.pi / 2)
    paint = stage.painted(depth)
    found = []
    for row in range(dice.whole(1, 4)):
        for column in range(-4, 5):
            where = _moved((0.0, 0.0, depth), turn, (gap * column, 0.0, 1.5 * gap * row))
            if where[2] > 0.8 * NEAR_M:
                found.append(Thing(kind, where, (thick, thick, tall), upright, paint))
    return found


def facade(stage: Stage) -> list[Thing]:
    """Return a wall with a grid of equal windows or blocks that stand out a little."""
    dice = stage.dice
    depth = stage.depth(0.1, 0.5)
    turn = rotation_about(Y, dice.uniform(-0.9, 0.9)) @ dice.rotation(0.1)
    across, down = dice.whole(4, 8), dice.whole(3, 5)
    gap = stage.metres(dice.uniform(0.7, 1.4) * stage.view.width / across, depth)
    size = (gap * dice.uniform(0.2, 0.4), gap * dice.uniform(0.2, 0.45), gap * 0.15)
    wall, paint = stage.papered(depth), stage.painted(depth)
    middle = (0.0, 0.0, depth)
    found = [Thing("rectangle", middle, (3 * across * gap, 2 * down * gap, 1.0), turn, wall)]
    for column in range(across):
        for row in range(down):
            step = (gap * (column - across / 2), gap * (row - down / 2), 0.0)
            where = _moved(middle, turn, step)
            if where[2] > 0.8 * NEAR_M:
                found.append(Thing("box", where, size, turn, paint))
    return found


def steps(stage: Stage) -> list[Thing]:
    """Return a flight of equal steps."""
    dice = stage.dice
    depth = stage.depth(0.5, 0.9)
    turn = rotation_about(Y, dice.uniform(-0.9, 0.9)) @ dice.rotation(0.15)
    rise = stage.metres(dice.uniform(0.06, 0.14) * stage.view.height, depth)
    tread, broad = rise * dice.uniform(1.2, 2.5), stage.metres(0.6 * stage.view.width, depth)
    paint = stage.painted(depth)
    foot = (0.0, stage.metres(0.4 * stage.view.height, depth), depth)
    return [
        Thing(
            "box",
            _moved(foot, turn, (0.0, -rise * number, tread * number)),
            (broad, rise / 2, tread),
            turn,
            paint,
        )
        for number in range(dice.whole(5, 12))
    ]
