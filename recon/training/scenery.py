"""Random scenes of many kinds, and the cameras that look at them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import torch

from recon.training.casting import Camera, first_hits, windows
from recon.training.composition import (
    Coat,
    Light,
    Scene,
    Thing,
    View,
    assemble,
    rotation_about,
)
from recon.training.furnishing import (
    backdrop,
    cutouts,
    foliage,
    relief_sheets,
    rod,
    room,
    sheets,
    sky,
    solids,
    tree,
)
from recon.training.profiles import hills
from recon.training.recipe import FULL, Recipe
from recon.training.staging import NEAR_M, Dice, Stage
from recon.training.streets import street
from recon.training.structures import columns, facade, fence, grid, steps, wires
from recon.training.textures import noise_table

__all__ = ["KINDS_OF_SCENE", "compose", "with_baseline"]

MOST_WITH_SHADOW = 130
SHARES = {"landscape": (0.03, 0.1), "close_up": (0.1, 0.25), "street": (0.03, 0.15)}
WIDE, NARROW = (0.03, 0.25), (0.08, 0.12)
LARGEST_SHARE = 0.3
FAR = {
    "landscape": (1 / 150, 1 / 15),
    "close_up": (1 / 12, 1 / 1.5),
    "sheets": (1 / 8, 1 / 1.3),
    "street": (1 / 100, 1 / 25),
    "bare_room": (1 / 8, 1 / 2),
    "white_room": (1 / 8, 1 / 2),
}
FAR_ELSEWHERE = (1 / 20, 1 / 1.5)
PROBE_WIDTH = 80
X, Y, _ = torch.eye(3)
FLAT = rotation_about(X, math.pi / 2)
EARTHY = ("earth", "earth", "earth", "checks")


def _furnished_room(stage: Stage) -> list[Thing]:
    return room(stage) + solids(stage, stage.dice.whole(8, 25))


def _clutter(stage: Stage) -> list[Thing]:
    found = backdrop(stage) + solids(stage, stage.dice.whole(12, 40))
    return found + cutouts(stage, stage.dice.whole(0, 4))


def _dense(stage: Stage) -> list[Thing]:
    """Many things that float at all depths: nearly every pixel is near an edge."""
    found = backdrop(stage) + solids(stage, stage.dice.whole(50, 100), (0.015, 0.12))
    return found + cutouts(stage, stage.dice.whole(2, 8))


def _garden(stage: Stage) -> list[Thing]:
    dice = stage.dice
    ground = _ground(stage) if dice.chance(0.5) else backdrop(stage)
    leaves = foliage(stage, dice.whole(1, 3), dice.whole(25, 60))
    return ground + leaves + solids(stage, dice.whole(2, 8))


def _fenced(stage: Stage) -> list[Thing]:
    first = room(stage) if stage.dice.chance(0.5) else backdrop(stage)
    return first + fence(stage) + solids(stage, stage.dice.whole(2, 10))


def _lattice(stage: Stage) -> list[Thing]:
    """Grids and wires, and what is seen through them."""
    dice = stage.dice
    behind = room(stage) if dice.chance(0.4) else backdrop(stage)
    behind += solids(stage, dice.whole(3, 12), depths=(0.05, 0.6))
    choice = dice.whole(0, 2)
    if choice == 0:
        return behind + grid(stage)
    if choice == 1:
        return behind + wires(stage, dice.whole(2, 6)) + fence(stage)
    return behind + cutouts(stage, dice.whole(2, 5)) + wires(stage, dice.whole(1, 3))


def _sheets(stage: Stage) -> list[Thing]:
    dice = stage.dice
    found = backdrop(stage) + sheets(stage) + solids(stage, dice.whole(0, 5))
    return found + cutouts(stage, dice.whole(0, 3))


def _ground(stage: Stage) -> list[Thing]:
    """Return a ground to the horizon and the sky; often with hills."""
    dice = stage.dice
    height = NEAR_M * dice.uniform(1.0, 2.5) * 0.5 * stage.view.height / stage.view.focal_px
    far = 2 * NEAR_M / stage.far
    tilt = dice.rotation(0.06)
    at = (0.0, height, 0.0)
    ground = Thing("rectangle", at, (far, far, 1.0), tilt @ FLAT, _earth(stage, 4 * NEAR_M))
    if not (stage.recipe.reliefs and dice.chance(0.6)):
        return [ground, sky(stage)]
    rise = height * dice.uniform(0.5, 3)
    there = (0.0, height + 0.7 * rise, far / 2)
    coat = _earth(stage, far / 4)
    rolling = Thing("relief", there, (far, far, rise), tilt @ FLAT, coat, hills(dice, 9))
    return [ground, rolling, sky(stage)]


def _earth(stage: Stage, depth: float) -> Coat:
    """Return paint for a ground, mostly one that has detail at every distance."""
    return replace(stage.papered(depth, EARTHY), gloss=0.0)


def _landscape(stage: Stage) -> list[Thing]:
    """Trees, posts, rocks and houses on a ground that goes far."""
    dice = stage.dice
    things = _ground(stage)
    height = things[0].centre[1]
    bark, crown, wall = (stage.painted(stage.depth(0.1, 0.5)) for _ in range(3))
    for _ in range(dice.whole(8, 30)):
        depth = stage.depth(0.02, dice.uniform(0.15, 0.7))
        x = stage.place(depth, 0.7)[0]
        size = height * dice.log_uniform(0.15, 1.6)
        foot = (x, height, depth)
        choice = dice.whole(0, 3)
        if choice == 0:
            things += tree(stage, foot, size, bark, crown)
        elif choice == 1:
            thick = stage.metres(dice.log_uniform(0.8, 5), depth)
            things.append(rod(foot, (x, height - 1.5 * size, depth), thick, bark))
        elif choice == 2:
            half = (size * 0.6, size * 0.35, size * 0.5)
            things.append(Thing("ellipsoid", foot, half, dice.rotation(0.5), crown))
        else:
            half = (size * dice.uniform(0.4, 1.5), size * 0.8, size * dice.uniform(0.4, 1.5))
            turn = rotation_about(Y, dice.uniform(-1.5, 1.5))
            things.append(Thing("box", foot, half, turn, wall))
    return things


def _close_up(stage: Stage) -> list[Thing]:
    """Few large things right before the cameras."""
    dice = stage.dice
    found = backdrop(stage, 0.0, 0.3) + solids(stage, dice.whole(1, 4), (0.2, 0.5), (0.5, 1.0))
    return found + relief_sheets(stage, dice.whole(0, 2)) + solids(stage, dice.whole(0, 4))


def _colonnade(stage: Stage) -> list[Thing]:
    """Columns, windows or steps, all alike."""
    dice = stage.dice
    alike = (columns, facade, steps)[dice.whole(0, 2)](stage)
    around = room(stage) if dice.chance(0.6) else _ground(stage)
    return around + alike + solids(stage, dice.whole(0, 8))


def _relief(stage: Stage) -> list[Thing]:
    """Uneven surfaces behind and before each other."""
    dice = stage.dice
    found = backdrop(stage) + relief_sheets(stage, dice.whole(2, 5))
    return found + solids(stage, dice.whole(1, 8))


def _bare_room(stage: Stage) -> list[Thing]:
    """Painted walls and furniture: most of the view has no texture to speak of."""
    bare = replace(stage, weak_walls=0.7, weak_things=0.5)
    dice = stage.dice
    furniture = [
        replace(thing, rotation=dice.rotation(0.15) @ rotation_about(Y, dice.uniform(-1.5, 1.5)))
        for thing in solids(bare, dice.whole(3, 9), (0.06, 0.35), (0.1, 0.9))
    ]
    return room(bare) + furniture + solids(stage, dice.whole(1, 8), (0.02, 0.1))


def _white_room(stage: Stage) -> list[Thing]:
    """The same with white walls and what hangs there: nothing else tells them from a bright sky."""
    things = _bare_room(stage)
    walls = [thing for thing in things if thing.kind == "rectangle"]
    painted = [
        replace(thing, coat=_white(thing.coat, stage.dice))
        if thing.kind == "rectangle" and stage.dice.chance(0.8)
        else thing
        for thing in things
    ]
    hung = [_hung(wall, stage) for wall in walls for _ in range(stage.dice.whole(0, 3))]
    return painted + [picture for picture in hung if picture is not None]


def _hung(wall: Thing, stage: Stage) -> Thing | None:
    """Return a picture on a wall where a random pixel looks at it; None where that is not ahead."""
    normal = wall.rotation[:, 2]
    towards = torch.tensor(stage.place(1.0))
    depth = float(torch.tensor(wall.centre) @ normal / (towards @ normal))
    if not NEAR_M < depth < NEAR_M / stage.far:
        return None
    x, y, z = (0.995 * depth * towards).tolist()  # before the wall
    half = [stage.metres(stage.dice.uniform(0.02, 0.12) * stage.view.width, z) for _ in range(2)]
    size = half[0], half[1], 1.0
    return Thing("rectangle", (x, y, z), size, wall.rotation, stage.painted(z))


def _white(coat: Coat, dice: Dice) -> Coat:
    """Return white paint, even but for a faint grain."""
    white = 0.7 + 0.25 * torch.rand((), generator=dice.generator)
    colours = white + 0.04 * torch.randn(2, 3, generator=dice.generator)
    return Coat("noise", colours.clamp(0.03, 0.97), coat.frequency, grain=0.3, offset=coat.offset)


KINDS_OF_SCENE: dict[str, Callable[[Stage], list[Thing]]] = {
    "room": _furnished_room,
    "clutter": _clutter,
    "dense": _dense,
    "garden": _garden,
    "fence": _fenced,
    "lattice": _lattice,
    "sheets": _sheets,
    "landscape": _landscape,
    "close_up": _close_up,
    "colonnade": _colonnade,
    "relief": _relief,
    "street": street,
    "bare_room": _bare_room,
    "white_room": _white_room,
}


def _sharing(things: list[Thing], dice: Dice) -> list[Thing]:
    """Give some things the paint of others, at the same size in the image."""
    if not dice.chance(0.4):
        return things
    few = things[: dice.whole(1, 4)]  # the first are what is behind
    found = []
    for thing in things:
        model = few[dice.whole(0, len(few) - 1)]
        scale = max(0.1, model.centre[2]) / max(0.1, thing.centre[2])
        offset = (dice.uniform(0, 500), dice.uniform(0, 500))
        coat = replace(model.coat, frequency=model.coat.frequency * scale, offset=offset)
        shares = thing.centre[2] > 0.1 and model.centre[2] > 0.1 and dice.chance(0.5)
        found.append(replace(thing, coat=coat) if shares else thing)
    return found


def _lights(dice: Dice, count: int) -> Light:
    """Return random light for a scene of `count` things."""
    towards = torch.tensor([dice.uniform(-0.7, 0.7), -1.0, dice.uniform(-1.2, 0.2)])
    return Light(
        towards / towards.norm(),
        casts_shadows=count < MOST_WITH_SHADOW and dice.chance(0.5),
        spread=max(0.0, dice.uniform(-0.1, 0.2)),
        ambient=dice.uniform(0.2, 0.7),
        sharpness=dice.log_uniform(8, 80),
        lamp=(dice.uniform(-1, 1), dice.uniform(-1, 0.5), dice.uniform(0, 2)),
        lamp_strength=max(0.0, dice.uniform(-0.7, 0.7)),
        lamp_reach_m=dice.log_uniform(0.5, 3),
    )


def _unlit(things: list[Thing]) -> list[Thing]:
    return [replace(thing, coat=replace(thing.coat, gloss=0.0)) for thing in things]


def with_baseline(view: View, scene: Scene, share: float) -> View:
    """Choose the baseline by the 99th percentile of the disparities in the left view.

    The left view is the same for every baseline, so a coarse look at it tells.

    Args:
        view: with any baseline.
        scene: what it shows.
        share: of the width that the percentile shall be; less if the nearest point would else
            exceed `LARGEST_SHARE`.
    """
    scale = PROBE_WIDTH / view.width
    camera = Camera(PROBE_WIDTH, max(8, round(view.height * scale)), view.focal_px * scale)
    rays = camera.rays([(0.0, 0.0)], scene.table.device)
    near = windows(scene.shapes.corners(), camera)
    inverse = 1 / first_hits(scene.shapes, rays, near).depth.flatten()
    typical = float(torch.quantile(inverse, 0.99)) * view.focal_px
    most = float(inverse.amax()) * view.focal_px
    return replace(view, baseline_m=view.width * min(share / typical, LARGEST_SHARE / most))


def compose(
    generator: torch.Generator, size: tuple[int, int], recipe: Recipe = FULL
) -> tuple[Scene, View]:
    """Return a random scene and the cameras that look at it.

    Args:
        generator: source of all randomness; the scene lies on its device.
        size: (width, height) of the images in pixels.
        recipe: what scenes may be made of.
    """
    device = generator.device
    seed = int(torch.randint(2**62, (), generator=generator, device=device))
    dice = Dice(torch.Generator().manual_seed(seed))
    kind = dice.one_of(recipe.kinds)
    width, height = size
    view = View(width, height, width * dice.log_uniform(0.6, 2.5), 1.0)
    stage = Stage(dice, view, recipe, dice.log_uniform(*FAR.get(kind, FAR_ELSEWHERE)))
    share = dice.log_uniform(*(SHARES.get(kind, WIDE) if recipe.wide_baselines else NARROW))
    things = KINDS_OF_SCENE[kind](stage)
    things = _sharing(things, dice) if recipe.shared_textures else things
    light = _lights(dice, len(things))
    if not recipe.light:
        things, light = _unlit(things), Light(light.towards, ambient=1.0)
    scene = assemble(
        things,
        noise_table(dice.generator).to(device),
        light.towards,
        shadows=light.casts_shadows,
    )
    scene = replace(scene, light=replace(light, towards=scene.light.towards))
    return scene, with_baseline(view, scene, share)
