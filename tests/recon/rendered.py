"""A small still life, drawn for both cameras with exact truth, and put on disk."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import torch

from calib import RectifiedGeometry, write_calibration
from calib.formats import CalibrationRecord
from calib.pair import RectifiedPair
from recon.files import write_image
from recon.training.composition import Coat, Scene, Thing, View, assemble, rotation_about
from recon.training.scenes import StereoSample, render
from recon.training.textures import noise_table

VIEW = View(width=200, height=100, focal_px=160.0, baseline_m=0.2)
SEARCHED = range(28)
QUICK = """
description = "without a network"
[matching_cost]
method = "census"
[aggregation]
method = "box"
radius_px = 2
"""


@dataclass(frozen=True, eq=False)
class Rendered:
    """A pair and its truth: disparity (H, W) px, and which left pixels both cameras see."""

    pair: RectifiedPair
    disparity: np.ndarray
    visible: np.ndarray

    def shifted(self, left: int, right: int, width: int = 160) -> "Rendered":
        """Cut windows that begin at different columns: infinity moves to `right - left`."""
        geometry = self.pair.geometry
        cx, cy = geometry.centre_left
        moved = RectifiedGeometry(
            (width, geometry.size[1]),
            geometry.focal_px,
            (cx - left, cy),
            (cx - right, cy),
            geometry.baseline_m,
        )
        of_left, of_right = slice(left, left + width), slice(right, right + width)
        partner = np.arange(left, left + width) - self.disparity[:, of_left]
        return Rendered(
            RectifiedPair(
                self.pair.left[:, of_left].copy(), self.pair.right[:, of_right].copy(), moved
            ),
            self.disparity[:, of_left] + right - left,
            self.visible[:, of_left] & (partner >= right) & (partner < right + width),
        )


@cache
def still_life() -> Rendered:
    """A ball and a box before a slanted wall, 1.5 to 6 m away, with noise on everything."""
    sample = still_life_sample(2)
    left, right = ((255 * image).round().byte().numpy() for image in (sample.left, sample.right))
    geometry = RectifiedGeometry(
        (VIEW.width, VIEW.height), VIEW.focal_px, VIEW.centre, VIEW.centre, VIEW.baseline_m
    )
    return Rendered(
        RectifiedPair(left, right, geometry),
        sample.disparity_left.numpy(),
        sample.visible.numpy(),
    )


def still_life_sample(samples: int) -> StereoSample:
    """Draw the still life with `samples` x `samples` rays a pixel."""
    return render(still_life_scene(), VIEW, samples=samples)


def still_life_scene() -> Scene:
    """The still life, in the frame of its left camera."""
    axes = torch.eye(3)
    wall = rotation_about(axes[1], 0.35)
    box = rotation_about(axes[0], 0.5) @ rotation_about(axes[1], 0.6)
    things = [
        Thing("rectangle", (0, 0, 4.5), (20, 20, 1), wall, coat(5, (0.0, 0.0))),
        Thing("ellipsoid", (-0.45, 0.1, 2.2), (0.35, 0.3, 0.3), axes, coat(10, (90.0, 10.0))),
        Thing("box", (0.6, -0.1, 2.0), (0.25, 0.25, 0.25), box, coat(10, (200.0, 50.0))),
    ]
    table = noise_table(torch.Generator().manual_seed(3))
    light = torch.tensor([0.3, -1.0, -0.6])
    return assemble(things, table, light / light.norm(), shadows=True)


def coat(frequency, offset):
    colours = torch.tensor([[0.05, 0.1, 0.15], [0.9, 0.8, 0.6]])
    return Coat("noise", colours, frequency, slope=0.3, grain=0.3, offset=offset)


def on_disk(folder, pair, *, disparities=SEARCHED):
    """Write left.png, right.png, rig.json and quick.toml, and return the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    write_image(folder / "left.png", pair.left)
    write_image(folder / "right.png", pair.right)
    record = CalibrationRecord(None, pair.geometry, folder / "rig.json", "json", disparities)
    write_calibration(folder / "rig.json", record)
    (folder / "quick.toml").write_text(QUICK)
    return folder
