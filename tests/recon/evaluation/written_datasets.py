"""Data sets of a few pixels in every layout, with a truth that can be told by hand."""

from pathlib import Path

import cv2
import numpy as np

from calib import Camera, Pose, RectifiedGeometry, StereoCalibration, write_calibration
from calib.formats import CalibrationRecord
from recon.files import write_image, write_pfm

WIDTH, HEIGHT = 12, 4
FAR_PX, NEAR_PX = 2.0, 5.0
NEAR_COLUMNS = slice(6, 9)
SEEN = np.array([False, False, True, False, False, False] + 6 * [True])
"""Of the first columns two lie beyond the border of the right view, three behind the near thing."""


def true_disparity(width=WIDTH, height=HEIGHT, *, of_right=False):
    """Return a near thing before a far wall; the first pixel of the left view is unknown."""
    disparity = np.full((height, width), FAR_PX, np.float32)
    shift = int(NEAR_PX) if of_right else 0
    disparity[:, NEAR_COLUMNS.start - shift : NEAR_COLUMNS.stop - shift] = NEAR_PX
    if not of_right:
        disparity[0, 0] = np.nan
    return disparity


def seen(width=WIDTH, height=HEIGHT):
    """Return which pixels of the left view both cameras see."""
    row = np.concatenate([SEEN, np.ones(width - len(SEEN), bool)])
    return np.tile(row, (height, 1))


def mask(width=WIDTH, height=HEIGHT):
    """Return a mask that differs from what the two truths say: only the last two columns count."""
    visible = np.zeros((height, width), np.uint8)
    visible[:, -2:] = 255
    visible[:, :2] = 128
    return visible


def pictures(width=WIDTH, height=HEIGHT):
    """Return two images of noise."""
    dice = np.random.default_rng(width)
    return [dice.integers(0, 256, (height, width, 3), np.uint8) for _ in range(2)]


def write_pair(left: Path, right: Path, width=WIDTH, height=HEIGHT) -> None:
    left.parent.mkdir(parents=True, exist_ok=True)
    right.parent.mkdir(parents=True, exist_ok=True)
    for path, image in zip((left, right), pictures(width, height), strict=True):
        cv2.imwrite(str(path), image[..., ::-1])


def write_levels(path: Path, disparity, levels_per_px) -> None:
    """Write a disparity as multiples of a fraction of a pixel, 0 where it is unknown."""
    path.parent.mkdir(parents=True, exist_ok=True)
    kind = np.uint16 if levels_per_px == 256 else np.uint8
    levels = np.nan_to_num(disparity * levels_per_px).round().astype(kind)
    assert cv2.imwrite(str(path), levels)


def write_calib_txt(folder: Path, width=WIDTH, height=HEIGHT, *, ndisp=8, baseline=160, isint=0):
    lines = [
        "cam0=[30 0 5; 0 30 2; 0 0 1]",
        "cam1=[30 0 9; 0 30 2; 0 0 1]",
        "doffs=4",
        f"baseline={baseline}",
        f"width={width}",
        f"height={height}",
        f"ndisp={ndisp}",
        f"isint={isint}",
    ]
    (folder / "calib.txt").write_text("\n".join(lines))


def middlebury_v3(folder: Path, width=WIDTH, height=HEIGHT, *, truth="disp0GT.pfm", **calibration):
    """Write a scene with truth and mask."""
    write_pair(folder / "im0.png", folder / "im1.png", width, height)
    write_calib_txt(folder, width, height, **calibration)
    write_pfm(folder / truth, true_disparity(width, height))
    write_image(folder / "mask0nocc.png", mask(width, height))
    return folder


def truth_of_v3(folder: Path, width=WIDTH, height=HEIGHT, disparity=None) -> Path:
    """Write truth and mask alone, as archives of truth hold them."""
    folder.mkdir(parents=True)
    values = true_disparity(width, height) if disparity is None else disparity
    write_pfm(folder / "disp0GT.pfm", values)
    write_image(folder / "mask0nocc.png", mask(width, height))
    return folder


def middlebury_2001(folder: Path, width=WIDTH, height=HEIGHT, *, scale=8, image="png", map_="png"):
    """Write a scene of 2001 or 2003 with the truth of both views."""
    write_pair(folder / f"im2.{image}", folder / f"im6.{image}", width, height)
    write_levels(folder / f"disp2.{map_}", true_disparity(width, height), scale)
    write_levels(folder / f"disp6.{map_}", true_disparity(width, height, of_right=True), scale)
    return folder


def middlebury_2005(folder: Path, width=WIDTH, height=370, *, scale=3):
    """Write a scene of 2005 or 2006 with the truth of both views."""
    write_pair(folder / "view1.png", folder / "view5.png", width, height)
    write_levels(folder / "disp1.png", true_disparity(width, height), scale)
    write_levels(folder / "disp5.png", true_disparity(width, height, of_right=True), scale)
    return folder


def kitti(folder: Path, frames=("000002",), *, left="image_2", right="image_3", ending="_0"):
    """Write frames with both truths; pixels that `seen` leaves out are missing in the second."""
    for frame in frames:
        name = f"{frame}_10.png"
        write_pair(folder / left / name, folder / right / name)
        disparity = true_disparity()
        write_levels(folder / f"disp_occ{ending}" / name, disparity, 256)
        write_levels(folder / f"disp_noc{ending}" / name, np.where(seen(), disparity, np.nan), 256)
    return folder


def kitti_calibration(path: Path) -> None:
    """Write projections of four cameras: the grey ones 0.54 m apart, those in colour 0.53 m."""
    offsets = {"P0": 0.0, "P1": -0.54 * 50, "P2": 0.06 * 50, "P3": -0.47 * 50}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        "\n".join(f"{name}: 50 0 6 {offset} 0 50 2 0 0 0 1 0" for name, offset in offsets.items())
    )


def sceneflow(folder: Path, *, sign=1.0):
    """Write a pair with the truth of the left view."""
    write_pair(folder / "left.png", folder / "right.png")
    write_pfm(folder / "disp_left.pfm", sign * true_disparity())
    return folder


def sceneflow_tree(root: Path, sequences=("TRAIN/A/0000",), *, frames="frames_finalpass"):
    """Write frame 0006 of some sequences, in the folders of FlyingThings3D."""
    for sequence in sequences:
        pair = root / frames / sequence
        write_pair(pair / "left" / "0006.png", pair / "right" / "0006.png")
        for side in ("left", "right"):
            path = root / "disparity" / sequence / side / "0006.pfm"
            path.parent.mkdir(parents=True, exist_ok=True)
            write_pfm(path, -true_disparity(of_right=side == "right"))
    return root


def generated(folder: Path):
    """Write a pair as data/ holds it."""
    write_pair(folder / "left.png", folder / "right.png")
    geometry = RectifiedGeometry((WIDTH, HEIGHT), 40.0, (5.5, 1.5), (5.5, 1.5), 0.14)
    record = CalibrationRecord(None, geometry, folder, "json", disparities=range(9))
    write_calibration(folder / "rig.json", record)
    write_levels(folder / "disparity_truth.png", true_disparity(), 256)
    write_image(folder / "visible.png", 255 * seen().astype(np.uint8))
    return folder


def pool(folder: Path, seeds=(1,), **other_arrays):
    """Write pairs as pools for training hold them."""
    folder.mkdir(parents=True, exist_ok=True)
    left, right = pictures()
    arrays = {
        "left": left,
        "right": right,
        "disparity": true_disparity(),
        "visible": seen(),
        **other_arrays,
    }
    for seed in seeds:
        np.savez(
            folder / f"pair_{seed:06d}.npz",
            **{name: array for name, array in arrays.items() if array is not None},
        )
    return folder


def raw_calibration(path: Path) -> None:
    """Write cameras as they are before rectification, and nothing else."""
    K = np.array([[30.0, 0, 5], [0, 30, 2], [0, 0, 1]])
    camera = Camera((WIDTH, HEIGHT), K, np.zeros(5))
    pose = Pose(np.eye(3), np.array([-0.1, 0, 0]))
    write_calibration(path, StereoCalibration(camera, camera, pose))
