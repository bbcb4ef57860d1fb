"""Pairs that this project draws itself: the sample pairs, and pools made for training."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path

import numpy as np

from calib.pair import RectifiedPair
from recon.evaluation.layouts.geometries import (
    disparities_by_width,
    nominal_geometry,
    read_geometry,
)
from recon.evaluation.layouts.lookup import dataset_name, scene_in, truth_file
from recon.evaluation.layouts.protocol import Layout
from recon.evaluation.layouts.truths import (
    TRUTH_FACTORS,
    check_size,
    disparity_from_levels,
    read_levels,
    read_mask,
    size_of,
)
from recon.evaluation.scene import Scene, SceneFiles, Truth
from recon.files import read_image_pair
from recon.types import Array

__all__ = ["GENERATED", "TRAINING_POOL"]

NAME = "generated"
POOL_NAME = "training_pool"
LEVELS_PER_PX = 256.0
VISIBLE = 255
POOL_FILE = re.compile(r"pair_\d{6}\.npz")
POOL_ARRAYS = ("left", "right", "disparity", "visible")

POOL_SHARE_OF_WIDTH = 0.3
"""Things are placed at disparities up to a quarter of the width, and some reach out further."""


def _find(folder: Path) -> list[SceneFiles]:
    complete = all((folder / name).is_file() for name in ("left.png", "right.png", "rig.json"))
    return [scene_in(folder, NAME)] if complete else []


def _read(files: SceneFiles) -> Scene:
    left, right = read_image_pair(files.folder / "left.png", files.folder / "right.png")
    size = size_of(left)
    truth_path = truth_file(files, ("disparity_truth.png",))
    geometry, stated = read_geometry(files.folder / "rig.json", size)
    levels = read_levels(truth_path, bits=16)
    factors = (1,) if files.truth_folder == files.folder else TRUTH_FACTORS
    check_size(truth_path, levels, size, factors=factors)
    mask_path = files.truth_folder / "visible.png"
    visible = read_mask(mask_path, size_of(levels)) == VISIBLE if mask_path.is_file() else None
    return Scene(
        files.dataset,
        files.name,
        RectifiedPair(left, right, geometry),
        calibrated=True,
        disparities=stated or disparities_by_width(size[0]),
        truth=Truth(disparity_from_levels(levels, levels_per_px=LEVELS_PER_PX), visible),
    )


def _find_in_pool(folder: Path) -> list[SceneFiles]:
    paths = sorted(path for path in folder.glob("pair_*.npz") if POOL_FILE.fullmatch(path.name))
    dataset = dataset_name(folder)
    return [SceneFiles(POOL_NAME, dataset, path.stem, folder, folder) for path in paths]


def _read_from_pool(files: SceneFiles) -> Scene:
    path = files.folder / f"{files.name}.npz"
    left, right, disparity, visible = _pool_arrays(path)
    size = size_of(left)
    check_size(path, disparity, size)
    return Scene(
        files.dataset,
        files.name,
        RectifiedPair(left, right, nominal_geometry(size)),
        calibrated=False,
        disparities=disparities_by_width(size[0], share=POOL_SHARE_OF_WIDTH),
        truth=Truth(disparity.astype(np.float32), visible.astype(bool)),
    )


def _pool_arrays(path: Path) -> list[Array]:
    """Return left, right, disparity and visible, or raise ValueError if one is not there."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            missing = [name for name in POOL_ARRAYS if name not in arrays]
            if not missing:
                return [arrays[name] for name in POOL_ARRAYS]
    except (zipfile.BadZipFile, ValueError, EOFError) as error:
        raise ValueError(f"{path} cannot be read: {error}; was it written in full?") from error
    raise ValueError(f"{path} has no {', '.join(missing)}; expected {', '.join(POOL_ARRAYS)}")


GENERATED = Layout(
    NAME,
    "this project's sample pairs: left.png right.png rig.json disparity_truth.png visible.png",
    _find,
    _read,
)
TRAINING_POOL = Layout(
    POOL_NAME,
    "this project's training pools: files pair_NNNNNN.npz",
    _find_in_pool,
    _read_from_pool,
)
