"""Rigs, and boards and a room as they see them, with everything known: to check calibrations."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from itertools import cycle, islice

import cv2
import numpy as np
import numpy.typing as npt

from calib.boards.charuco import Charuco
from calib.boards.chessboard import Chessboard
from calib.boards.protocol import Array, Board, Corners
from calib.camera import LENSES, Camera, LensName
from calib.pair import Image, StereoPair
from calib.pose import Pose
from calib.rig import StereoCalibration

__all__ = [
    "photograph",
    "photograph_room",
    "poses_for_one",
    "printed",
    "random_poses",
    "random_rig",
    "seen_corners",
]

FINE = 2  # samples a pixel, each way
PIXELS_A_SQUARE = 60
BRIGHT, DARK, ROOM = 225.0, 25.0, 110.0
LENS_BLUR_PX, SENSOR_NOISE = 0.6, 2.0
MARGIN_PX = 6.0
FOCAL_SHARE: dict[LensName, float] = {"pinhole": 0.85, "rational": 0.7, "fisheye": 0.45}
FURTHEST = 1e4  # px, of places on the print
TEXTURE_PX = 2048


def random_rig(
    size: tuple[int, int], lens: LensName = "pinhole", baseline_m: float = 0.12, *, seed: int
) -> StereoCalibration:
    """Return a rig with lens distortion, turned by a degree or so, as real ones are.

    A pinhole shows 65 degrees with a little barrel distortion, a rational lens some 100 degrees
    with the strong one of a wide angle, a fisheye 130 degrees.
    """
    draw = np.random.default_rng(seed)
    left, right = (_random_camera(size, lens, draw) for _ in range(2))
    turn = draw.normal(0, np.radians(1.0), 3)
    t = [-baseline_m, *draw.normal(0, 0.002, 2)]
    return StereoCalibration(left, right, Pose.from_values(np.array([*turn, *t])))


def _random_camera(size: tuple[int, int], lens: LensName, draw: np.random.Generator) -> Camera:
    width, _ = size
    f = width * FOCAL_SHARE[lens] * draw.uniform(0.95, 1.05)
    cx, cy = np.array(size) / 2 + draw.uniform(-0.02, 0.02, 2) * width
    K = np.array([[f, 0, cx], [0, f * draw.uniform(0.995, 1.005), cy], [0, 0, 1]])
    model, _ = LENSES[lens]
    return Camera(size, K, np.array(_coefficients(lens, draw)), model)


def _coefficients(lens: LensName, draw: np.random.Generator) -> list[float]:
    """Return coefficients of a lens in OpenCV's order; those of high order are 0."""
    if lens == "fisheye":
        return [draw.uniform(-0.03, 0.03), draw.uniform(-0.01, 0.01), 0.0, 0.0]
    if lens == "pinhole":
        return [draw.uniform(-0.3, -0.1), draw.uniform(0, 0.1), *draw.normal(0, 5e-4, 2), 0.0]
    above, below = draw.uniform(0.1, 0.2), draw.uniform(0.4, 0.6)  # above > below / 9: never back
    return [above, 0.0, *draw.normal(0, 5e-4, 2), 0.0, below, 0.0, 0.0]


def random_poses(
    board: Board, rig: StereoCalibration, count: int, *, seed: int, tilt_deg: float = 40.0
) -> list[Pose]:
    """Return poses of a board before the left camera in which both cameras see all of it.

    Args:
        board: of about any size.
        rig: that looks at it.
        count: how many.
        seed: of the draws.
        tilt_deg: the largest angle between the board and a plane across the line of sight; most are
            over a third of it.
    """
    poses = _poses_before(rig.left, board, np.random.default_rng(seed), tilt_deg)
    both = (pose for pose in poses if _sees_all(rig.right, board, rig.right_from_left @ pose))
    return list(islice(both, count))


def poses_for_one(
    board: Board, rig: StereoCalibration, count: int, *, seed: int, tilt_deg: float = 40.0
) -> list[Pose]:
    """Do the same with poses in which the left or the right camera, in turn, sees all of the board.

    What is near the outer border of one view is outside the other, so that no pair shows it.
    """
    draw, left_from_right = np.random.default_rng(seed), rig.right_from_left.inverse()
    at_left = _poses_before(rig.left, board, draw, tilt_deg)
    at_right = (left_from_right @ pose for pose in _poses_before(rig.right, board, draw, tilt_deg))
    return [next(poses) for poses in islice(cycle((at_left, at_right)), count)]


def _poses_before(
    camera: Camera, board: Board, draw: np.random.Generator, tilt_deg: float
) -> Iterator[Pose]:
    """Draw poses of a board before a camera that sees all of it, anywhere in the image."""
    size, middle = np.array(camera.size), board.points.mean(0)
    span = float(np.ptp(board.points, axis=0).max())
    while True:
        ray = camera.unproject(draw.uniform(0.1 * size, 0.9 * size)[None])[0]
        ray /= np.linalg.norm(ray)
        distance = span * camera.K[0, 0] / size[0] * draw.uniform(1.2, 2.4)
        around, tilt = draw.uniform(0, 2 * np.pi), np.radians(tilt_deg) * draw.uniform(0.3, 1.0)
        tilted = _turn(tilt * np.array([np.cos(around), np.sin(around), 0]))
        R = _facing(ray) @ tilted @ _turn(np.array([0, 0, draw.normal(0, 0.2)]))
        pose = Pose(R, distance * ray - R @ middle)
        if _sees_all(camera, board, pose):
            yield pose


def _facing(ray: Array) -> Array:
    """Return the smallest rotation (3, 3) that turns the axis of a camera into a ray (3,)."""
    axis = np.array([-ray[1], ray[0], 0.0])
    return _turn(axis * np.arccos(ray[2]) / max(float(np.linalg.norm(axis)), 1e-12))


def _turn(vector: Array) -> Array:
    R, _ = cv2.Rodrigues(vector[:, None])
    return np.asarray(R, np.float64)


def _sees_all(camera: Camera, board: Board, pose: Pose) -> bool:
    """Return whether a camera sees all points of a board, and as far again around them."""
    spacing = float(np.linalg.norm(board.points[1] - board.points[0]))
    (left, top, _), (right, bottom, _) = (
        board.points.min(0) - spacing,
        board.points.max(0) + spacing,
    )
    around = [[x, y, 0] for x in (left, right) for y in (top, bottom)]
    outline = pose.apply(np.concatenate([board.points, around]))
    return bool(_inside(camera, camera.project(outline), MARGIN_PX).all())


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
    return _exposed(camera, _seen(picture, to_pixels, camera, pose, ROOM), noise, seed)


def photograph_room(
    rig: StereoCalibration, *, noise: float = SENSOR_NOISE, seed: int = 0
) -> StereoPair:
    """Return photographs of a wall that fills both views and of a slanted poster before it.

    Args:
        rig: whose wide angles may reach 150 degrees.
        noise: standard deviation, of 255.
        seed: of the textures and the noise.
    """
    draw = np.random.default_rng(seed)
    wall = Pose(_turn(np.array([0.15, 0.1, 0.0])), np.array([0.0, 0.0, 25 * rig.baseline_m]))
    poster = Pose(_turn(np.array([-0.2, 0.5, 0.1])), np.array([0.0, 0.0, 10 * rig.baseline_m]))
    widths = 200 * rig.baseline_m, 12 * rig.baseline_m
    textures = [_texture(draw) for _ in widths]
    views: list[Image] = []
    for camera, pose in ((rig.left, Pose.identity()), (rig.right, rig.right_from_left)):
        far, near = (
            _seen(texture, _middle_of(texture, width), camera, pose @ place, np.nan)
            for texture, width, place in zip(textures, widths, (wall, poster), strict=True)
        )
        room = np.where(np.isnan(near), np.nan_to_num(far, nan=ROOM), near)
        views.append(_exposed(camera, room.astype(np.float32), noise, 2 * seed + len(views)))
    return StereoPair(views[0], views[1], rig)


def _texture(draw: np.random.Generator) -> npt.NDArray[np.float32]:
    """Return a square picture with detail of every size."""
    total = np.zeros((TEXTURE_PX, TEXTURE_PX), np.float32)
    for cells in (16, 64, 256, 1024):
        values = draw.uniform(DARK, BRIGHT, (cells, cells)).astype(np.float32)
        total += cv2.resize(values, total.shape, interpolation=cv2.INTER_CUBIC) / 4
    stretched = ROOM + 2 * (total - total.mean())
    return np.asarray(stretched.clip(0, 255), np.float32)


def _middle_of(picture: npt.NDArray[np.float32], width_m: float) -> Array:
    """Return (3, 3) from metres about the middle of a square picture to its pixels."""
    scale, middle = picture.shape[0] / width_m, (picture.shape[0] - 1) / 2
    return np.array([[scale, 0, middle], [0, scale, middle], [0, 0, 1]])


def _seen(
    picture: npt.NDArray[np.float32], to_pixels: Array, camera: Camera, pose: Pose, around: float
) -> npt.NDArray[np.float32]:
    """Return what a camera sees of a flat picture, `FINE` samples a pixel each way."""
    rays, (width, height) = _rays(camera)
    to_picture = to_pixels @ np.linalg.inv(np.column_stack([pose.R[:, :2], pose.t]))
    places = rays @ to_picture.T.astype(
        np.float32
    )  # times the distance, which is positive in front
    with np.errstate(all="ignore"):
        places = places[:, :2] / np.where(places[:, 2:] > 0, places[:, 2:], np.nan)
    places = np.nan_to_num(places, nan=-FURTHEST).clip(-FURTHEST, FURTHEST)
    x, y = np.ascontiguousarray(places.reshape(height, width, 2).transpose(2, 0, 1))
    return np.asarray(cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderValue=around), np.float32)


def _exposed(camera: Camera, seen: npt.NDArray[np.float32], noise: float, seed: int) -> Image:
    """Return (H, W, 3) uint8 of what a camera sees, with the blur of a lens and noise."""
    small = cv2.resize(seen, camera.size, interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), LENS_BLUR_PX)
    noisy = np.asarray(small) + np.random.default_rng(seed).normal(0, noise, small.shape)
    return np.repeat(noisy.clip(0, 255).round().astype(np.uint8)[..., None], 3, axis=2)


@lru_cache(maxsize=8)
def _rays(camera: Camera) -> tuple[npt.NDArray[np.float32], tuple[int, int]]:
    """Return the rays of the parts of all pixels, row by row, and how many parts there are."""
    fine = camera.resized((camera.size[0] * FINE, camera.size[1] * FINE))
    y, x = np.mgrid[: fine.size[1], : fine.size[0]].reshape(2, -1).astype(np.float64)
    return fine.unproject(np.column_stack([x, y])).astype(np.float32), fine.size
