"""Draw docs/overview.png from a finished `make demo`: python docs/draw_overview.py out/demo."""

import sys
from pathlib import Path

import cv2
import numpy as np
import trimesh

from recon.files import read_ply
from recon.types import Mesh

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
from side_views import Frame

HEIGHT = 405
BACKGROUND = 250


def drawn(folder: Path, width: int) -> np.ndarray:
    """Return the mesh with its texture, seen from the left and above: (H, W, 3) BGR."""
    glb = trimesh.load(folder / "mesh.glb", force="mesh", process=False)
    texture = np.asarray(glb.visual.material.baseColorTexture.convert("RGB"))
    uv = np.stack([glb.visual.uv[:, 0], 1 - glb.visual.uv[:, 1]], axis=1)
    mesh = Mesh(
        vertices=(glb.vertices * (1, -1, -1)).astype(np.float32),
        faces=np.asarray(glb.faces, np.int32),
        uv=uv.astype(np.float32),
        texture=texture,
        colours=np.zeros((len(glb.vertices), 3), np.uint8),
        normals=np.zeros((len(glb.vertices), 3), np.float32),
    )
    return Frame(read_ply(folder / "cloud.ply"), (width, HEIGHT)).of_mesh(mesh)[..., ::-1]


def main(folder: Path, left: Path) -> None:
    """Put the photograph, the disparity, the status and the mesh side by side."""
    pictures = [cv2.imread(str(path)) for path in (left, folder / "disparity.png")]
    pictures.append(cv2.imread(str(folder / "status.png")))
    shrunk = [
        cv2.resize(
            picture,
            (picture.shape[1] * HEIGHT // picture.shape[0], HEIGHT),
            interpolation=cv2.INTER_AREA,
        )
        for picture in pictures
    ]
    shrunk.append(drawn(folder, shrunk[0].shape[1]))
    rows = [np.concatenate(shrunk[:2], 1), np.concatenate(shrunk[2:], 1)]
    width = max(row.shape[1] for row in rows)
    padded = [
        cv2.copyMakeBorder(
            row, 0, 0, 0, width - row.shape[1], cv2.BORDER_CONSTANT, value=(BACKGROUND,) * 3
        )
        for row in rows
    ]
    cv2.imwrite(str(Path(__file__).parent / "overview.png"), np.concatenate(padded, 0))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(__file__).parent.parent / "data" / "workshop" / "left.png")
