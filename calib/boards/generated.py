"""Rigs, and boards as they see them, with everything known: to check calibrations against."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from calib.boards.charuco import Charuco
from calib.boards.chessboard import Chessboard
from calib.boards.protocol import Array, Board, Corners
from calib.camera import Camera, CameraModel
from calib.pair import Image
from calib.pose import Pose
from calib.rig import StereoCalibration

__all__ = ["photograph", "printed", "random_poses", "random_rig", "seen_corners"]

FINE = 2  # samples a pixel, each way
PIXELS_A_SQUARE = 60
BRIGHT, DARK, ROOM = 225.0, 25.0, 110.0
LENS_BLUR_PX, SENSOR_NOISE = 0.6, 2.0
MARGIN_PX = 6.0
FOCAL_SHARE: dict[CameraModel, float] = {"pinhole": 0.85, "fisheye": 0.45}
FURTHEST = 1e4  # px, of places on the print


def random_rig(
    size: tuple[int, int], model: CameraModel = "pinhole", baseline_m: float = 0.12, *, seed: int
) -> StereoCalibration:
    """Return a rig with lens distortion, turned by a degree or so, as real ones are."""
    draw = np.random.default_rng(seed)
    left, right = (_random_camera(size, model, draw) for _ in range(2))
    turn = draw.normal(0, np.radians(1.0), 3)
    t = [-baseline_m, *draw.normal(0, 0.002, 2)]
    return StereoCalibration(left, right, Pose.from_values(np.array([*turn, *t])))


def _random_camera(size: tuple[int, int], model: CameraModel, draw: np.random.Generator) -> Camera:
    width, _ = size
    f = width * FOCAL_SHARE[model] * draw.uniform(0.95, 1.05)
    cx, cy = np.array(size) / 2 + draw.uniform(-0.02, 0.02, 2) * width
    K = np.array([[f, 0, cx], [0, f * draw.uniform(0.995, 1.005), cy], [0, 0, 1]])
    if model == "pinhole":
        lens = [draw.uniform(-0.3, -0.1), draw.uniform(0, 0.1), *draw.normal(0, 5e-4, 2), 0.0]
    else:
        lens = [draw.uniform(-0.03, 0.03), draw.uniform(-0.01, 0.01), 0.0, 0.0]
    return Camera(size, K, np.array(lens), model)


def random_poses(
    board: Board, rig: StereoCalibration, count: int, *, seed: int, tilt_deg: float = 40.0
) -> list[Pose]:
    """Return poses of a board before the left camera in which both cameras see all of it.

    Args:
        board: of about any size.
        rig: that looks at it.
        count: how many.
        seed: of the draws.
        tilt_deg: the largest angle between board and image; most are over a third of it.
    """
    draw = np.random.default_rng(seed)
    span, middle = float(np.ptp(board.points, axis=0).max()), board.points.mean(0)
    reach = 0.4 * np.array(rig.left.size) / rig.left.K[0, 0]
    poses: list[Pose] = []
    while len(poses) < count:
        distance = span * rig.left.K[0, 0] / rig.left.size[0] * draw.uniform(1.2, 2.4)
        around, tilt = draw.uniform(0, 2 * np.pi), np.radians(tilt_deg) * draw.uniform(0.3, 1.0)
        tilted = _turn(tilt * np.array([np.cos(around), np.sin(around), 0]))
        R = tilted @ _turn(np.array([0, 0, draw.normal(0, 0.2)]))
        place = np.array([*draw.uniform(-reach, reach), 1.0]) * distance
        pose = Pose(R, place - R @ middle)
        at_right = rig.right_from_left @ pose
        if _sees_all(rig.left, board, pose) and _sees_all(rig.right, board, at_right):
            poses.append(pose)
    return poses


def _turn(vector: Array) -> Array:
    R, _ = cv2.Rodrigues(vector[:, None])
    return np.asarray(R, np.float64)


def _sees_all(camera: Camera, board: Board, pose: Pose) -> bool:
    return bool(_inside(camera, camera.project(pose.apply(board.points)), MARGIN_PX).all())


def _inside(camera: Camera, pixels: Array, margin: float) -> npt.NDArray[np.bool_]:
    """Return which pixels (n, 2) lie in the image of a camera, at least so far from its border."""
    last = np.array(camera.size) - 1 - margin
    return np.asarray(((pixels >= margin) & (pixels <= last)).all(1))


def seen_corners(
    board: Board, camera: Camera, pose: Pose, *, noise_px: float = 0.0, seed: int = 0
) -> Corners:
    """Return the points of a board that a camera sees, each off by normal noise."""
    pixels = camera.project(pose.apply(board.points))
    kept = _inside(camera, pixels, 0.0)
    noise = np.random.default_rng(seed).normal(0, 1, pixels.shape) * noise_px
    return Corners(np.flatnonzero(kept), (pixels + noise)[kept])


def printed(board: Chessboard | Charuco) -> tuple[npt.NDArray[np.float32], Array]:
    """Return a picture of a board with a white border, and how it is placed.

    Returns:
        (H, W) float32 from 0 to 255, and (3, 3) from metres on the board to pixels of the picture.
    """
    if isinstance(board, Charuco):
        size = (board.columns * PIXELS_A_SQUARE, board.rows * PIXELS_A_SQUARE)
        picture = np.asarray(board.pattern.generateImage(size, marginSize=0, borderBits=1))
        border, first = PIXELS_A_SQUARE // 2, 0
    else:
        row, column = np.mgrid[: board.rows + 1, : board.columns + 1]
        squares = np.where((row + column) % 2 == 0, 0, 255).astype(np.uint8)
        picture = np.kron(squares, np.ones((PIXELS_A_SQUARE, PIXELS_A_SQUARE), np.uint8))
        border = first = PIXELS_A_SQUARE  # points begin at the first inner corner
    whole = np.pad(picture, border, constant_values=255).astype(np.float32)
    scale = PIXELS_A_SQUARE / board.square_m
    origin = border + first - 0.5  # where four squares meet lies between the centres of pixels
    return whole, np.array([[scale, 0, origin], [0, scale, origin], [0, 0, 1]])


def photograph(
    board: Chessboard | Charuco,
    camera: Camera,
    pose: Pose,
    *,
    noise: float = SENSOR_NOISE,
    seed: int = 0,
) -> Image:
    """Return (H, W, 3) uint8: a board in a grey room, with the blur of a lens and noise.

    Args:
        board: what is seen.
        camera: that sees it.
        pose: of the board before the camera.
        noise: standard deviation, of 255.
        seed: of the noise.
    """
    picture, to_pixels = printed(board)
    picture = (DARK + (BRIGHT - DARK) / 255 * picture).astype(np.float32)
    rays, (width, height) = _rays(camera)
    with np.errstate(all="ignore"):
        hits = rays * (pose.R[:, 2] @ pose.t / (rays @ pose.R[:, 2]))[:, None]
    places = ((hits - pose.t) @ pose.R)[:, :2] @ to_pixels[:2, :2].T + to_pixels[:2, 2]
    places = np.nan_to_num(places, nan=-FURTHEST).clip(-FURTHEST, FURTHEST)
    x, y = places.astype(np.float32).reshape(height, width, 2).transpose(2, 0, 1)
    seen = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderValue=ROOM)
    seen = cv2.resize(seen, camera.size, interpolation=cv2.INTER_AREA)
    seen = cv2.GaussianBlur(seen, (0, 0), LENS_BLUR_PX)
    noisy = np.asarray(seen) + np.random.default_rng(seed).normal(0, noise, seen.shape)
    return np.repeat(noisy.clip(0, 255).round().astype(np.uint8)[..., None], 3, axis=2)


@lru_cache(maxsize=8)
def _rays(camera: Camera) -> tuple[Array, tuple[int, int]]:
    """Return the rays of the parts of all pixels, row by row, and how many parts there are."""
    fine = camera.resized((camera.size[0] * FINE, camera.size[1] * FINE))
    y, x = np.mgrid[: fine.size[1], : fine.size[0]].reshape(2, -1).astype(np.float64)
    return fine.unproject(np.column_stack([x, y])), fine.size
