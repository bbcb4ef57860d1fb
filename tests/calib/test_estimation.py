"""From corners to a rig: exact without noise, honest with it, clear where it cannot be."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from calib.boards import Corners, board_named
from calib.boards.generated import poses_for_one, random_poses, random_rig, seen_corners
from calib.camera import Camera
from calib.estimation import LENSES, BoardView, estimate_rig, judge
from calib.estimation.adjustment import Bundle, Sighting, adjust, rms
from calib.pose import Pose

BOARD = board_named("chessboard:8x6:30mm")
SIZE = (640, 480)


def views_of(rig, poses, noise_px, seed):
    """Return what both cameras see of the board in all poses."""
    views = []
    for number, pose in enumerate(poses):
        at_right = rig.right_from_left @ pose
        left = seen_corners(BOARD, rig.left, pose, noise_px=noise_px, seed=1000 * seed + 2 * number)
        right = seen_corners(
            BOARD, rig.right, at_right, noise_px=noise_px, seed=1000 * seed + 2 * number + 1
        )
        views.append(BoardView(f"{number:02d}.png", left, right))
    return views


def scene(lens="pinhole", count=10, noise_px=0.0, seed=0):
    rig = random_rig(SIZE, lens, seed=seed)
    poses = random_poses(BOARD, rig, count, seed=seed + 100)
    return rig, views_of(rig, poses, noise_px, seed)


@pytest.fixture(scope="module")
def noisy():
    return scene(noise_px=0.1, count=12)


@pytest.mark.parametrize("lens", LENSES)
def test_exact_corners_give_the_exact_rig(lens):
    rig, views = scene("fisheye" if lens == "fisheye" else "pinhole")

    estimate = estimate_rig(BOARD, views, SIZE, lens)

    found = estimate.calibration
    assert estimate.adjusted.rms_px < 1e-4
    assert np.allclose(found.right_from_left.t, rig.right_from_left.t, atol=1e-6)
    assert np.allclose(found.right_from_left.R, rig.right_from_left.R, atol=1e-5)
    for ours, theirs in ((found.left, rig.left), (found.right, rig.right)):
        assert np.allclose(ours.K, theirs.K, atol=0.02)
        assert np.allclose(
            ours.unproject(np.array([[60.0, 50.0]])),
            theirs.unproject(np.array([[60.0, 50.0]])),
            atol=1e-4,
        )
    assert not estimate.left_out
    assert estimate.corners_left_out == 0


def normalised_errors(lens, seed):
    """Return how many stated deviations focal lengths, centres and baseline are off."""
    rig, views = scene(lens, noise_px=0.2, count=12, seed=seed)
    estimate = estimate_rig(BOARD, views, SIZE, lens)
    sigma = np.sqrt(np.diag(estimate.adjusted.covariance))
    found, second = estimate.calibration, 4 + len(rig.left.distortion)
    errors = []
    for start, ours, theirs in ((0, found.left, rig.left), (second, found.right, rig.right)):
        off = ours.K[[0, 1, 0, 1], [0, 1, 2, 2]] - theirs.K[[0, 1, 0, 1], [0, 1, 2, 2]]
        errors += list(off / sigma[start : start + 4])
    sure = judge(estimate).uncertainty
    errors.append((found.baseline_m - rig.baseline_m) / sure.baseline_m)
    turn = (found.right_from_left @ rig.right_from_left.inverse()).values[:3]
    errors += list(np.degrees(turn) / sure.turn_deg)
    return errors


def test_a_rational_lens_does_not_turn_back_where_no_corner_was():
    rig, views = scene("rational", noise_px=0.1, count=12, seed=6)

    estimate = estimate_rig(BOARD, views, SIZE, "rational")

    for ours, theirs in (
        (estimate.calibration.left, rig.left),
        (estimate.calibration.right, rig.right),
    ):
        middles = np.array([[0.0, 240], [639, 240], [320, 0], [320, 479]])
        assert np.allclose(ours.unproject(middles), theirs.unproject(middles), atol=0.05)
        assert np.abs(ours.distortion).max() < 2  # numerator and denominator do not run away
    assert estimate.adjusted.rms_px == pytest.approx(0.1 * np.sqrt(2), rel=0.1)


def test_a_rig_whose_lens_turns_back_is_judged_all_the_same():
    rig, views = scene(count=12, noise_px=0.1)
    estimate = estimate_rig(BOARD, views, SIZE)
    bent = replace(rig.left, distortion=np.array([-0.6, 0.0, 0.0, 0.0, 0.0]))
    spoilt = replace(estimate, calibration=replace(estimate.calibration, left=bent))

    quality = judge(spoilt)

    assert quality.grade == "D"
    assert any("cannot be rectified" in finding.what for finding in quality.findings)


@pytest.mark.slow
@pytest.mark.parametrize("lens", LENSES)
def test_the_stated_uncertainty_is_honest(lens):
    errors = np.array([normalised_errors(lens, seed) for seed in range(20)])

    assert (np.abs(errors) < 3).mean() > 0.985
    spread = np.sqrt((errors**2).mean(0))
    assert (spread > 0.5).all()  # nor is it larger than need be
    assert (spread < 1.6).all()


def test_a_view_whose_board_moved_between_the_photographs_is_left_out(noisy):
    rig, views = noisy
    moved = replace(views[4], right=views[7].right)

    estimate = estimate_rig(BOARD, [*views[:4], moved, *views[5:]], SIZE)

    assert [view.name for view in estimate.left_out] == ["04.png"]
    assert "move" in estimate.left_out[0].reason
    assert estimate.calibration.baseline_m == pytest.approx(rig.baseline_m, rel=2e-3)


def test_a_blurred_view_is_left_out(noisy):
    rig, views = noisy
    shaken = np.random.default_rng(1).normal(0, 3, views[2].left.pixels.shape)
    bad = replace(views[2], left=Corners(views[2].left.ids, views[2].left.pixels + shaken))

    estimate = estimate_rig(BOARD, [*views[:2], bad, *views[3:]], SIZE)

    assert estimate.adjusted.rms_px < 0.2
    assert estimate.calibration.baseline_m == pytest.approx(rig.baseline_m, rel=2e-3)


def test_single_wrong_corners_are_left_out(noisy):
    _rig, views = noisy
    pixels = views[3].right.pixels.copy()
    pixels[5] += (1.5, -1.0)
    bad = replace(views[3], right=Corners(views[3].right.ids, pixels))

    estimate = estimate_rig(BOARD, [*views[:3], bad, *views[4:]], SIZE)

    assert 1 <= estimate.corners_left_out <= 3
    assert len(estimate.names) == len(views)
    assert estimate.adjusted.rms_px < 0.17


def test_a_view_of_one_camera_alone_helps_that_camera(noisy):
    _rig, views = noisy
    alone = [replace(view, right=None) for view in views[:6]]

    estimate = estimate_rig(BOARD, [*alone, *views[6:]], SIZE)

    assert len(estimate.names) == len(views)
    assert len(estimate.errors(camera=0)) == 12
    assert len(estimate.errors(camera=1)) == 6


def test_a_symmetric_board_may_be_found_from_either_end(noisy):
    _rig, views = noisy
    half = [
        replace(view, right=Corners(view.right.ids, view.right.pixels[::-1]))
        if number % 3
        else view
        for number, view in enumerate(views)
    ]

    estimate = estimate_rig(BOARD, half, SIZE)

    assert BOARD.turns_into_itself
    assert not estimate.left_out


def test_photographs_that_are_paired_wrongly_are_named(noisy):
    _, views = noisy
    late = [replace(view, right=other.right) for view, other in itertools.pairwise(views)]

    with pytest.raises(ValueError, match="paired wrongly") as refused:
        estimate_rig(BOARD, late, SIZE)

    assert "missing" in str(refused.value)


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_mirrored_camera_is_named(noisy, side):
    _, views = noisy

    def mirrored(corners):
        pixels = np.column_stack([SIZE[0] - 1 - corners.pixels[:, 0], corners.pixels[:, 1]])
        rows = pixels.reshape(6, 8, 2)[:, ::-1]  # a detector orders them as if seen from the front
        return Corners(corners.ids, rows.reshape(-1, 2))

    wrong = [replace(view, **{side: mirrored(getattr(view, side))}) for view in views]

    with pytest.raises(ValueError, match="mirrored"):
        estimate_rig(BOARD, wrong, SIZE)


def test_pairs_of_no_moment_are_named(noisy):
    _, views = noisy
    order = [5, 9, 0, 7, 2, 11, 8, 1, 10, 3, 6, 4]
    mixed = [
        replace(view, right=views[other].right) for view, other in zip(views, order, strict=True)
    ]

    with pytest.raises(ValueError, match="different moments"):
        estimate_rig(BOARD, mixed, SIZE)


def test_too_few_views_are_refused(noisy):
    _, views = noisy

    with pytest.raises(ValueError, match="at least 3"):
        estimate_rig(BOARD, views[:2], SIZE)
    with pytest.raises(ValueError, match="2 of 12 pairs"):
        estimate_rig(BOARD, [*views[:2], *[BoardView("x", None, None)] * 10], SIZE)


def test_a_board_of_another_form_is_refused(noisy):
    _, views = noisy
    other = board_named("chessboard:6x8:30mm")  # as many corners, in another order

    with pytest.raises(ValueError, match=r"6 x 8 inner corners.*counts right"):
        estimate_rig(other, views, SIZE)


def test_views_that_are_all_parallel_get_the_worst_grade_and_say_why():
    rig, middle = random_rig(SIZE, seed=0), BOARD.points.mean(0)
    tilted = random_poses(BOARD, rig, 10, seed=100)
    parallel = [Pose(np.eye(3), pose.apply(middle[None])[0] - middle) for pose in tilted]

    quality = judge(estimate_rig(BOARD, views_of(rig, parallel, 0.1, seed=0), SIZE))

    assert quality.grade == "D"
    assert any("tilt" in finding.what for finding in quality.findings)


def test_a_good_calibration_gets_a_good_grade():
    rig = random_rig(SIZE, seed=0)
    poses = random_poses(BOARD, rig, 24, seed=1) + poses_for_one(BOARD, rig, 6, seed=2)

    quality = judge(estimate_rig(BOARD, views_of(rig, poses, 0.1, seed=0), SIZE))

    assert quality.grade in "AB"
    assert quality.rms_px == pytest.approx(0.1 * np.sqrt(2), rel=0.1)
    assert quality.vertical_px[0] < 0.2
    assert quality.uncertainty.disparity_px < 1


def test_empty_parts_of_the_image_are_named():
    _rig, views = scene(noise_px=0.1, count=30)
    left_half = [
        replace(view, right=view.right.only(view.right.pixels[:, 0] < 320)) for view in views
    ]

    findings = judge(estimate_rig(BOARD, left_half, SIZE)).findings

    (coverage,) = [f for f in findings if "right image" in f.what and "corners in" in f.what]
    assert "middle right" in coverage.what
    assert "upper left" not in coverage.what
    assert "right image" in coverage.advice


def test_the_covariance_is_that_of_a_numerical_linearisation():
    _rig, views = scene(noise_px=0.2, count=5)
    estimate = estimate_rig(BOARD, views, SIZE)
    bundle, sightings = estimate.adjusted.bundle, estimate.sightings

    jacobian = numerical_jacobian(bundle, sightings)
    full = estimate.adjusted.sigma_px**2 * np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-18)

    count = len(estimate.adjusted.covariance)
    ours = np.sqrt(np.diag(estimate.adjusted.covariance))
    assert np.allclose(ours, np.sqrt(np.diag(full)[:count]), rtol=2e-2)


def numerical_jacobian(bundle, sightings):
    """Return derivatives of all residuals by cameras, rig and boards, by small differences."""
    left, right = bundle.cameras
    start = np.concatenate(
        [
            *(np.r_[c.K[0, 0], c.K[1, 1], c.K[:2, 2], c.distortion] for c in (left, right)),
            bundle.rig,
            bundle.boards.ravel(),
        ]
    )
    n = 4 + len(left.distortion)

    def residuals(values):
        cameras = []
        for _camera, part in ((left, values[:n]), (right, values[n : 2 * n])):
            K = np.array([[part[0], 0, part[2]], [0, part[1], part[3]], [0, 0, 1]])
            cameras.append(Camera(SIZE, K, part[4:]))
        rig = Pose.from_values(values[2 * n : 2 * n + 6])
        boards = values[2 * n + 6 :].reshape(-1, 6)
        parts = []
        for s in sightings:
            pose = Pose.from_values(boards[s.view])
            pose = pose if s.camera == 0 else rig @ pose
            parts.append((cameras[s.camera].project(pose.apply(s.points)) - s.pixels).ravel())
        return np.concatenate(parts)

    columns = []
    for place, value in enumerate(start):
        step = 1e-6 * max(1.0, abs(value))
        shift = np.zeros_like(start)
        shift[place] = step
        columns.append((residuals(start + shift) - residuals(start - shift)) / (2 * step))
    return np.column_stack(columns)


def test_what_nothing_determines_is_refused():
    rig, views = scene(count=3)
    sightings = [Sighting(0, 0, BOARD.points[:6], views[0].left.pixels[:6])]

    with pytest.raises(ValueError, match="do not determine"):
        adjust(Bundle((rig.left,), np.zeros(6), np.array([[0, 0, 0, 0, 0, 1.0]])), sightings)


def test_the_rms_is_that_of_distances():
    assert rms([np.array([[3.0, 4.0]]), np.array([[0.0, 0.0]])]) == pytest.approx(np.sqrt(12.5))
