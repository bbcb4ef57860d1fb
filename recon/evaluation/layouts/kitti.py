"""KITTI stereo 2012 and 2015: a folder of frames for each camera, sparse truth of a laser."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.formats import READERS, CalibrationFile
from calib.pair import RectifiedPair
from calib.rig import RectifiedGeometry
from recon.evaluation.layouts.geometries import nominal_geometry, read_geometry, rectified
from recon.evaluation.layouts.lookup import dataset_name, first_file
from recon.evaluation.layouts.protocol import Layout
from recon.evaluation.layouts.truths import check_size, disparity_from_levels, read_levels, size_of
from recon.evaluation.scene import Scene, SceneFiles, Truth
from recon.files import read_image_pair
from recon.types import Array

__all__ = ["BENCHMARK", "KITTI"]

NAME = "kitti"
BENCHMARK = "kitti"
FRAMES = "*_10.png"
LEVELS_PER_PX = 256.0
SEARCHED = range(192)
CALIBRATION_FOLDERS = ("calib_cam_to_cam", "calib_cam", "calib")
COLOUR_CAMERAS = ("P2", "P3", "P_rect_02", "P_rect_03")


@dataclass(frozen=True)
class Release:
    """The folders of one release.

    Attributes:
        left: images of the left camera.
        right: images of the right camera.
        all_known: truth of all pixels that the laser hit.
        non_occluded: truth of those that both cameras see.
        grey: the images are of the grey cameras.
    """

    left: str
    right: str
    all_known: str
    non_occluded: str
    grey: bool = False


RELEASES = (
    Release("image_2", "image_3", "disp_occ_0", "disp_noc_0"),
    Release("colored_0", "colored_1", "disp_occ", "disp_noc"),
    Release("image_0", "image_1", "disp_occ", "disp_noc", grey=True),
)
"""2015, 2012 in colour, 2012 in grey; a folder is read as the first that it is."""


def _release_and_frames(folder: Path) -> tuple[Release, list[Path]] | None:
    """Return how a folder is laid out and its left images; None if it is not KITTI."""
    for release in RELEASES:
        if (folder / release.left).is_dir() and (folder / release.right).is_dir():
            frames = sorted((folder / release.left).glob(FRAMES))
            if frames:
                return release, frames
    return None


def _find(folder: Path) -> list[SceneFiles]:
    found = _release_and_frames(folder)
    if found is None:
        return []
    release, frames = found
    if not (folder / release.all_known).is_dir():
        raise ValueError(
            f"{folder} has {len(frames)} frames but no truth: expected a folder "
            f"{release.all_known}; the truth of KITTI's testing frames is not published"
        )
    dataset = dataset_name(folder)
    return [SceneFiles(NAME, dataset, frame.stem, folder, folder) for frame in frames]


def _read(files: SceneFiles) -> Scene:
    found = _release_and_frames(files.folder)
    if found is None:
        raise FileNotFoundError(f"{files.folder} has no frames of KITTI any more; was it moved?")
    release, _ = found
    image = f"{files.name}.png"
    left, right = read_image_pair(
        files.folder / release.left / image, files.folder / release.right / image
    )
    size = size_of(left)
    geometry = _geometry(files, size, grey=release.grey)
    return Scene(
        files.dataset,
        files.name,
        RectifiedPair(left, right, geometry or nominal_geometry(size)),
        calibrated=geometry is not None,
        disparities=SEARCHED,
        truth=_truth(files.folder, image, size, release),
        benchmark=BENCHMARK,
    )


def _truth(folder: Path, image: str, size: tuple[int, int], release: Release) -> Truth:
    all_known = folder / release.all_known / image
    if not all_known.is_file():
        raise FileNotFoundError(
            f"{folder / release.left / image} has no truth: expected {all_known}; "
            "is the archive unpacked in full?"
        )
    non_occluded = folder / release.non_occluded / image
    visible = np.isfinite(_disparity(non_occluded, size)) if non_occluded.is_file() else None
    return Truth(_disparity(all_known, size), visible)


def _disparity(path: Path, size: tuple[int, int]) -> Array:
    levels = read_levels(path, bits=16)
    check_size(path, levels, size)
    return disparity_from_levels(levels, levels_per_px=LEVELS_PER_PX)


def _geometry(files: SceneFiles, size: tuple[int, int], *, grey: bool) -> RectifiedGeometry | None:
    """Return the geometry of a frame; None if its calibration is not there."""
    name = f"{files.name.removesuffix('_10')}.txt"
    path = first_file(files.folder, tuple(f"{folder}/{name}" for folder in CALIBRATION_FOLDERS))
    if path is None:
        return None
    return _geometry_of_grey(path, size) if grey else read_geometry(path, size)[0]


def _geometry_of_grey(path: Path, size: tuple[int, int]) -> RectifiedGeometry:
    """Read the projections of the grey cameras, which stand 0.8 % further apart than the others."""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    text = "\n".join(line for line in lines if line.partition(":")[0].strip() not in COLOUR_CAMERAS)
    try:
        record = READERS["kitti"].read(CalibrationFile(path, text, size))
        return rectified(record.for_images(size))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


KITTI = Layout(
    NAME,
    "KITTI 2015: image_2 image_3 disp_occ_0 disp_noc_0, or 2012: colored_0 colored_1 (or image_0 "
    "image_1) disp_occ disp_noc; frames *_10.png",
    _find,
    _read,
)
