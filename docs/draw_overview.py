"""Draw docs/overview.png from a finished `make demo`: python docs/draw_overview.py out/demo."""

import math
import sys
from pathlib import Path

import cv2
import numpy as np
import trimesh

HEIGHT = 405
BACKGROUND = 250
FILLED = 0.97


def seen_from(vertices: np.ndarray, turn: float, tilt: float) -> np.ndarray:
    """Turn vertices (V, 3) in glTF axes about their middle; return (V, 3), z to the eye."""
    middle = np.median(vertices, axis=0)
    about_y = np.array(
        [[math.cos(turn), 0, math.sin(turn)], [0, 1, 0], [-math.sin(turn), 0, math.cos(turn)]]
    )
    about_x = np.array(
        [[1, 0, 0], [0, math.cos(tilt), -math.sin(tilt)], [0, math.sin(tilt), math.cos(tilt)]]
    )
    return (vertices - middle) @ about_y.T @ about_x.T


def drawn(mesh: trimesh.Trimesh, width: int) -> np.ndarray:
    """Paint the triangles from far to near, each in the colour of its middle: (H, W, 3) BGR."""
    texture = np.asarray(mesh.visual.material.baseColorTexture.convert("RGB"))[..., ::-1]
    uv = mesh.visual.uv[mesh.faces].mean(1)
    rows = ((1 - uv[:, 1]) * texture.shape[0]).astype(int).clip(0, texture.shape[0] - 1)
    columns = (uv[:, 0] * texture.shape[1]).astype(int).clip(0, texture.shape[1] - 1)
    turned = seen_from(mesh.vertices, math.radians(32), math.radians(12))
    low, high = turned[:, :2].min(0), turned[:, :2].max(0)
    scale = FILLED * min(width / (high[0] - low[0]), HEIGHT / (high[1] - low[1]))
    centred = scale * (turned[:, :2] - (low + high) / 2)
    flat = np.stack([width / 2 + centred[:, 0], HEIGHT / 2 - centred[:, 1]], 1)
    corners = (flat[mesh.faces] * 16).round().astype(np.int32)
    picture = np.full((HEIGHT, width, 3), BACKGROUND, np.uint8)
    for face in np.argsort(turned[mesh.faces, 2].mean(1)):
        colour = texture[rows[face], columns[face]].tolist()
        cv2.fillConvexPoly(picture, corners[face], colour, shift=4)
    return picture


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
    shrunk.append(drawn(trimesh.load(folder / "mesh.glb", force="mesh"), shrunk[0].shape[1]))
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
