"""Draw the clouds and the meshes of known pairs from the side, one preset beside another.

python benchmarks/side_views.py [--datasets DIR] [--out docs] [--presets paper best]

Looks from the left, above and behind, without perspective: what hangs behind an edge, or stands
on a slanted plane as stairs, is seen from there and not from where the photographs were taken.
Writes side_SCENE.jpg: the cloud above the mesh (mesh.glb with its texture), a column a preset, all
in the same frame. Pictures are of the presets as they are; nothing is filtered for them.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import cv2
import numpy as np
from sequence import Caster

from recon import Reconstruction, reconstruct
from recon.evaluation.layouts import find_scenes, read_scene
from recon.settings import load_preset
from recon.types import Array, Mesh, PointCloud

SCENES = {
    "motorcycle": ("middlebury-v3/Q", "Motorcycle"),
    "jadeplant": ("middlebury-v3/Q", "Jadeplant"),
    "vintage": ("middlebury-v3/Q", "Vintage"),
    "kitti": ("kitti/2015", "000002_10"),
}
SIZE = (700, 460)
TURN, TILT = np.radians(50), np.radians(18)
AHEAD = np.array([np.sin(TURN) * np.cos(TILT), np.sin(TILT), np.cos(TURN) * np.cos(TILT)])
UP = [0.0, -1.0, 0.0]
FARTHEST = 1.5
"""In medians of the depth: what is farther is drawn, but does not make the frame wider."""
OUTER_PERCENT = 0.5
MARGIN = 1.04
MOST_BYTES = 195_000
CAPTION = 26
NOTHING = (214, 224, 236)
"""Colour of where nothing is; photographs have white in them."""


class Frame:
    """What the pictures of one scene show: a middle, and how many metres are across."""

    def __init__(self, cloud: PointCloud, size: tuple[int, int] = SIZE) -> None:
        """Choose a frame around the points that are not far away, for pictures of a size."""
        self.size = size
        near = cloud.points[cloud.points[:, 2] <= FARTHEST * np.median(cloud.points[:, 2])]
        across = np.cross(AHEAD, UP)
        across /= np.linalg.norm(across)
        self.axes = np.stack([across, np.cross(AHEAD, across), AHEAD])
        seen = near @ self.axes.T
        low, high = np.percentile(seen, [OUTER_PERCENT, 100 - OUTER_PERCENT], axis=0)
        self.middle = (low + high) / 2 @ self.axes
        width, height = (high - low)[:2]
        self.wide_m = MARGIN * max(width, height * size[0] / size[1])

    def of_cloud(self, cloud: PointCloud) -> Array:
        """Return (H, W, 3) uint8, every point a square of 2 x 2 pixels, nearer ones in front."""
        seen = (cloud.points - self.middle) @ self.axes.T
        order = np.argsort(-seen[:, 2])
        scale = self.size[0] / self.wide_m
        column, row = (scale * seen[order, :2] + np.array(self.size) / 2).astype(int).T
        picture = np.full((self.size[1], self.size[0], 3), NOTHING, np.uint8)
        for down, right in ((0, 0), (0, 1), (1, 0), (1, 1)):
            x, y = column + right, row + down
            inside = (x >= 0) & (y >= 0) & (x < self.size[0]) & (y < self.size[1])
            picture[y[inside], x[inside]] = cloud.colours[order][inside]
        return picture

    def of_mesh(self, mesh: Mesh) -> Array:
        """Return (H, W, 3) uint8 of a mesh with its texture, lit from the eye."""
        caster = Caster(mesh.vertices, mesh.faces, mesh.uv, mesh.texture)
        return caster.picture(self.middle, AHEAD, UP, self.wide_m, self.size, NOTHING)


def drawn(results: dict[str, Reconstruction]) -> Array:
    """Return clouds above meshes, a column a preset, in the frame of the last one."""
    frame = Frame(list(results.values())[-1].cloud)
    columns = []
    for name, result in results.items():
        rows = []
        for what, picture in (
            ("cloud", frame.of_cloud(result.cloud)),
            ("mesh", frame.of_mesh(result.mesh)),
        ):
            at = (8, CAPTION - 8)
            words = f"{what}, {name}"
            cv2.putText(
                picture, words, at, cv2.FONT_HERSHEY_SIMPLEX, 0.6, (0, 0, 0), 1, cv2.LINE_AA
            )
            rows.append(picture)
        columns.append(np.concatenate(rows, axis=0))
    return np.concatenate(columns, axis=1)


def write_small(path: Path, picture: Array) -> None:
    """Write a JPEG of the best quality that is small enough."""
    for quality in range(88, 20, -6):
        _, jpeg = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
        if len(jpeg) <= MOST_BYTES:
            break
    path.write_bytes(jpeg.tobytes())
    print(f"{path}: {len(jpeg):,} bytes, quality {quality}")


def reconstructed(datasets: Path, scene: tuple[str, str], preset: str) -> Reconstruction:
    """Return what a preset makes of a scene."""
    folder, name = scene
    (files,) = (files for files in find_scenes(datasets / folder) if files.name == name)
    known = read_scene(files)
    return reconstruct(known.pair, load_preset(preset), disparities=known.disparities)


def main() -> None:
    """Draw every scene."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--datasets", type=Path, default=os.environ.get("RECON_DATASETS"))
    parser.add_argument("--out", type=Path, default=Path(__file__).parent.parent / "docs")
    parser.add_argument("--presets", nargs="+", default=["paper", "best"])
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    options = parser.parse_args()
    if options.datasets is None:
        parser.error("give --datasets, or set RECON_DATASETS")
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.scenes:
        results = {
            preset: reconstructed(Path(options.datasets), SCENES[name], preset)
            for preset in options.presets
        }
        write_small(options.out / f"side_{name}.jpg", drawn(results))


if __name__ == "__main__":
    main()
