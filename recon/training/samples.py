"""The still lifes in data/, furnished by hand: `python -m recon.training.samples` draws them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from calib import RectifiedGeometry, write_calibration
from calib.formats import CalibrationRecord
from recon.files import write_image
from recon.training.composition import (
    Coat,
    Place,
    Scene,
    Thing,
    View,
    assemble,
    rotation_about,
    turned,
)
from recon.training.scenes import StereoSample, render
from recon.training.textures import noise_table

__all__ = ["STILL_LIFES", "draw_still_life", "main", "still_life_scene"]

X, Y, Z = torch.eye(3)
LEVEL = torch.eye(3)
UPRIGHT = FLAT = rotation_about(X, math.pi / 2)
EYE_HEIGHT_M = 1.25
PITCH = math.radians(14)
CANDIDATES = 96
VIEW = View(width=720, height=540, focal_px=760.0, baseline_m=0.14)


def _tones(first: str, second: str) -> Tensor:
    """Return two linear colours from their display values, written as hexadecimal RGB."""
    display = [[int(text[i : i + 2], 16) / 255 for i in (0, 2, 4)] for text in (first, second)]
    return torch.tensor(display) ** 2.2


def _coat(style: str, first: str, second: str, frequency: float, **more: float) -> Coat:
    """Return paint between two display colours, hexadecimal RGB, `frequency` patterns a metre."""
    return Coat(style, _tones(first, second), frequency, **{"grain": 0.25, **more})  # type: ignore[arg-type]


def _thing(kind: str, at: Place, half: Place, coat: Coat, rotation: Tensor = LEVEL) -> Thing:
    """Return a thing at (right, above the floor, ahead) metres of the point below the camera."""
    offset = (37 * at[0] + 11 * at[2], 53 * at[1] + 7 * at[0])
    where = (at[0], EYE_HEIGHT_M - at[1], at[2])
    return Thing(kind, where, half, rotation, replace(coat, offset=offset))


def _shell(floor: Coat, wall: Coat, depth: float) -> list[Thing]:
    """Return the floor, the back wall and a side wall like it."""
    return [
        _thing("rectangle", (0, 0, 3), (6, 6, 1), floor, FLAT),
        _thing("rectangle", (0, 1, depth), (6, 4, 1), wall),
        _thing("rectangle", (-2.4, 1, 3), (6, 4, 1), wall, rotation_about(Y, math.pi / 2)),
    ]


def _plant(x: float, z: float, pot: Coat, leaves: int) -> list[Thing]:
    """Return a pot with stalks and a cloud of leaves, at `x` to the right and `z` ahead, metres."""
    stalk = _coat("noise", "3d4a22", "5c6b33", 30)
    things = [_thing("cylinder", (x, 0.17, z), (0.15, 0.15, 0.17), pot, UPRIGHT)]
    for step in range(-2, 3):
        turn = rotation_about(Z, 0.12 * step) @ UPRIGHT
        at = (x + 0.03 * step, 0.55, z)
        things.append(_thing("cylinder", at, (0.008, 0.008, 0.3), stalk, turn))
    dice = np.random.default_rng(5)
    for _ in range(leaves):
        lean, around, height = dice.uniform(0, 0.3), dice.uniform(0, 6.3), dice.uniform(0.4, 1.05)
        at = (x + lean * math.cos(around), height, z + lean * math.sin(around))
        turn = rotation_about(Y, around) @ rotation_about(Z, dice.uniform(-0.9, 0.9))
        turn = turn @ rotation_about(X, dice.uniform(0.3, 2.8))
        tones = ("2f5d2a", "7fae4e") if dice.uniform() < 0.7 else ("466b1f", "b3c263")
        leaf = _coat("noise", *tones, 30, gloss=0.15, slope=0.4)
        things.append(_thing("disc", at, (dice.uniform(0.05, 0.1), 0.025, 1.0), leaf, turn))
    return things


def _crate(x: float, z: float, angle: float) -> list[Thing]:
    """Return a crate of slats, turned about the vertical."""
    wood = _coat("wood", "9a6b3f", "caa06b", 8, slope=0.4)
    things = []
    for side in range(4):
        facing = rotation_about(Y, angle + side * math.pi / 2)
        right, _, ahead = (facing @ torch.tensor([0.0, 0.0, 0.24])).tolist()
        for row in range(3):
            at = (x + right, 0.09 + 0.15 * row, z + ahead)
            things.append(_thing("box", at, (0.25, 0.05, 0.012), wood, facing))
    return things


def _workshop() -> list[Thing]:
    """A crate, boxes, a ball, a lamp and a plant in front of a brick wall."""
    boards = _coat("wood", "6e5138", "b08a5e", 3, slope=0.45)
    bricks = _coat("brick", "cfc6b8", "9a4f3a", 2.6, slope=0.3, grain=0.5)
    rug = _coat("cells", "28435c", "c9b48a", 14)
    carton = _coat("glyphs", "b98d5a", "d9b683", 4)
    stone = _coat("noise", "7c8a94", "c8d0d4", 6, slope=0.35)
    ball = _coat("spots", "d8d2c2", "b0392e", 9, gloss=0.25)
    tin = _coat("stripes", "254e3e", "d9c77a", 12, gloss=0.3)
    steel = _coat("noise", "3a3a3a", "6a6a6a", 20)
    shade = _coat("gradient", "d7a14c", "f0d79a", 8, grain=0.5)
    board = _coat("checks", "30343c", "b9bcc4", 7, grain=0.4)
    clay = _coat("noise", "8a4b32", "b06a4a", 9, slope=0.5)
    leaning = rotation_about(X, 0.28) @ rotation_about(Y, -0.25)
    return [
        *_shell(boards, bricks, 4.3),
        _thing("disc", (0.1, 0.004, 2.6), (1.0, 0.7, 1), rug, FLAT),
        *_crate(-0.75, 2.7, 0.5),
        _thing("box", (0.62, 0.2, 3.2), (0.32, 0.2, 0.24), carton, rotation_about(Y, 0.4)),
        _thing("box", (0.55, 0.53, 3.15), (0.22, 0.13, 0.2), stone, rotation_about(Y, -0.3)),
        _thing("ellipsoid", (-0.12, 0.2, 2.35), (0.2, 0.2, 0.2), ball, rotation_about(X, 0.5)),
        _thing("cylinder", (0.3, 0.14, 2.15), (0.09, 0.09, 0.14), tin, UPRIGHT),
        _thing("cylinder", (-0.42, 0.75, 3.6), (0.018, 0.018, 0.75), steel, UPRIGHT),
        _thing("ellipsoid", (-0.42, 1.55, 3.6), (0.24, 0.17, 0.24), shade),
        _thing("rectangle", (1.05, 0.55, 3.75), (0.35, 0.55, 1), board, leaning),
        *_plant(1.0, 2.55, clay, 70),
    ]


def _reading_corner() -> list[Thing]:
    """Stacked books, cushions, a stool and a vase in front of papered walls."""
    tiles = _coat("checks", "6c6a64", "a7a297", 2.2, grain=0.6)
    paper = _coat("spots", "8fa39a", "5d7a72", 5, slope=0.4, grain=0.4)
    wood = _coat("wood", "5a3d26", "a87a4c", 6)
    china = _coat("stripes", "23466b", "d8dce2", 14, gloss=0.35)
    cushion = _coat("cells", "7b2f3a", "d4a09a", 16)
    moss = _coat("noise", "4e5a3a", "8f9b6a", 8, slope=0.2)
    painting = _coat("noise", "3a3028", "d8b88a", 4, slope=0.6)
    marble = _coat("noise", "c9c2b2", "8f8878", 9, slope=0.5)
    things = _shell(tiles, paper, 4.0)
    for number, cover in enumerate(["a23b2a", "2c4a6e", "3f6b3f", "c7a23c", "5b3a5e", "8a8f98"]):
        at = (-0.5 + 0.02 * (number % 3), 0.06 + 0.085 * number, 2.6)
        angle = 0.35 * math.sin(2.1 * number)
        book = _coat("glyphs", cover, "e8e0cc", 10)
        things.append(_thing("box", at, (0.2, 0.04, 0.15), book, rotation_about(Y, angle)))
    for x in (0.35, 0.75):
        for z in (2.75, 3.15):
            things.append(_thing("cylinder", (x, 0.25, z), (0.02, 0.02, 0.25), wood, UPRIGHT))
    return [
        *things,
        _thing("cylinder", (0.55, 0.53, 2.95), (0.3, 0.3, 0.03), wood, UPRIGHT),
        _thing("ellipsoid", (0.5, 0.72, 2.95), (0.12, 0.17, 0.12), china),
        _thing("cylinder", (0.5, 0.92, 2.95), (0.05, 0.05, 0.08), china, UPRIGHT),
        _thing(
            "ellipsoid", (-0.05, 0.14, 2.25), (0.28, 0.13, 0.24), cushion, rotation_about(Z, 0.15)
        ),
        _thing("ellipsoid", (-1.15, 0.4, 3.5), (0.4, 0.38, 0.35), moss),
        _thing("box", (1.2, 0.85, 3.85), (0.45, 0.6, 0.02), painting),
        *_plant(-0.75, 3.35, marble, 60),
    ]


STILL_LIFES: dict[str, Callable[[], list[Thing]]] = {
    "workshop": _workshop,
    "reading_corner": _reading_corner,
}


def draw_still_life(name: str, *, samples: int = 3) -> StereoSample:
    """Draw one of `STILL_LIFES`.

    Args:
        name: of the table.
        samples: see `render`.
    """
    return render(still_life_scene(name), VIEW, samples=samples)


def still_life_scene(name: str) -> Scene:
    """Return one of `STILL_LIFES` as a scene, in the frame of its left camera."""
    pitch = rotation_about(X, PITCH)
    things = [
        replace(thing, centre=turned(pitch, thing.centre), rotation=pitch @ thing.rotation)
        for thing in STILL_LIFES[name]()
    ]
    to_light = pitch @ torch.tensor([0.45, -1.0, -0.55])
    table = noise_table(torch.Generator().manual_seed(1))
    return assemble(things, table, to_light / to_light.norm(), shadows=True)


def _write(folder: Path, sample: StereoSample) -> None:
    """Write a pair, its calibration and its truth."""
    folder.mkdir(parents=True, exist_ok=True)
    noise = torch.Generator().manual_seed(2)
    for side, image in (("left", sample.left), ("right", sample.right)):
        sensor = image + 0.006 * torch.randn(image.shape, generator=noise)
        write_image(folder / f"{side}.png", (sensor.clamp(0, 1) * 255).round().byte().numpy())
    truth = (sample.disparity_left * 256).round().numpy().astype(np.uint16)
    write_image(folder / "disparity_truth.png", truth)
    write_image(folder / "visible.png", 255 * sample.visible.numpy().astype(np.uint8))
    geometry = RectifiedGeometry(
        (VIEW.width, VIEW.height), VIEW.focal_px, VIEW.centre, VIEW.centre, VIEW.baseline_m
    )
    record = CalibrationRecord(
        None, geometry, folder / "rig.json", "json", disparities=range(CANDIDATES)
    )
    write_calibration(folder / "rig.json", record)


def main(out: Path = Path("data")) -> None:
    """Draw every still life into a folder of its own."""
    for name in STILL_LIFES:
        _write(out / name, draw_still_life(name))


if __name__ == "__main__":
    main()
