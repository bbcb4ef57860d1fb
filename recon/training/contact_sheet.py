"""Draw random scenes on one sheet: `python -m recon.training.contact_sheet OUT.jpg`."""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
import torch

from recon.colours import colour_mapped, colour_range
from recon.training.scenes import StereoSample, draw
from recon.types import Array

__all__ = ["contact_sheet", "main"]

SIZE = (256, 160)
QUALITY = 72  # of the JPEG
COLUMNS, ROWS = 6, 4
FIRST_SEED = 300


def _cell(sample: StereoSample) -> Array:
    """Return the left image over its disparity in colours, (2 H, W, 3) uint8."""
    image = (sample.left * 255).round().byte().numpy()
    disparity = sample.disparity_left.numpy()
    return np.concatenate((image, colour_mapped(disparity, *colour_range(disparity))))


def contact_sheet(seeds: range, columns: int, size: tuple[int, int]) -> Array:
    """Return pairs drawn from seeds, row by row: left images over disparities.

    Args:
        seeds: one scene each, a whole number of rows.
        columns: scenes a row.
        size: (width, height) of each image.

    Returns:
        (2 height rows, width columns, 3) uint8; colours run over the disparities of each scene.
    """
    cells = [_cell(draw(torch.Generator().manual_seed(seed), size)) for seed in seeds]
    rows = [cells[first : first + columns] for first in range(0, len(cells), columns)]
    return np.concatenate([np.concatenate(row, 1) for row in rows])


def main(path: Path) -> None:
    """Draw 24 scenes and write them as a JPEG."""
    seeds = range(FIRST_SEED, FIRST_SEED + COLUMNS * ROWS)
    sheet = cv2.cvtColor(contact_sheet(seeds, COLUMNS, SIZE), cv2.COLOR_RGB2BGR)
    _, contents = cv2.imencode(".jpg", sheet, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    path.write_bytes(contents.tobytes())


if __name__ == "__main__":
    main(Path(sys.argv[1]))
