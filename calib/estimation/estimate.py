"""From the corners of a board in many views to a rig, with what had to be left out and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from calib.boards import Board
from calib.camera import LensName
from calib.estimation.adjustment import Adjusted, Array, Bundle, Sighting, adjust, rms
from calib.estimation.agreement import BoardView, first_rig, turned_alike
from calib.estimation.one_camera import FEWEST_VIEWS, CameraFit, fit_camera, not_worse
from calib.pose import Pose
from calib.rig import StereoCalibration

__all__ = ["LeftOut", "RigEstimate", "estimate_rig"]

FEWEST_CORNERS = 6
OUTLIER_SIGMAS, TOLERATED_PX = 5.0, 0.1
SIGMA_OF_MEDIAN = 1.4826  # of the absolute value of a normal variable
PASSES = 6
SIDES = ("left", "right")


@dataclass(frozen=True)
class LeftOut:
    """A view that takes no part, and why."""

    name: str
    reason: str


@dataclass(frozen=True, eq=False)
class RigEstimate:
    """A rig, and everything needed to judge it.

    Attributes:
        calibration: the rig.
        adjusted: the least squares behind it.
        board: what was photographed.
        names: of the views that take part, in the order of their poses.
        sightings: what the adjustment saw, in the order of its residuals.
        left_out: the views that take no part.
        corners_left_out: single corners that lie more than five deviations off.
        camera_rms_px: of the left and the right camera when each is fitted alone.
    """

    calibration: StereoCalibration
    adjusted: Adjusted
    board: Board
    names: tuple[str, ...]
    sightings: tuple[Sighting, ...]
    left_out: tuple[LeftOut, ...]
    corners_left_out: int
    camera_rms_px: tuple[float, float]

    @property
    def board_poses(self) -> tuple[Pose, ...]:
        """Where the board was before the left camera, in each view."""
        return tuple(Pose.from_values(values) for values in self.adjusted.bundle.boards)

    def errors(self, camera: int | None = None, view: int | None = None) -> list[Array]:
        """Return residuals (n, 2) of one camera or both, of one view or all."""
        return [
            residual
            for sighting, residual in zip(self.sightings, self.adjusted.residuals, strict=True)
            if camera in (None, sighting.camera) and view in (None, sighting.view)
        ]


def estimate_rig(
    board: Board, views: Sequence[BoardView], size: tuple[int, int], lens: LensName = "pinhole"
) -> RigEstimate:
    """Estimate both cameras and the rig.

    Each camera is fitted alone first; the pose of the right camera is the one that most views
    agree on; then everything is adjusted at once, without the views and corners that do not fit.

    Args:
        board: what was photographed.
        views: pairs, of which some may show it to one camera only.
        size: (width, height) of the photographs.
        lens: model of both lenses.

    Raises:
        ValueError: if the views do not determine the rig; the message says why and what to do.
    """
    usable, left_out = _usable([turned_alike(board, view) for view in views])
    fits = [
        fit_camera(board, [getattr(view, side) for view in usable], size, lens, side)
        for side in SIDES
    ]
    start, agree = first_rig(board, usable, fits, size)
    left_out += [
        LeftOut(view.name, reason) for view, reason in zip(usable, agree, strict=True) if reason
    ]
    kept = [index for index, reason in enumerate(agree) if not reason]
    sightings = [
        Sighting(place, side, board.points[corners.ids], corners.pixels)
        for place, index in enumerate(kept)
        for side, corners in enumerate((usable[index].left, usable[index].right))
        if corners is not None and np.isfinite(fits[side].errors[index])
    ]
    boards = np.array([_board_pose(fits, start, index) for index in kept])
    cameras = (fits[0].camera, fits[1].camera)
    names = [usable[index].name for index in kept]
    return _adjusted_together(
        board, Bundle(cameras, start, boards), sightings, names, left_out, fits
    )


def _usable(views: Sequence[BoardView]) -> tuple[list[BoardView], list[LeftOut]]:
    """Return the views in which at least one camera saw enough, and the others."""
    usable, left_out = [], []
    for view in views:
        left, right = (
            corners if corners is not None and len(corners) >= FEWEST_CORNERS else None
            for corners in (view.left, view.right)
        )
        if left is None and right is None:
            left_out.append(LeftOut(view.name, "no board was found in either photograph"))
            continue
        usable.append(replace(view, left=left, right=right))
    both = sum(view.left is not None and view.right is not None for view in usable)
    if both < FEWEST_VIEWS:
        raise ValueError(
            f"the board was found in both photographs of {both} of {len(views)} pairs; at least "
            f"{FEWEST_VIEWS} are needed, 15 to 30 are good"
        )
    return usable, left_out


def _board_pose(fits: Sequence[CameraFit], rig: Array, index: int) -> Array:
    """Return the pose (6,) of the board before the left camera, from whichever saw it."""
    left, right = fits
    if np.isfinite(left.errors[index]):
        pose: Array = left.poses[index]
        return pose
    return (Pose.from_values(rig).inverse() @ Pose.from_values(right.poses[index])).values


def _adjusted_together(
    board: Board,
    bundle: Bundle,
    sightings: list[Sighting],
    names: list[str],
    left_out: list[LeftOut],
    fits: Sequence[CameraFit],
) -> RigEstimate:
    """Adjust everything at once, again and again without what does not fit."""
    corners_left_out = 0
    for _ in range(PASSES):
        adjusted = adjust(bundle, sightings)
        bundle = adjusted.bundle
        errors = np.array([_view_rms(adjusted, sightings, view) for view in range(len(names))])
        fine = not_worse(errors)
        if fine.sum() >= FEWEST_VIEWS and not fine.all():
            left_out += [
                LeftOut(name, _too_far(error, errors))
                for name, error, ok in zip(names, errors, fine, strict=True)
                if not ok
            ]
            bundle, sightings = _without(bundle, sightings, fine)
            names = [name for name, ok in zip(names, fine, strict=True) if ok]
            continue
        fewer, dropped = _without_outliers(sightings, adjusted)
        if not dropped:
            break
        sightings, corners_left_out = fewer, corners_left_out + dropped
    else:
        adjusted = adjust(bundle, sightings)
    left, right = adjusted.bundle.cameras
    rig = Pose.from_values(adjusted.bundle.rig)
    return RigEstimate(
        StereoCalibration(left, right, rig),
        adjusted,
        board,
        tuple(names),
        tuple(sightings),
        tuple(left_out),
        corners_left_out,
        (fits[0].rms_px, fits[1].rms_px),
    )


def _view_rms(adjusted: Adjusted, sightings: Sequence[Sighting], view: int) -> float:
    parts = zip(sightings, adjusted.residuals, strict=True)
    return rms([residual for sighting, residual in parts if sighting.view == view])


def _too_far(error: float, errors: Array) -> str:
    return (
        f"its corners lie {error:.2f} px off (RMS), those of the others "
        f"{np.median(errors):.2f} px; blurred, moved between the photographs, or the board bent?"
    )


def _without(
    bundle: Bundle, sightings: Sequence[Sighting], fine: npt.NDArray[np.bool_]
) -> tuple[Bundle, list[Sighting]]:
    """Return bundle and sightings without the views that are not fine."""
    place = np.cumsum(fine) - 1
    kept = [replace(s, view=int(place[s.view])) for s in sightings if fine[s.view]]
    return replace(bundle, boards=bundle.boards[fine]), kept


def _without_outliers(
    sightings: Sequence[Sighting], adjusted: Adjusted
) -> tuple[list[Sighting], int]:
    """Return the sightings without corners that are far off, and how many those were."""
    together = np.concatenate([residual.ravel() for residual in adjusted.residuals])
    sigma = SIGMA_OF_MEDIAN * float(np.median(np.abs(together)))
    kept, dropped = [], 0
    for sighting, residual in zip(sightings, adjusted.residuals, strict=True):
        fine = np.abs(residual).max(1) <= max(OUTLIER_SIGMAS * sigma, TOLERATED_PX)
        if fine.sum() < FEWEST_CORNERS:
            fine[:] = True
        dropped += int((~fine).sum())
        kept.append(replace(sighting, points=sighting.points[fine], pixels=sighting.pixels[fine]))
    return kept, dropped
