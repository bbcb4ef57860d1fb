"""SceneFlow (FlyingThings3D, Monkaa, Driving): rendered pairs with dense truth.

Releases differ in the sign of the disparities, so their magnitude is taken.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.pair import RectifiedPair
from recon.evaluation.layouts.geometries import nominal_geometry
from recon.evaluation.layouts.lookup import dataset_name, scene_in, truth_file
from recon.evaluation.layouts.protocol import Layout
from recon.evaluation.layouts.truths import check_size, read_mask, seen_by_both, size_of
from recon.evaluation.scene import Scene, SceneFiles, Truth
from recon.files import read_image_pair, read_pfm
from recon.types import Array

__all__ = ["SCENEFLOW", "SCENEFLOW_TREE"]

NAME = "sceneflow"
TREE_NAME = "sceneflow_tree"
FRAME_FOLDERS = ("frames_finalpass", "frames_cleanpass")
TRUTH_FOLDER = "disparity"
OCCLUDED = 255
SEARCHED = range(192)


def _find(folder: Path) -> list[SceneFiles]:
    has_pair = all((folder / name).is_file() for name in ("left.png", "right.png"))
    return [scene_in(folder, NAME)] if has_pair and not (folder / "rig.json").exists() else []


def _read(files: SceneFiles) -> Scene:
    return _scene(
        files,
        (files.folder / "left.png", files.folder / "right.png"),
        truth_file(files, ("disp_left.pfm",)),
        files.truth_folder / "disp_right.pfm",
        files.truth_folder / "occ_left.png",
    )


def _find_in_tree(folder: Path) -> list[SceneFiles]:
    root = next((part for part in (folder, *folder.parents) if part.name in FRAME_FOLDERS), None)
    if root is None:
        return []
    frames = sorted(path for path in folder.rglob("*.png") if path.parent.name == "left")
    truths = root.parent / TRUTH_FOLDER
    if frames and not truths.is_dir():
        raise ValueError(
            f"{root} has {len(frames)} pairs but no truth: expected {truths}; "
            "is the archive of disparities unpacked beside it?"
        )
    return [_frame_of_tree(frame, root, truths) for frame in frames]


def _frame_of_tree(frame: Path, root: Path, truths: Path) -> SceneFiles:
    """Return the scene of TRAIN/A/0000/left/0006.png, which is called TRAIN-A-0000-0006."""
    sequence = frame.parent.parent.relative_to(root)
    name = "-".join((*sequence.parts, frame.stem))
    return SceneFiles(TREE_NAME, dataset_name(root), name, root / sequence, truths / sequence)


def _read_from_tree(files: SceneFiles) -> Scene:
    frame = files.name.rpartition("-")[2]
    return _scene(
        files,
        (files.folder / "left" / f"{frame}.png", files.folder / "right" / f"{frame}.png"),
        truth_file(files, (f"left/{frame}.pfm",)),
        files.truth_folder / "right" / f"{frame}.pfm",
        None,
    )


def _scene(
    files: SceneFiles,
    images: tuple[Path, Path],
    truth_path: Path,
    right_truth_path: Path,
    occlusions_path: Path | None,
) -> Scene:
    left, right = read_image_pair(*images)
    size = size_of(left)
    disparity = _magnitude(truth_path, size)
    return Scene(
        files.dataset,
        files.name,
        RectifiedPair(left, right, nominal_geometry(size)),
        calibrated=False,
        disparities=SEARCHED,
        truth=Truth(disparity, _visible(disparity, right_truth_path, occlusions_path)),
    )


def _magnitude(path: Path, size: tuple[int, int]) -> Array:
    disparity = np.abs(read_pfm(path))
    check_size(path, disparity, size)
    return disparity


def _visible(
    disparity: Array, right_truth_path: Path, occlusions_path: Path | None
) -> Array | None:
    """Return where both cameras see the point; None if there is neither mask nor right truth."""
    size = size_of(disparity)
    if occlusions_path is not None and occlusions_path.is_file():
        visible: Array = read_mask(occlusions_path, size) != OCCLUDED
        return visible
    if right_truth_path.is_file():
        return seen_by_both(disparity, _magnitude(right_truth_path, size))
    return None


SCENEFLOW = Layout(
    NAME,
    "SceneFlow, single pairs: left.png right.png disp_left.pfm (disp_right.pfm, occ_left.png)",
    _find,
    _read,
)
SCENEFLOW_TREE = Layout(
    TREE_NAME,
    "SceneFlow as published: frames_finalpass or frames_cleanpass with left/NNNN.png and "
    "right/NNNN.png below, beside it disparity with left/NNNN.pfm",
    _find_in_tree,
    _read_from_tree,
)
