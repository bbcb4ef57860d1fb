"""Middlebury's data sets of 2001, 2003, 2005 and 2006: true disparities in pictures of 8 bits.

The disparities to search are fixed by what eight bits can hold, 256 / scale, and never taken from
the truth of a scene.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from calib.pair import RectifiedPair
from calib.rig import RectifiedGeometry
from recon.evaluation.layouts.geometries import nominal_geometry
from recon.evaluation.layouts.lookup import PICTURE_ENDINGS, picture, scene_in, truth_file
from recon.evaluation.layouts.protocol import Layout
from recon.evaluation.layouts.truths import (
    TRUTH_FACTORS,
    check_size,
    disparity_from_levels,
    read_levels,
    read_mask,
    seen_by_both,
    size_of,
)
from recon.evaluation.scene import Scene, SceneFiles, Truth
from recon.files import read_image_pair
from recon.types import Array

__all__ = ["MIDDLEBURY_2001_2003", "MIDDLEBURY_2005_2006"]

BITS = 8
VISIBLE = 255
MASK = "nonocc"

SCALES_2001 = {
    **dict.fromkeys(("barn1", "barn2", "bull", "map", "poster", "sawtooth", "venus"), 8),
    "tsukuba": 16,
}
SCENES_2003 = {f"{scene}{size}" for scene in ("cones", "teddy") for size in ("", "f", "h", "q")}
SCALES_2003 = {450: 4, 900: 2, 1800: 1}
"""Width in pixels -> grey levels a pixel of disparity."""

SCALES_2005_2006 = {1110: 1, 555: 2, 370: 3}
"""Height in pixels -> size of the original over that of the images, and levels a pixel."""

FULL_FOCAL_PX = 3740.0
BASELINE_M = 0.16


@dataclass(frozen=True)
class Release:
    """How the files of one release are called, and what their numbers mean.

    Attributes:
        layout: its key in `LAYOUTS`.
        views: stems of the left and the right image.
        truths: stems of the true disparities of the left and the right view.
        scale: grey levels a pixel of disparity, by the name and the (width, height) of a scene.
        mask_first: `nonocc` belongs to the release (as it does in evaluation version 2: 2001 and
            2003), so it is believed before the two truths.
        geometry: by the folder and the (width, height); None if there is no calibration.
    """

    layout: str
    views: tuple[str, str]
    truths: tuple[str, str]
    scale: Callable[[SceneFiles, tuple[int, int]], int]
    mask_first: bool
    geometry: Callable[[SceneFiles, tuple[int, int]], RectifiedGeometry | None]


def _scale_2001_2003(files: SceneFiles, size: tuple[int, int]) -> int:
    scene = files.name.lower()
    if scene in SCALES_2001:
        return SCALES_2001[scene]
    if scene in SCENES_2003:
        return _by_extent(files, "wide", size[0], SCALES_2003)
    known = ", ".join(sorted((*SCALES_2001, *SCENES_2003)))
    raise ValueError(
        f"{files.folder}: it is not known how many grey levels one pixel of disparity is in a "
        f"scene called {files.name}; expected {known}. Was the folder renamed?"
    )


def _scale_2005_2006(files: SceneFiles, size: tuple[int, int]) -> int:
    return _by_extent(files, "high", size[1], SCALES_2005_2006)


def _by_extent(files: SceneFiles, word: str, extent: int, scales: dict[int, int]) -> int:
    """Return the scale of a size, or raise ValueError if the release has no such size."""
    if extent not in scales:
        expected = ", ".join(str(known) for known in scales)
        raise ValueError(
            f"{files.folder}: the scale of its disparities is known for images {expected} pixels "
            f"{word}, got {extent}; were they resized?"
        )
    return scales[extent]


def _uncalibrated(_files: SceneFiles, _size: tuple[int, int]) -> None:
    return None


def _geometry_2005_2006(files: SceneFiles, size: tuple[int, int]) -> RectifiedGeometry | None:
    """Return the geometry of a scene with dmin.txt; None without, as infinity is unknown then.

    At full size f = 3740 px, B = 160 mm and dmin is to be added to a disparity before it is turned
    into depth. The principal point is not published and taken as the middle: depths are true, but
    a cloud may be shifted sideways in proportion to its depth.

    Source: vision.middlebury.edu/stereo/data/scenes2005 and scenes2006.
    """
    path = files.folder / "dmin.txt"
    if not path.is_file():
        return None
    text = path.read_text(encoding="utf-8", errors="replace").strip()
    try:
        dmin_px = float(text)
    except ValueError as error:
        raise ValueError(f"{path} must hold one number in pixels, got {text[:40]!r}") from error
    scale = _scale_2005_2006(files, size)
    middle = ((size[0] - 1) / 2, (size[1] - 1) / 2)
    right = (middle[0] + dmin_px / scale, middle[1])
    return RectifiedGeometry(size, FULL_FOCAL_PX / scale, middle, right, BASELINE_M)


def _find(folder: Path, *, release: Release) -> list[SceneFiles]:
    complete = all(picture(folder, stem) for stem in release.views)
    return [scene_in(folder, release.layout)] if complete else []


def _read(files: SceneFiles, *, release: Release) -> Scene:
    paths = [picture(files.folder, stem) for stem in release.views]
    left, right = read_image_pair(*(path for path in paths if path is not None))
    size = size_of(left)
    geometry = release.geometry(files, size)
    return Scene(
        files.dataset,
        files.name,
        RectifiedPair(left, right, geometry or nominal_geometry(size)),
        calibrated=geometry is not None,
        disparities=range(math.ceil(2**BITS / release.scale(files, size))),
        truth=_truth(files, size, release),
    )


def _truth(files: SceneFiles, size: tuple[int, int], release: Release) -> Truth:
    path = truth_file(files, tuple(f"{release.truths[0]}.{end}" for end in PICTURE_ENDINGS))
    factors = (1,) if files.truth_folder == files.folder else TRUTH_FACTORS
    levels = read_levels(path, bits=BITS)
    check_size(path, levels, size, factors=factors)
    scale = release.scale(files, size_of(levels))
    disparity = disparity_from_levels(levels, levels_per_px=scale)
    return Truth(disparity, _visible(files.truth_folder, disparity, scale, release))


def _visible(folder: Path, disparity: Array, scale: int, release: Release) -> Array | None:
    """Return where both cameras see the point; None if there is neither mask nor right truth."""
    mask_path, right_path = picture(folder, MASK), picture(folder, release.truths[1])
    if mask_path is not None and (release.mask_first or right_path is None):
        visible: Array = read_mask(mask_path, size_of(disparity)) == VISIBLE
        return visible
    if right_path is None:
        return None
    levels = read_levels(right_path, bits=BITS)
    check_size(right_path, levels, size_of(disparity))
    return seen_by_both(disparity, disparity_from_levels(levels, levels_per_px=scale))


def _layout(release: Release, looks_like: str) -> Layout:
    return Layout(
        release.layout, looks_like, partial(_find, release=release), partial(_read, release=release)
    )


MIDDLEBURY_2001_2003 = _layout(
    Release(
        "middlebury_2001_2003",
        ("im2", "im6"),
        ("disp2", "disp6"),
        _scale_2001_2003,
        mask_first=True,
        geometry=_uncalibrated,
    ),
    "Middlebury 2001 or 2003: im2 im6 disp2 disp6, as png, ppm or pgm",
)
MIDDLEBURY_2005_2006 = _layout(
    Release(
        "middlebury_2005_2006",
        ("view1", "view5"),
        ("disp1", "disp5"),
        _scale_2005_2006,
        mask_first=False,
        geometry=_geometry_2005_2006,
    ),
    "Middlebury 2005 or 2006: view1 view5 disp1 disp5, as png, ppm or pgm",
)
