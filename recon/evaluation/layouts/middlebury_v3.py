"""Middlebury's evaluation version 3, its 2014 and 2021 data sets, and ETH3D two-view.

A folder a scene holds im0.png, im1.png and calib.txt; the truth lies beside them or, for ETH3D,
in a folder of the same name under two_view_training_gt.

Of ETH3D's calib.txt: the keys and units are Middlebury's (baseline in mm: 59.9696 is printed for
storage_room_2_2l, whose images.txt places the cameras 0.05997 m apart), doffs is 0, and ndisp
is the width of the images (942 for delivery_area_1l), which bounds nothing.
"""

from __future__ import annotations

import re
from pathlib import Path

from calib.pair import RectifiedPair
from recon.evaluation.layouts.geometries import disparities_by_width, read_geometry
from recon.evaluation.layouts.lookup import first_file, scene_in, truth_file
from recon.evaluation.layouts.protocol import Layout
from recon.evaluation.layouts.truths import (
    TRUTH_FACTORS,
    check_size,
    read_mask,
    seen_by_both,
    size_of,
)
from recon.evaluation.scene import Scene, SceneFiles, Truth
from recon.files import read_image_pair, read_pfm
from recon.types import Array

__all__ = ["BENCHMARK", "MIDDLEBURY_V3"]

NAME = "middlebury_v3"
BENCHMARK = "middlebury-v3"
TRUTH_OF_BENCHMARK = "disp0GT.pfm"
TRUTHS = (TRUTH_OF_BENCHMARK, "disp0.pfm")
RIGHT_TRUTHS = ("disp1GT.pfm", "disp1.pfm")
MASK = "mask0nocc.png"
VISIBLE = 255  # 128 is occluded, 0 unknown
INTEGER = re.compile(r"^\s*isint\s*=\s*1\s*$", re.MULTILINE)
SUFFIX_OF_TRUTH_FOLDERS = "_gt"

QUARTER_WIDTHS = {
    "Adirondack": 718,
    "ArtL": 347,
    "Jadeplant": 659,
    "Motorcycle": 741,
    "MotorcycleE": 741,
    "Piano": 707,
    "PianoL": 707,
    "Pipes": 735,
    "Playroom": 699,
    "Playtable": 680,
    "PlaytableP": 681,
    "Recycle": 720,
    "Shelves": 738,
    "Teddy": 450,
    "Vintage": 722,
}
"""The 15 training scenes of the evaluation and their widths at quarter size, in pixels."""

INTEGER_AT_FULL_SIZE = ("ArtL", "Teddy")
WIDTH_TOLERANCE_PX = 8
"""At full size, for widths that were rounded when halved."""


def _find(folder: Path) -> list[SceneFiles]:
    if not all((folder / name).is_file() for name in ("im0.png", "im1.png")):
        return []
    beside = folder.parent.with_name(folder.parent.name + SUFFIX_OF_TRUTH_FOLDERS) / folder.name
    elsewhere = first_file(folder, TRUTHS) is None and first_file(beside, TRUTHS) is not None
    return [scene_in(folder, NAME, truth_folder=beside if elsewhere else None)]


def _read(files: SceneFiles) -> Scene:
    left, right = read_image_pair(files.folder / "im0.png", files.folder / "im1.png")
    size = size_of(left)
    truth_path = truth_file(files, TRUTHS)
    geometry, stated = read_geometry(files.folder / "calib.txt", size)
    disparity = read_pfm(truth_path)
    factors = (1,) if files.truth_folder == files.folder else TRUTH_FACTORS
    check_size(truth_path, disparity, size, factors=factors)
    full_px_per_px = _full_px_per_px(files.name, truth_path, disparity.shape[1])
    truth = Truth(
        disparity,
        _visible(files.truth_folder, disparity),
        integer=_is_integer(files, full_px_per_px),
        full_px_per_px=full_px_per_px or 1,
    )
    return Scene(
        files.dataset,
        files.name,
        RectifiedPair(left, right, geometry),
        calibrated=True,
        disparities=_searched(stated, size[0]),
        truth=truth,
        benchmark=BENCHMARK if full_px_per_px else "",
    )


def _full_px_per_px(name: str, truth_path: Path, width: int) -> int | None:
    """Return how many pixels of the full size one pixel is; None outside the benchmark.

    A scene belongs to the benchmark by its name, the name of its truth (the 2014 data set has
    some of the same scenes, with disp0.pfm) and a width that is one of the three sizes.
    """
    if name not in QUARTER_WIDTHS or truth_path.name != TRUTH_OF_BENCHMARK:
        return None
    full_width = 4 * QUARTER_WIDTHS[name]
    fits = (f for f in TRUTH_FACTORS if abs(f * width - full_width) <= WIDTH_TOLERANCE_PX)
    return next(fits, None)


def _is_integer(files: SceneFiles, full_px_per_px: int | None) -> bool:
    """Return whether the truth was rounded to whole pixels, as calib.txt beside it says.

    Archives of truth alone hold no calib.txt; then it is known for the benchmark.
    """
    calibration = files.truth_folder / "calib.txt"
    if calibration.is_file():
        return INTEGER.search(calibration.read_text(encoding="utf-8", errors="replace")) is not None
    return full_px_per_px == 1 and files.name in INTEGER_AT_FULL_SIZE


def _visible(folder: Path, disparity: Array) -> Array | None:
    """Return where both cameras see the point; None if there is neither mask nor right truth."""
    if (folder / MASK).is_file():
        visible: Array = read_mask(folder / MASK, size_of(disparity)) == VISIBLE
        return visible
    right_path = first_file(folder, RIGHT_TRUTHS)
    if right_path is None:
        return None
    of_right = read_pfm(right_path)
    check_size(right_path, of_right, size_of(disparity))
    return seen_by_both(disparity, of_right)


def _searched(stated: range | None, width: int) -> range:
    """Return the range that calib.txt states (ndisp), if it says more than the width does."""
    return stated if stated and len(stated) < width else disparities_by_width(width)


MIDDLEBURY_V3 = Layout(
    NAME,
    "Middlebury v3, 2014, 2021 or ETH3D: im0.png im1.png calib.txt, disp0GT.pfm or disp0.pfm",
    _find,
    _read,
)
