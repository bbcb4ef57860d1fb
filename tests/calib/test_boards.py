"""Boards: how they are said, found, and told from others."""

import cv2
import numpy as np
import pytest

from calib.boards import BOARDS, Corners, board_named
from calib.boards.charuco import Charuco
from calib.boards.chessboard import Chessboard
from calib.boards.circles import CircleGrid
from calib.boards.diagnosis import why_not_found
from calib.boards.generated import photograph, printed, random_poses, random_rig
from calib.pose import Pose

CHESS = "chessboard:8x5:30mm"
CHARUCO = "charuco:9x6:30mm:22mm:DICT_5X5_100"
SIZE = (640, 480)


@pytest.fixture(scope="module")
def rig():
    return random_rig(SIZE, seed=3)


def test_each_kind_is_said_in_words():
    assert board_named("chessboard:9x6:25mm") == Chessboard(9, 6, 0.025)
    assert board_named("circles:7x6:2cm") == CircleGrid(7, 6, 0.02)
    assert board_named("staggered-circles:4x11:0.02m") == CircleGrid(4, 11, 0.02, staggered=True)
    wide = board_named("charuco:31x16:50mm:40mm:DICT_4X4_1000")
    assert wide == Charuco(31, 16, 0.05, 0.04, "DICT_4X4_1000")


@pytest.mark.parametrize("form", [form for form, _ in BOARDS.values()])
def test_the_forms_that_are_shown_can_be_read(form):
    assert board_named(form.split(" ")[0]).points.shape[1] == 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("checkers:9x6:25mm", "known forms"),
        ("chessboard:9x6", "must be written as"),
        ("chessboard:9:25mm", "columns x rows"),
        ("chessboard:9x6:25", "unit"),
        ("chessboard:9x6:25m", "is the unit right"),
        ("chessboard:9x6:0.001mm", "is the unit right"),
        ("chessboard:9x6:1.2.3mm", "length"),
        ("chessboard:2x6:25mm", "at least 3 x 3"),
        ("charuco:9x6:22mm:30mm:DICT_5X5_100", "mixed up"),
        ("charuco:9x6:30mm:22mm:DICT_9X9_100", "known ones"),
        ("charuco:31x16:30mm:22mm:DICT_4X4_50", "has 50 markers.*need 248"),
        ("circles:1x6:25mm", "at least 3 x 3"),
    ],
)
def test_a_wrong_board_is_refused_with_what_is_right(text, message):
    with pytest.raises(ValueError, match=message) as refused:
        board_named(text)

    assert "\n" in str(refused.value) or text in str(refused.value)


def test_the_points_of_a_staggered_grid_are_opencvs():
    points = CircleGrid(4, 11, 0.02, staggered=True).points.reshape(11, 4, 3)

    for row in range(11):
        for column in range(4):
            expected = [(2 * column + row % 2) * 0.02, row * 0.02, 0]
            assert np.allclose(points[row, column], expected)


@pytest.mark.parametrize("text", [CHESS, CHARUCO])
def test_corners_are_found_where_they_are(rig, text):
    board = board_named(text)
    for number, pose in enumerate(random_poses(board, rig, 3, seed=1)):
        found = board.find(photograph(board, rig.left, pose, seed=number))
        truth = rig.left.project(pose.apply(board.points))

        assert len(found) >= 0.9 * len(board.points)  # a blurred marker may be missed
        error = np.linalg.norm(found.pixels - truth[found.ids], axis=1)
        assert error.mean() < 0.12
        assert error.max() < 0.6


def test_a_part_of_a_charuco_board_is_enough(rig):
    board = board_named(CHARUCO)
    (pose,) = random_poses(board, rig, 1, seed=2)
    nearer = Pose(pose.R, pose.t + np.array([0.05, 0.0, -0.03]))
    truth = rig.left.project(nearer.apply(board.points))
    seen = ((truth > 8) & (truth < np.array(SIZE) - 9)).all(1)

    found = board.find(photograph(board, rig.left, nearer))

    assert 6 <= len(found) < len(board.points)
    assert seen[found.ids].all()
    assert np.linalg.norm(found.pixels - truth[found.ids], axis=1).mean() < 0.15


def test_the_old_pattern_of_charuco_boards_is_found_too(rig):
    board = board_named(CHARUCO)
    markers = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    old = cv2.aruco.CharucoBoard((9, 6), board.square_m, board.marker_m, markers)
    old.setLegacyPattern(True)
    picture = cv2.copyMakeBorder(
        old.generateImage((540, 360)), *[40] * 4, cv2.BORDER_CONSTANT, value=255
    )

    found = board.find(np.repeat(picture[..., None], 3, axis=2))

    assert len(found) == len(board.points)


@pytest.mark.parametrize("staggered", [False, True])
def test_circles_are_found_in_the_order_of_the_points(staggered):
    grid = CircleGrid(5, 7, 0.02, staggered=staggered)
    places = grid.points[:, :2] / 0.02 * 40 + 80
    picture = np.full((560, 560), 230, np.uint8)
    for x, y in places:
        cv2.circle(picture, (round(x * 16), round(y * 16)), 12 * 16, 30, -1, cv2.LINE_AA, 4)

    found = grid.find(np.repeat(picture[..., None], 3, axis=2))

    same = np.linalg.norm(found.pixels - places, axis=1).max()
    turned = np.linalg.norm(found.pixels[::-1] - places, axis=1).max()
    assert min(same, turned if grid.turns_into_itself else np.inf) < 1


def test_colours_tell_the_ends_of_a_chessboard_apart(rig):
    board = Chessboard(7, 4, 0.03)
    assert not board.turns_into_itself
    (pose,) = random_poses(board, rig, 1, seed=5)
    half = Pose.from_values(np.array([0, 0, np.pi, 0, 0, 0])).R
    middle = board.points.mean(0)
    turned = Pose(pose.R @ half, pose.t + pose.R @ (middle - half @ middle))

    for each in (pose, turned):
        found = board.find(photograph(board, rig.left, each))
        assert np.abs(found.pixels - rig.left.project(each.apply(board.points))).max() < 1


def test_an_empty_wall_shows_no_board():
    wall = np.random.default_rng(0).integers(90, 110, (240, 320, 3), dtype=np.uint8)

    for text in (CHESS, CHARUCO, "circles:7x6:20mm"):
        assert board_named(text).find(wall) is None


def flat(board, size=SIZE):
    """Return a print of a board, seen from the front."""
    picture, _ = printed(board)
    height, width = picture.shape
    factor = 0.9 * min(size[0] / width, size[1] / height)
    small = cv2.resize(picture, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    return np.repeat(small.astype(np.uint8)[..., None], 3, axis=2)


def test_another_chessboard_is_named():
    image = flat(board_named("chessboard:8x6:25mm"))

    assert "8 x 6" in why_not_found(board_named("chessboard:9x7:25mm"), [image])


def test_other_markers_are_named():
    image = flat(board_named("charuco:9x6:30mm:22mm:DICT_6X6_250"))

    assert "DICT_6X6_1000" in why_not_found(board_named(CHARUCO), [image])


def test_markers_in_a_mirror_are_named():
    image = np.ascontiguousarray(flat(board_named(CHARUCO))[:, ::-1])

    assert "mirror" in why_not_found(board_named(CHARUCO), [image])


def test_nothing_is_said_of_a_wall():
    wall = np.full((240, 320, 3), 90, np.uint8)

    assert why_not_found(board_named(CHESS), [wall]) == ""
    assert why_not_found(board_named(CHARUCO), [wall]) == ""


def test_corners_have_as_many_ids_as_pixels():
    with pytest.raises(ValueError, match="n ids"):
        Corners(np.arange(3), np.zeros((4, 2)))
