"""Boards as a camera sees them, with every corner known."""

from functools import lru_cache

import cv2
import numpy as np

from calib.boards import Corners
from calib.boards.charuco import Charuco
from calib.camera import Camera
from calib.estimation import BoardView
from calib.pose import Pose
from calib.rig import StereoCalibration

FINE = 2  # samples a pixel, each way
PIXELS_A_SQUARE = 60
BRIGHT, DARK, ROOM = 225, 25, 110


def make_rig(size=(640, 480), model="pinhole", baseline_m=0.12, seed=0):
    """Return a rig with lens distortion, turned a little, as real ones are."""
    draw = np.random.default_rng(seed)
    width, height = size
    cameras = []
    for _ in range(2):
        share = {"pinhole": 0.85, "fisheye": 0.45}[model]
        f = width * share * draw.uniform(0.95, 1.05)
        K = np.array([[f, 0, width / 2], [0, f, height / 2], [0, 0, 1]])
        K[:2, 2] += draw.uniform(-0.02, 0.02, 2) * width
        K[1, 1] *= draw.uniform(0.995, 1.005)
        if model == "pinhole":
            lens = [draw.uniform(-0.3, -0.1), draw.uniform(0, 0.1), *draw.normal(0, 5e-4, 2), 0.0]
        else:
            lens = [draw.uniform(-0.03, 0.03), draw.uniform(-0.01, 0.01), 0.0, 0.0]
        cameras.append(Camera(size, K, np.array(lens), model))
    turn = draw.normal(0, np.radians(1.0), 3)
    t = np.array([-baseline_m, *draw.normal(0, 0.002, 2)])
    return StereoCalibration(*cameras, Pose.from_values(np.concatenate([turn, t])))


def board_poses(board, rig, count, seed=0, tilt_deg=40.0):
    """Return poses that fill the image, tilted every way, in front of the middle of the rig."""
    draw = np.random.default_rng(seed)
    points = board.points
    middle = points.mean(0)
    span = float(np.ptp(points, axis=0).max())
    width, height = rig.left.size
    f = rig.left.K[0, 0]
    poses = []
    while len(poses) < count:
        distance = span * f / width * draw.uniform(1.2, 2.4)
        tilt = np.radians(tilt_deg) * draw.uniform(0.1 if tilt_deg < 1 else 0.3, 1.0)
        around = draw.uniform(0, 2 * np.pi)
        turn = tilt * np.array([np.cos(around), np.sin(around), 0])
        roll = np.array([0, 0, draw.normal(0, 0.2)])
        R = (
            Pose.from_values(np.array([*turn, 0, 0, 0])).R
            @ Pose.from_values(np.array([*roll, 0, 0, 0])).R
        )
        place = np.array(
            [draw.uniform(-0.4, 0.4) * width / f, draw.uniform(-0.4, 0.4) * height / f, 1]
        )
        pose = Pose(R, place * distance - R @ middle)
        seen = [
            rig.left.project(pose.apply(points)),
            rig.right.project((rig.right_from_left @ pose).apply(points)),
        ]
        if all(inside(pixels, rig.left.size, margin=6).all() for pixels in seen):
            poses.append(pose)
    return poses


def inside(pixels, size, margin=0.0):
    """Return which pixels (n, 2) lie in an image."""
    low, high = margin, np.array(size) - 1 - margin
    return (np.isfinite(pixels) & (pixels >= low) & (pixels <= high)).all(1)


def true_corners(board, camera, pose, noise_px=0.0, draw=None):
    """Return the corners that a camera sees, where they are or a little off."""
    pixels = camera.project(pose.apply(board.points))
    kept = inside(pixels, camera.size)
    pixels = pixels[kept]
    if noise_px:
        pixels = pixels + draw.normal(0, noise_px, pixels.shape)
    return Corners(np.flatnonzero(kept), pixels)


def views_of(board, rig, poses, noise_px=0.0, seed=0):
    """Return what both cameras see of a board in all poses."""
    draw = np.random.default_rng(seed)
    views = []
    for number, pose in enumerate(poses):
        left = true_corners(board, rig.left, pose, noise_px, draw)
        right = true_corners(board, rig.right, rig.right_from_left @ pose, noise_px, draw)
        views.append(BoardView(f"{number:02d}.png", left, right))
    return views


def print_of(board):
    """Return a picture of a board and the (3, 3) matrix from metres on it to pixels."""
    if isinstance(board, Charuco):
        markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
        size = (board.columns, board.rows)
        made = cv2.aruco.CharucoBoard(size, board.square_m, board.marker_m, markers)
        pixels = (board.columns * PIXELS_A_SQUARE, board.rows * PIXELS_A_SQUARE)
        picture = made.generateImage(pixels, marginSize=0, borderBits=1)
        margin, first = PIXELS_A_SQUARE // 2, 0
    else:
        row, column = np.mgrid[: board.rows + 1, : board.columns + 1]
        dark = np.where((row + column) % 2 == 0, 0, 255).astype(np.uint8)
        picture = np.kron(dark, np.ones((PIXELS_A_SQUARE, PIXELS_A_SQUARE), np.uint8))
        margin, first = PIXELS_A_SQUARE, PIXELS_A_SQUARE  # points begin at the first inner corner
    picture = np.pad(picture, margin, constant_values=255)
    scale = PIXELS_A_SQUARE / board.square_m
    origin = margin + first - 0.5  # the corner of four pixels lies between their centres
    to_pixels = np.array([[scale, 0, origin], [0, scale, origin], [0, 0, 1]])
    picture = DARK + (BRIGHT - DARK) * (picture / 255.0)
    return picture.astype(np.float32), to_pixels


@lru_cache(maxsize=8)
def _rays(camera):
    fine = camera.resized((camera.size[0] * FINE, camera.size[1] * FINE))
    width, height = fine.size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).reshape(-1, 2)
    return fine.unproject(pixels.astype(float)), fine.size


def photograph(board, camera, pose, noise=2.0, seed=0):
    """Return (H, W, 3) uint8: a board before a camera, with the noise of a sensor."""
    picture, to_pixels = print_of(board)
    rays, (width, height) = _rays(camera)
    normal, origin = pose.R[:, 2], pose.t
    with np.errstate(all="ignore"):
        hits = rays * (normal @ origin / (rays @ normal))[:, None]
    on_board = (hits - origin) @ pose.R  # z is 0
    places = on_board[:, :2] @ to_pixels[:2, :2].T + to_pixels[:2, 2]
    places = np.nan_to_num(places, nan=-1e4).clip(-1e4, 1e4).astype(np.float32)
    x, y = places.reshape(height, width, 2).transpose(2, 0, 1)
    seen = cv2.remap(
        picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=ROOM
    )
    small = cv2.resize(seen, camera.size, interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), 0.6)
    small = small + np.random.default_rng(seed).normal(0, noise, small.shape)
    return np.repeat(small.clip(0, 255).round().astype(np.uint8)[..., None], 3, axis=2)
