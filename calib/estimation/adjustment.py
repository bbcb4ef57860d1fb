"""Bundle adjustment: cameras, their rig and the poses of a board, all at once.

The parameters are the two cameras, the pose of the right one and one pose of the board a view; what
is minimised is the sum of the squared distances between the corners that were found and their
projections. It is what `cv2.stereoCalibrate` minimises, but for every lens model alike, with
corners that one camera alone saw, and with the covariance of the result, which OpenCV does not say.

Source: Triggs, McLauchlan, Hartley & Fitzgibbon, Bundle Adjustment - A Modern Synthesis, 2000
(the Schur complement, section 6; the covariance, section 10); Levenberg and Marquardt's steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from calib.camera import Camera

__all__ = ["Adjusted", "Bundle", "Sighting", "adjust", "pose_of_board"]

Array = npt.NDArray[np.float64]

FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e-12, 1e10
MOST_STEPS = 60
CONVERGED = 1e-10  # relative fall of the sum of squares
LENS, POSE = 4, 6  # fx fy cx cy, then the coefficients; rotation vector and translation
RATIONAL = (0, 1, 4, 5, 6, 7)
"""Places of k1 to k6 among eight coefficients."""
RATIONAL_WEIGHT_PX = 0.3
"""Of each of them in the sum of squares, so that 1 counts like a corner that is so far off."""


@dataclass(frozen=True, eq=False)
class Sighting:
    """What one camera saw of the board in one view.

    Attributes:
        view: index of the pose of the board.
        camera: 0 is left, 1 is right.
        points: (n, 3) on the board, metres.
        pixels: (n, 2) where they were found.
    """

    view: int
    camera: int
    points: Array
    pixels: Array


@dataclass(frozen=True, eq=False)
class Bundle:
    """Everything that is estimated.

    Attributes:
        cameras: one or two.
        rig: (6,) rotation vector and translation from the left to the right camera frame; zeros
            and without meaning for one camera.
        boards: (V, 6) of each view, from the board to the left camera frame.
    """

    cameras: tuple[Camera, ...]
    rig: Array
    boards: Array


@dataclass(frozen=True, eq=False)
class Adjusted:
    """The least squares, and how sure they are.

    Attributes:
        bundle: the best values.
        residuals: of each sighting (n, 2), projected minus found, in pixels.
        sigma_px: standard deviation of a coordinate of a corner, from the residuals and the degrees
            of freedom that are left.
        covariance: (G, G) of the cameras, left then right, each fx fy cx cy and the coefficients,
            then, for two cameras, of the rig (6).
    """

    bundle: Bundle
    residuals: tuple[Array, ...]
    sigma_px: float
    covariance: Array

    @property
    def rms_px(self) -> float:
        """Root of the mean squared distance, as OpenCV states it."""
        return rms(self.residuals)


def rms(residuals: Sequence[Array]) -> float:
    """Return the root of the mean squared length of residuals (n, 2)."""
    squares = [float((part**2).sum()) for part in residuals]
    return float(np.sqrt(sum(squares) / max(1, sum(len(part) for part in residuals))))


def adjust(start: Bundle, sightings: Sequence[Sighting]) -> Adjusted:
    """Return the bundle for which projections and corners agree best.

    Args:
        start: near enough: poses within some degrees, focal lengths within a third.
        sightings: of every view at least one.

    Raises:
        ValueError: if it does not converge, or the views do not determine all parameters.
    """
    bundle, damping = start, FIRST_DAMPING
    system = _System.at(bundle, sightings)
    for _ in range(MOST_STEPS):
        moved = _moved(bundle, *system.step(damping))
        tried = _System.at(moved, sightings) if moved is not None else None
        if tried is None or not tried.squares < system.squares:
            damping *= 10
            if damping > MOST_DAMPING:
                break
            continue
        assert moved is not None
        gain = 1 - tried.squares / system.squares if system.squares > 0 else 0.0
        bundle, system, damping = moved, tried, max(LEAST_DAMPING, damping / 10)
        if gain < CONVERGED:
            break
    return _judged(bundle, system)


def pose_of_board(camera: Camera, points: Array, pixels: Array) -> tuple[Array, float]:
    """Return the pose (6,) of a board before a camera, and the RMS error in pixels.

    Args:
        camera: with a lens that is about right.
        points: (n, 3) on the board.
        pixels: (n, 2) where they were found.
    """
    rays = camera.unproject(pixels)
    seen = np.isfinite(rays).all(1)
    if seen.sum() < LENS:
        return np.zeros(POSE), float("inf")
    try:
        found, turn, t = cv2.solvePnP(
            points[seen], np.ascontiguousarray(rays[seen, :2]), np.eye(3), np.zeros(0)
        )
    except cv2.error:  # points on a line
        return np.zeros(POSE), float("inf")
    if not found or not t[2] > 0:
        return np.zeros(POSE), float("inf")
    pose = np.concatenate([turn.ravel(), t.ravel()]).astype(np.float64)
    projected, _ = _projected(camera, pose, points)
    return pose, rms([projected - pixels])


@dataclass(frozen=True, eq=False)
class _System:
    """The normal equations, in blocks: what all views share, each view, and what joins them.

    Attributes:
        squares: the sum of squared residuals, and what the lens adds; see `_restraint`.
        residuals: of each sighting.
        shared: (G, G) and its gradient (G,).
        own: (V, 6, 6) and gradients (V, 6).
        joint: (V, G, 6).
    """

    squares: float
    residuals: tuple[Array, ...]
    shared: tuple[Array, Array]
    own: tuple[Array, Array]
    joint: Array

    @classmethod
    def at(cls, bundle: Bundle, sightings: Sequence[Sighting]) -> _System:
        """Linearise at a bundle."""
        views, starts, count = len(bundle.boards), _starts(bundle), _shared_count(bundle)
        shared, shared_gradient = np.zeros((count, count)), np.zeros(count)
        own, own_gradient = np.zeros((views, POSE, POSE)), np.zeros((views, POSE))
        joint = np.zeros((views, count, POSE))
        residuals = []
        for sighting in sightings:
            view = sighting.view
            seen, to_shared, to_own = _linearised(bundle, sighting, starts, count)
            residual = seen - sighting.pixels
            flat = residual.reshape(-1)
            residuals.append(residual)
            shared += to_shared.T @ to_shared
            shared_gradient += to_shared.T @ flat
            own[view] += to_own.T @ to_own
            own_gradient[view] += to_own.T @ flat
            joint[view] += to_shared.T @ to_own
        weights, values = _restraint(bundle, count)
        shared += np.diag(weights)
        shared_gradient += weights * values
        squares = float(sum((part**2).sum() for part in residuals) + weights @ values**2)
        squares = squares if np.isfinite(squares) else float("inf")
        return cls(
            squares,
            tuple(residuals),
            (shared, shared_gradient),
            (own, own_gradient),
            joint,
        )

    def step(self, damping: float) -> tuple[Array, Array]:
        """Return the changes of the shared parameters (G,) and of each view's (V, 6)."""
        (shared, shared_gradient), (own, own_gradient) = self.shared, self.own
        own = own + damping * _diagonals(own)
        shared = shared + damping * np.diag(np.diag(shared))
        inverse = np.linalg.pinv(own, hermitian=True)
        reduced = shared - np.einsum("vgi,vij,vhj->gh", self.joint, inverse, self.joint)
        right = shared_gradient - np.einsum("vgi,vij,vj->g", self.joint, inverse, own_gradient)
        change = -_solved(reduced, right)
        rest = own_gradient + np.einsum("vgi,g->vi", self.joint, change)
        return change, -np.einsum("vij,vj->vi", inverse, rest)

    def covariance(self) -> Array:
        """Return the inverse of what is left of the shared block, (G, G), for a sigma of 1."""
        inverse = np.linalg.pinv(self.own[0], hermitian=True)
        reduced = self.shared[0] - np.einsum("vgi,vij,vhj->gh", self.joint, inverse, self.joint)
        scale = 1 / np.sqrt(np.diag(self.shared[0]).clip(1e-300))
        scaled = np.linalg.pinv(reduced * scale * scale[:, None], rcond=1e-14, hermitian=True)
        covariance: Array = scaled * scale * scale[:, None]
        return covariance


def _restraint(bundle: Bundle, count: int) -> tuple[Array, Array]:
    """Return what holds the shared parameters near 0, weights (G,), and their values (G,).

    Numerator and denominator of a rational lens nearly cancel: many values bend the part of the
    image alike where corners are, and turn back beyond it. Of these the smallest are taken.
    """
    weights, values = np.zeros(count), np.zeros(count)
    for camera, start in zip(bundle.cameras, _starts(bundle), strict=False):
        if len(camera.distortion) != len(RATIONAL) + 2:
            continue
        places = start + LENS + np.array(RATIONAL)
        weights[places] = RATIONAL_WEIGHT_PX**2
        values[places] = camera.distortion[list(RATIONAL)]
    return weights, values


def _judged(bundle: Bundle, system: _System) -> Adjusted:
    coordinates = sum(part.size for part in system.residuals)
    freedom = coordinates - _shared_count(bundle) - bundle.boards.size
    if freedom <= 0:
        raise ValueError(
            f"{coordinates // 2} corners do not determine the cameras; take more photographs"
        )
    variance = sum(float((part**2).sum()) for part in system.residuals) / freedom
    return Adjusted(
        bundle, system.residuals, float(np.sqrt(variance)), variance * system.covariance()
    )


def _linearised(
    bundle: Bundle, sighting: Sighting, starts: tuple[int, ...], count: int
) -> tuple[Array, Array, Array]:
    """Return projections (n, 2) and their derivatives (2n, G) and (2n, 6)."""
    board, side = bundle.boards[sighting.view], sighting.camera
    camera = bundle.cameras[side]
    if side == 0:
        pose, by_board, by_rig = board, np.eye(POSE), None
    else:
        pose, by_board, by_rig = _composed(board, bundle.rig)
    seen, jacobian = _projected(camera, pose, sighting.points)
    by_pose, by_lens = jacobian[:, :POSE], jacobian[:, POSE:]
    to_shared = np.zeros((len(jacobian), count))
    to_shared[:, starts[side] : starts[side] + by_lens.shape[1]] = by_lens
    if by_rig is not None:
        to_shared[:, -POSE:] = by_pose @ by_rig
    return seen, to_shared, by_pose @ by_board


def _projected(camera: Camera, pose: Array, points: Array) -> tuple[Array, Array]:
    """Return pixels (n, 2) and (2n, 6 + 4 + coefficients), by pose, fx fy cx cy and lens."""
    turn, t, source = pose[:3, None], pose[3:, None], points[:, None]
    if camera.model == "fisheye":
        seen, jacobian = cv2.fisheye.projectPoints(source, turn, t, camera.K, camera.distortion)
        order = [*range(8, 14), *range(8)]  # OpenCV: f c k, then rotation, translation, skew
    else:
        lens = camera.distortion
        seen, jacobian = cv2.projectPoints(source, turn, t, camera.K, lens)
        order = list(range(POSE + LENS + len(lens)))
    return np.asarray(seen, np.float64).reshape(-1, 2), np.asarray(jacobian, np.float64)[:, order]


def _composed(board: Array, rig: Array) -> tuple[Array, Array, Array]:
    """Return the pose (6,) of a board before the right camera; its derivatives by both (6, 6)."""
    parts = cv2.composeRT(board[:3, None], board[3:, None], rig[:3, None], rig[3:, None])
    turn, t, *derivatives = (np.asarray(part, np.float64) for part in parts)
    turn_1, turn_t1, turn_2, turn_t2, t_1, t_t1, t_2, t_t2 = derivatives
    by_board = np.block([[turn_1, turn_t1], [t_1, t_t1]])
    by_rig = np.block([[turn_2, turn_t2], [t_2, t_t2]])
    return np.concatenate([turn.ravel(), t.ravel()]), by_board, by_rig


def _moved(bundle: Bundle, shared: Array, own: Array) -> Bundle | None:
    """Return the bundle after a step; None if no such camera can be."""
    starts, cameras = _starts(bundle), []
    for camera, start in zip(bundle.cameras, starts, strict=False):
        change = shared[start : start + LENS + len(camera.distortion)]
        K = camera.K.copy()
        K[[0, 1, 0, 1], [0, 1, 2, 2]] += change[:LENS]
        try:
            cameras.append(replace(camera, K=K, distortion=camera.distortion + change[LENS:]))
        except ValueError:
            return None
    rig = bundle.rig + shared[-POSE:] if len(cameras) > 1 else bundle.rig
    return Bundle(tuple(cameras), rig, bundle.boards + own)


def _starts(bundle: Bundle) -> tuple[int, ...]:
    """Return where the parameters of each camera begin, and where the last of them end."""
    lengths = [LENS + len(camera.distortion) for camera in bundle.cameras]
    return tuple(int(sum(lengths[:index])) for index in range(len(lengths) + 1))


def _shared_count(bundle: Bundle) -> int:
    return _starts(bundle)[-1] + (POSE if len(bundle.cameras) > 1 else 0)


def _diagonals(blocks: Array) -> Array:
    """Return blocks (V, 6, 6) with nothing but their diagonals."""
    diagonals: Array = blocks * np.eye(blocks.shape[-1])
    return diagonals


def _solved(matrix: Array, right: Array) -> Array:
    """Solve for a scaled matrix: focal lengths and coefficients differ by a million."""
    scale = 1 / np.sqrt(np.diag(matrix).clip(1e-300))
    scaled = np.linalg.lstsq(matrix * scale * scale[:, None], right * scale, rcond=None)[0]
    solution: Array = scaled * scale
    return solution
