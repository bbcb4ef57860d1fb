"""Walls, solids, leaves and reliefs to put into a scene.

Everything is placed by inverse depth and by its size in pixels, so that every baseline and every
focal length gives a full image.
"""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from recon.training.composition import Coat, Place, Thing, rotation_about, turned
from recon.training.profiles import CUTOUTS, RELIEFS
from recon.training.shapes import ANALYTIC
from recon.training.staging import NEAR_M, Stage

__all__ = [
    "aimed",
    "backdrop",
    "cutouts",
    "foliage",
    "relief_sheets",
    "rod",
    "room",
    "sheets",
    "sky",
    "solids",
    "tree",
]

X, Y, Z = torch.eye(3)
POLE_SHARE = 0.15
GRASS = ("noise", "gradient", "stripes", "wood", "earth")


def aimed(along: Place) -> Tensor:
    """Return a rotation (3, 3) that carries the own z axis to the direction `along`."""
    z = torch.nn.functional.normalize(torch.tensor(along), dim=0)
    helper = X if abs(float(z[0])) < 0.7 else Y
    x = torch.nn.functional.normalize(torch.linalg.cross(helper, z), dim=0)
    return torch.stack((x, torch.linalg.cross(z, x), z), 1)


def rod(start: Place, end: Place, radius: float, coat: Coat) -> Thing:
    """Return a thin cylinder from `start` to `end`."""
    along = (end[0] - start[0], end[1] - start[1], end[2] - start[2])
    middle = (start[0] + along[0] / 2, start[1] + along[1] / 2, start[2] + along[2] / 2)
    return Thing("cylinder", middle, (radius, radius, math.hypot(*along) / 2), aimed(along), coat)


def _sheet(stage: Stage, depth: float, rotation: Tensor, half_px: float) -> Thing:
    """Return a large rectangle at `depth`, straight ahead."""
    half = stage.metres(half_px, depth)
    return Thing("rectangle", (0, 0, depth), (half, half, 1), rotation, stage.papered(depth))


def backdrop(stage: Stage, low: float = 0.0, high: float = 0.15) -> list[Thing]:
    """Return a wall at the back, slanted a little; often a relief."""
    depth = stage.depth(low, high)
    wall = _sheet(stage, depth, stage.dice.rotation(0.5), 4 * stage.view.width)
    if stage.recipe.reliefs and stage.dice.chance(0.25):
        return [replace(wall, centre=(0, 0, 1.5 * depth)), _relief(stage, depth, 1.2, 0.6)]
    return [wall]


def sky(stage: Stage) -> Thing:
    """Return clouds far behind everything."""
    depth = 3 * NEAR_M / stage.far
    half = stage.metres(2 * stage.view.width, depth)
    coat = replace(stage.papered(depth, ("noise", "earth")), gloss=0.0)
    return Thing("rectangle", (0, 0, depth), (half, half, 1), torch.eye(3), coat)


def room(stage: Stage) -> list[Thing]:
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
    kept = [wall for wall in walls if wall[0][1] > 0 or wall[0][2] > 0 or dice.chance(0.6)]
    return [
        Thing(
            "rectangle",
            turned(tilt, centre),
            (3 * back, 3 * back, 1.0),
            tilt @ turn,
            stage.papered(stage.depth(0, 0.5)),
        )
        for centre, turn in kept
    ] + [_sheet(stage, 1.6 * back, torch.eye(3), 6 * stage.view.width)]


def solids(
    stage: Stage,
    count: int,
    sizes: tuple[float, float] = (0.03, 0.3),
    depths: tuple[float, float] = (0.05, 1.0),
) -> list[Thing]:
    """Return separate things of all shapes, turned anyhow.

    Args:
        stage: where to.
        count: how many.
        sizes: least and most of half the extent, as a share of the width of the image.
        depths: see `Stage.depth`.
    """
    dice, things = stage.dice, []
    for _ in range(count):
        depth = stage.depth(*depths)
        half = stage.metres(dice.log_uniform(*sizes) * stage.view.width, depth)
        half = min(half, 0.7 * depth)  # or it would reach the camera
        width, height, length = (half * dice.log_uniform(0.3, 1.0) for _ in range(3))
        if dice.chance(POLE_SHARE):
            width = height = stage.metres(dice.log_uniform(0.8, 4), depth)
            length = 2 * half
        kind = dice.one_of(tuple(ANALYTIC))
        size = (width, height, length)
        things.append(Thing(kind, stage.place(depth), size, dice.rotation(), stage.painted(depth)))
    return things


def _relief(stage: Stage, depth: float, half_share: float, most_tilt: float) -> Thing:
    """Return a relief at `depth`, straight ahead.

    Args:
        stage: where to.
        depth: metres.
        half_share: half its extent, as a share of the width of the image.
        most_tilt: radians.
    """
    dice = stage.dice
    half = stage.metres(half_share * stage.view.width, depth)
    lift = half * dice.log_uniform(0.03, 0.25)
    turn = dice.rotation(most_tilt) @ rotation_about(Z, dice.uniform(0, 2 * math.pi))
    heights = RELIEFS[dice.one_of(tuple(RELIEFS))](dice)
    return Thing("relief", (0, 0, depth), (half, half, lift), turn, stage.papered(depth), heights)


def relief_sheets(stage: Stage, count: int) -> list[Thing]:
    """Return uneven sheets in front of each other; none where the recipe has no reliefs."""
    dice, things = stage.dice, []
    for _ in range(count if stage.recipe.reliefs else 0):
        depth = stage.depth(0.1, 0.8)
        relief = _relief(stage, depth, dice.uniform(0.15, 0.45), 1.0)
        things.append(replace(relief, centre=stage.place(depth, 0.45)))
    return things


def cutouts(stage: Stage, count: int) -> list[Thing]:
    """Return sheets with ragged outlines, with holes, or of bars."""
    dice, things = stage.dice, []
    kinds = tuple(CUTOUTS) if stage.recipe.repeated_structures else ("torn", "blot")
    for _ in range(count):
        depth = stage.depth(0.15, 0.95)
        half = stage.metres(dice.log_uniform(0.06, 0.35) * stage.view.width, depth)
        size = (half, half * dice.uniform(0.5, 1), 1.0)
        turn = dice.rotation(0.9) @ rotation_about(Z, dice.uniform(0, 2 * math.pi))
        holes = CUTOUTS[dice.one_of(kinds)](dice)
        where = stage.place(depth, 0.45)
        things.append(Thing("cutout", where, size, turn, stage.painted(depth), holes))
    return things


def foliage(stage: Stage, clouds: int, leaves: int) -> list[Thing]:
    """Return clouds of small leaves; the leaves of a cloud share one paint."""
    dice, things = stage.dice, []
    for _ in range(clouds):
        depth = stage.depth(0.2)
        middle = stage.place(depth, 0.35)
        reach = stage.metres(dice.uniform(0.08, 0.25) * stage.view.width, depth)
        leaf = stage.metres(dice.log_uniform(4, 25), depth)
        slim = dice.uniform(0.15, 0.8)
        paint = stage.painted(depth, GRASS)
        for _ in range(leaves):
            x, y, z = (c + reach * dice.uniform(-1, 1) for c in middle)
            where = (x, y, max(z, 0.7 * NEAR_M))
            things.append(Thing("disc", where, (leaf, leaf * slim, 1.0), dice.rotation(), paint))
    return things


def sheets(stage: Stage) -> list[Thing]:
    """Return few, large, strongly slanted planes."""
    found = []
    for _ in range(stage.dice.whole(2, 6)):
        depth = stage.depth(0.1, 0.8)
        half_px = stage.dice.uniform(0.1, 0.4) * stage.view.width
        sheet = _sheet(stage, depth, stage.dice.rotation(1.1), half_px)
        found.append(replace(sheet, centre=stage.place(depth, 0.5)))
    return found


def tree(stage: Stage, foot: Place, size: float, bark: Coat, crown: Coat) -> list[Thing]:
    """Return a trunk and a crown of one to three ellipsoids."""
    x, y, z = foot
    dice = stage.dice
    things = [rod(foot, (x, y - 1.2 * size, z), 0.08 * size, bark)]
    for _ in range(dice.whole(1, 3)):
        at = (x + 0.3 * size * dice.uniform(-1, 1), y - size * dice.uniform(1.2, 1.8), z)
        half = size * dice.uniform(0.35, 0.7)
        things.append(Thing("ellipsoid", at, (half, 0.8 * half, half), dice.rotation(), crown))
    return things
