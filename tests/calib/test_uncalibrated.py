"""Cameras estimated from what they see; the matches are made, so that the truth is known."""

import numpy as np
import pytest
from turned import as_raw, rotation, workshop

from calib import Matches, Rectifier, match_views
from calib import uncalibrated as module
from calib.uncalibrated import estimate_uncalibrated_rig, focal_px_of

SIZE = (1200, 900)
FOCAL = 1100.0
BLANK = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)


def seen(points, focal=FOCAL):
    return focal * points[:, :2] / points[:, 2:] + np.array([599.5, 449.5])


@pytest.fixture
def shows(monkeypatch, rng):
    """Let the views match where a scene would, seen from two places."""

    def make(turn, to, *, flat=False, count=500, noise_px=0.1, focal=FOCAL):
        points = rng.uniform([-3, -2, 4], [3, 2, 12], (4 * count, 3))
        if flat:
            points[:, 2] = 7 + 0.3 * points[:, 0]
        there = (points - to) @ rotation(*turn).T
        left, right = (
            p[:, :2] / np.where(p[:, 2:] > 0.5, p[:, 2:], np.nan) * focal + [599.5, 449.5]
            for p in (points, there)
        )
        both = np.hstack([left, right])
        inside = (np.abs(both - [599.5, 449.5] * 2) < [600, 450] * 2).all(axis=1)
        both = both[inside][:count] + noise_px * rng.standard_normal((min(count, inside.sum()), 4))
        monkeypatch.setattr(module, "match_views", lambda *_: Matches(both[:, :2], both[:, 2:]))

    return make


def angle(a, b):
    """Return the angle between two directions in degrees."""
    return np.degrees(np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1, 1)))


@pytest.mark.parametrize("turn", [(0, 0, 0), (0.05, -0.1, 0.08), (0, 0.25, 0)])
@pytest.mark.parametrize("to", [(1.0, 0, 0), (0.8, 0.2, 0.1)])
def test_the_place_of_the_other_camera_is_found(shows, turn, to):
    shows(turn, np.array(to))

    found = estimate_uncalibrated_rig(BLANK, BLANK, focal_px=FOCAL)

    pose = found.calibration.right_from_left
    assert np.degrees(np.abs(pose.R @ rotation(*turn).T - np.eye(3)).max()) < 0.5
    assert angle(-pose.R.T @ pose.t, np.array(to)) < 2
    assert found.calibration.baseline_m == pytest.approx(1)
    assert found.count == 500
    assert found.residual_px < 0.15
    assert found.focal_from == "given"


def test_views_in_the_same_direction_do_not_tell_the_focal_length(shows):
    shows((0, 0, 0), np.array([1.0, 0, 0]))

    found = estimate_uncalibrated_rig(BLANK, BLANK)

    assert found.focal_from == "guess"
    assert found.calibration.left.K[0, 0] == pytest.approx(focal_px_of(35, SIZE))


def test_views_in_different_directions_may_tell_it(shows):
    shows((0.25, 0.5, 0.1), np.array([3.0, 0.5, 0.4]), focal=2000.0)

    found = estimate_uncalibrated_rig(BLANK, BLANK)

    assert found.focal_from == "matches"
    assert found.calibration.left.K[0, 0] == pytest.approx(2000, rel=0.05)


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        ({"turn": (0.02, 0.1, 0.01), "to": (0, 0, 0)}, "one plane explains .* only turned and not"),
        ({"turn": (0, 0.1, 0), "to": (1, 0, 0), "flat": True}, "one plane explains 100% of 500"),
        ({"turn": (0, 0, 0), "to": (0.05, 0.02, 1)}, "moved forwards or backwards, towards"),
        ({"turn": (0, 0, 0), "to": (0.05, 0.02, -1)}, "moved forwards or backwards, towards"),
        ({"turn": (0, 0, 0), "to": (-1, 0, 0)}, "from the left of the first one; exchange them"),
        ({"turn": (0, 0, 0), "to": (0.1, 1, 0)}, "one above the other; .* turn both pictures"),
        ({"turn": (0, 0, 0), "to": (1, 0, 0), "count": 39}, "only 39 points .* 40 are needed"),
    ],
)
def test_what_tells_no_geometry_is_refused_with_the_reason(shows, scene, message):
    shows(scene.pop("turn"), np.array(scene.pop("to")), **scene)

    with pytest.raises(ValueError, match=message):
        estimate_uncalibrated_rig(BLANK, BLANK, focal_px=FOCAL)


def test_matches_of_no_one_scene_are_refused(monkeypatch, rng):
    left, right = rng.uniform(0, 900, (2, 200, 2))
    monkeypatch.setattr(module, "match_views", lambda *_: Matches(left, right))

    with pytest.raises(ValueError, match="cannot estimate the cameras: "):
        estimate_uncalibrated_rig(BLANK, BLANK, focal_px=FOCAL)


def test_photographs_are_rectified_by_it():
    turn = (0.03, 0.02, -0.04)
    pair = as_raw(workshop(), turn=turn)

    found = estimate_uncalibrated_rig(pair.left, pair.right, focal_px=workshop().geometry.focal_px)

    pose = found.calibration.right_from_left
    assert np.degrees(np.abs(pose.R @ rotation(*turn).T - np.eye(3)).max()) < 0.3
    rectified = Rectifier(found.calibration)(type(pair)(pair.left, pair.right, found.calibration))
    assert rectified.geometry.baseline_m == pytest.approx(1)
    assert np.abs(match_views(rectified.left, rectified.right).offsets).mean() < 0.2


def test_the_equivalent_in_35_mm_goes_by_the_diagonal():
    assert focal_px_of(43.2666, (3000, 4000)) == pytest.approx(5000, abs=0.1)
