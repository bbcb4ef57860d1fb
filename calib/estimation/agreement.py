"""Where the right camera stands, as most views agree; and why, if they do not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.boards import Board, Corners
from calib.camera import Camera
from calib.estimation.adjustment import Array, rms
from calib.estimation.one_camera import FEWEST_VIEWS, CameraFit, fit_camera, lens_of
from calib.pose import Pose

__all__ = ["BoardView", "first_rig", "turned_alike"]

SAME_PLACE = 0.01  # of the diagonal of the image
SHIFTS = (1, -1, 2, -2, 3, -3)
"""By how many photographs one side may lag behind the other."""


@dataclass(frozen=True, eq=False)
class BoardView:
    """What a pair of photographs shows of the board.

    Attributes:
        name: of the pair, for people.
        left: corners in the left photograph; None if the board was not found there.
        right: likewise.
    """

    name: str
    left: Corners | None
    right: Corners | None


def turned_alike(board: Board, view: BoardView) -> BoardView:
    """Return the view with the corners of both photographs in the same order.

    Of a board that looks the same after half a turn, detectors may begin at either end. The
    cameras of a rig stand upright or lie together, so its rows must run the same way in both.
    """
    if not board.turns_into_itself or view.left is None or view.right is None:
        return view
    if len(view.left) != len(board.points) or len(view.right) != len(board.points):
        return view
    runs = [corners.pixels[-1] - corners.pixels[0] for corners in (view.left, view.right)]
    if runs[0] @ runs[1] >= 0:
        return view
    return replace(view, right=Corners(view.right.ids, view.right.pixels[::-1]))


def first_rig(
    board: Board, views: Sequence[BoardView], fits: Sequence[CameraFit], size: tuple[int, int]
) -> tuple[Array, list[str]]:
    """Return the pose (6,) of the right camera that most views agree on, and why others do not.

    A view that one camera alone saw agrees.
    """
    both = [
        index
        for index, view in enumerate(views)
        if view.left is not None
        and view.right is not None
        and all(np.isfinite(fit.errors[index]) for fit in fits)
    ]
    if len(both) < FEWEST_VIEWS:
        raise ValueError(
            f"only {len(both)} pairs fit both cameras; at least {FEWEST_VIEWS} are needed"
        )
    errors = disagreement(board, fits[1].camera, *_poses(fits, both), _seen_at_right(views, both))
    limit = SAME_PLACE * float(np.hypot(*size))
    votes = (errors < limit).sum(1)
    chosen = int(np.lexsort((np.median(errors, axis=1), -votes))[0])
    if votes[chosen] <= max(FEWEST_VIEWS - 1, len(both) // 2):
        raise ValueError(_why_nothing_fits(board, views, fits, both, limit))
    left, right = (fit.poses[both[chosen]] for fit in fits)
    reasons = [""] * len(views)
    for place, index in enumerate(both):
        if not errors[chosen, place] < limit:
            reasons[index] = (
                f"the right camera saw the board {errors[chosen, place]:.0f} px from where the "
                "other pairs put it; did board or rig move between the two photographs, or are "
                "they of different moments?"
            )
    for index, view in enumerate(views):
        wanted = [fit for fit, there in zip(fits, (view.left, view.right), strict=True) if there]
        if not reasons[index] and not any(np.isfinite(fit.errors[index]) for fit in wanted):
            reasons[index] = "its corners do not lie where a flat board can be; blurred, or bent?"
    return between(left, right), reasons


def disagreement(
    board: Board,
    camera: Camera,
    left: Array,
    right: Array,
    seen: Sequence[Corners],
) -> Array:
    """Return (V, V): how far off (RMS, px) view j is if view i tells where the right camera stands.

    Args:
        board: that all views show.
        camera: the right one.
        left: (V, 6) poses of the board before the left camera.
        right: (V, 6) before the right camera.
        seen: of each view, what the right camera saw.
    """
    errors = np.full((len(left), len(left)), np.inf)
    before_left = [
        (Pose.from_values(pose).apply(board.points[corners.ids]), corners.pixels)
        for pose, corners in zip(left, seen, strict=True)
    ]
    for i, (ours, theirs) in enumerate(zip(left, right, strict=True)):
        rig = Pose.from_values(between(ours, theirs))
        for j, (points, pixels) in enumerate(before_left):
            error = rms([camera.project(rig.apply(points)) - pixels])
            errors[i, j] = error if np.isfinite(error) else np.inf
    return errors


def _why_nothing_fits(
    board: Board,
    views: Sequence[BoardView],
    fits: Sequence[CameraFit],
    both: Sequence[int],
    limit: float,
) -> str:
    """Return the likely cause when the cameras fit alone but the pairs do not."""
    left, right = _poses(fits, both)
    seen = _seen_at_right(views, both)
    count = len(both)
    for shift in SHIFTS:
        ours, theirs = (
            left[max(0, -shift) : count - max(0, shift)],
            right[max(0, shift) : count - max(0, -shift)],
        )
        moved = seen[max(0, shift) : count - max(0, -shift)]
        if len(ours) < FEWEST_VIEWS:
            continue
        votes = (disagreement(board, fits[1].camera, ours, theirs, moved) < limit).sum(1).max()
        if votes > max(FEWEST_VIEWS - 1, len(ours) // 2):
            first, other = both[max(0, -shift)], both[max(0, shift)]
            return (
                "the photographs are paired wrongly: the left one of "
                f"{views[first].name} fits the right one of {views[other].name}, and so on; "
                "is a photograph missing?"
            )
    if _fits_mirrored(board, views, fits, both, limit):
        return (
            "the pairs fit only if the photographs of one camera are mirrored; "
            "turn the mirroring of that camera off, or flip its photographs"
        )
    return (
        "each camera alone can be calibrated "
        f"({fits[0].rms_px:.2f} and {fits[1].rms_px:.2f} px), but hardly two pairs agree on where "
        "the right camera stands; were left and right photographed at different moments, or the "
        "cameras moved against each other?"
    )


def _fits_mirrored(
    board: Board,
    views: Sequence[BoardView],
    fits: Sequence[CameraFit],
    both: Sequence[int],
    limit: float,
) -> bool:
    """Return whether the pairs agree once the right photographs are mirrored."""
    camera = fits[1].camera
    other = [_mirrored(board, corners, camera.size[0]) for corners in _seen_at_right(views, both)]
    try:
        flipped = fit_camera(board, other, camera.size, lens_of(camera), "right")
    except ValueError:
        return False
    fine = np.isfinite(flipped.errors)
    if fine.sum() < FEWEST_VIEWS:
        return False
    left = fits[0].poses[np.array(both)][fine]
    kept = [corners for corners, ok in zip(other, fine, strict=True) if ok]
    errors = disagreement(board, flipped.camera, left, flipped.poses[fine], kept)
    return bool((errors < limit).sum(1).max() > len(kept) // 2)


def _mirrored(board: Board, corners: Corners, width: int) -> Corners:
    """Return the corners of the same photograph seen in a mirror."""
    points = board.points[:, :2]
    opposite = np.column_stack(
        [points[:, 0].min() + points[:, 0].max() - points[:, 0], points[:, 1]]
    )
    partner = np.linalg.norm(points[:, None] - opposite[None], axis=-1).argmin(0)
    pixels = np.column_stack([width - 1 - corners.pixels[:, 0], corners.pixels[:, 1]])
    return Corners(partner[corners.ids], pixels)


def _seen_at_right(views: Sequence[BoardView], both: Sequence[int]) -> list[Corners]:
    """Return what the right camera saw in the views that both cameras saw."""
    return [corners for index in both if (corners := views[index].right) is not None]


def _poses(fits: Sequence[CameraFit], both: Sequence[int]) -> tuple[Array, Array]:
    left, right = (fit.poses[np.array(both)] for fit in fits)
    return left, right


def between(left: Array, right: Array) -> Array:
    """Return the pose (6,) of the right camera, from where both saw a board."""
    return (Pose.from_values(right) @ Pose.from_values(left).inverse()).values
