"""OpenCV's matchers on pairs of known disparity, and their known figures on Middlebury."""

import cv2
import numpy as np
import pytest

from calib.pair import RectifiedPair
from calib.rig import RectifiedGeometry
from recon.evaluation.opencv_matchers import OPENCV_MATCHERS, OpenCvMatcher, checked, rows_filled
from recon.files import read_pfm
from recon.pairs import read_pair
from recon.types import PixelStatus

HEIGHT, WIDTH = 60, 150
FAR, NEAR = 4, 28
ROWS, COLUMNS = slice(15, 45), slice(80, 120)
SEARCHED = range(48)
STEP_PX = 1 / 16
CHECKED_IN_BOTH_VIEWS = ["opencv-bm", "opencv-sgbm", "opencv-sgbm-3way"]


def pair_of(left, right):
    height, width = left.shape[:2]
    centre = (width / 2, height / 2)
    return RectifiedPair(
        left, right, RectifiedGeometry((width, height), 100.0, centre, centre, 0.1)
    )


def texture(width, height=HEIGHT, seed=0):
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def shifted_pair(disparity, height=HEIGHT, width=WIDTH):
    """A wall parallel to the images: right[x] = left[x + d]."""
    room = abs(disparity)
    whole = texture(width + 2 * room, height)
    views = (whole[:, start : start + width] for start in (room, room + disparity))
    return pair_of(*(np.ascontiguousarray(view) for view in views))


def square_before_a_wall():
    """NEAR before FAR; the right camera does not see NEAR - FAR columns left of the square."""
    pair = shifted_pair(FAR)
    square = texture(COLUMNS.stop - COLUMNS.start, ROWS.stop - ROWS.start, seed=1)
    left, right = pair.left.copy(), pair.right.copy()
    left[ROWS, COLUMNS] = square
    right[ROWS, COLUMNS.start - NEAR : COLUMNS.stop - NEAR] = square
    return pair_of(left, right)


def interior(values, disparity, margin=8):
    """What both cameras see, away from the border."""
    start, stop = max(0, disparity) + margin, values.shape[1] + min(0, disparity) - margin
    return values[margin:-margin, start:stop]


@pytest.mark.parametrize("name", OPENCV_MATCHERS)
@pytest.mark.parametrize(
    ("disparity", "searched"),
    [(7, range(16)), (7, range(3, 12)), (40, range(33, 49)), (-7, range(-20, -3)), (0, range(1))],
    ids=str,
)
def test_every_matcher_finds_a_shift(name, disparity, searched):
    found = OPENCV_MATCHERS[name](shifted_pair(disparity), searched)

    assert (interior(found.status, disparity) == PixelStatus.MATCHED).all()
    assert (np.abs(interior(found.values, disparity) - disparity) <= STEP_PX).all()
    assert not np.isnan(found.values).any()


@pytest.mark.parametrize("name", CHECKED_IN_BOTH_VIEWS)
def test_what_the_right_camera_cannot_see_takes_the_wall_behind(name):
    found = OPENCV_MATCHERS[name](square_before_a_wall(), SEARCHED)

    half_block = OPENCV_MATCHERS[name].block_px // 2 + 1
    hidden = slice(COLUMNS.start - (NEAR - FAR) + half_block, COLUMNS.start - half_block)
    rows = slice(ROWS.start + half_block, ROWS.stop - half_block)
    assert (found.status[rows, hidden] == PixelStatus.FILLED_OCCLUSION).mean() > 0.9
    filled = found.status[rows, hidden] == PixelStatus.FILLED_OCCLUSION
    assert (np.abs(found.values[rows, hidden][filled] - FAR) <= STEP_PX).all()
    inside = slice(COLUMNS.start + half_block, COLUMNS.stop - half_block)
    assert (np.abs(found.values[rows, inside] - NEAR) <= STEP_PX).all()


@pytest.mark.parametrize("disparity", [1, 4, 30])
def test_what_opencv_rejects_is_mismatched_if_the_right_view_sees_it_and_else_occluded(disparity):
    of_left, of_right = np.full((2, 12, 70), disparity, np.float32)
    of_left[2:4, 40:45] = np.nan
    of_left[6:8, 40:45] = np.nan
    of_right[6:8, 40 - disparity : 45 - disparity] = np.nan
    expected = np.full((12, 70), PixelStatus.MATCHED, np.uint8)
    expected[2:4, 40:45] = PixelStatus.MISMATCHED
    expected[6:8, 40:45] = PixelStatus.OCCLUDED
    expected[:, :disparity] = PixelStatus.OCCLUDED  # beyond the border of the right view

    found = checked(of_left, of_right, SEARCHED, tolerance_px=0.5)

    np.testing.assert_array_equal(found.status.numpy(), expected)
    matched = expected == PixelStatus.MATCHED
    np.testing.assert_array_equal(found.values.numpy(), np.where(matched, disparity, np.nan))


def test_block_matching_reaches_the_first_and_the_last_row():
    found = OPENCV_MATCHERS["opencv-bm"](shifted_pair(7), range(16))

    assert (found.status[:, 20:-20] == PixelStatus.MATCHED).all()


def test_small_islands_are_rejected_and_a_map_without_a_match_stays_empty():
    whole_image = OpenCvMatcher(min_segment_px=HEIGHT * WIDTH)

    found = whole_image(shifted_pair(7), range(16))

    assert not found.valid.any()


@pytest.mark.parametrize("name", OPENCV_MATCHERS)
def test_confidence_tells_measured_from_filled(name):
    found = OPENCV_MATCHERS[name](square_before_a_wall(), SEARCHED)

    measured = found.status == PixelStatus.MATCHED
    assert (~measured).any()
    assert (found.confidence[measured] == 1).all()
    assert (found.confidence[~measured] == np.float32(0.1)).all()


@pytest.mark.parametrize("name", OPENCV_MATCHERS)
def test_matching_again_gives_the_same_and_leaves_the_images_alone(name):
    pair = square_before_a_wall()
    left, right = pair.left.copy(), pair.right.copy()

    first, second = (OPENCV_MATCHERS[name](pair, SEARCHED) for _ in range(2))

    for field in ("values", "status", "confidence"):
        np.testing.assert_array_equal(getattr(first, field), getattr(second, field))
    np.testing.assert_array_equal(pair.left, left)
    np.testing.assert_array_equal(pair.right, right)


@pytest.mark.parametrize("mode", ["sgbm", "hh", "3way", "hh4"])
def test_every_mode_of_sgbm_has_a_name(mode):
    found = OpenCvMatcher("sgbm", mode=mode)(shifted_pair(7), range(16))

    assert (np.abs(interior(found.values, 7) - 7) <= STEP_PX).all()


def test_a_hole_takes_the_smaller_neighbour_of_its_row():
    nan = np.nan
    values = np.array(
        [
            [nan, 5, nan, nan, 3, 9, nan],
            [2, nan, 7, nan, nan, nan, 4],
            [nan, nan, nan, nan, nan, nan, nan],
            [1, 1, 1, 1, 1, 1, 1],
        ],
        np.float32,
    )

    filled = rows_filled(values, confidence=0.25)

    expected = [
        [5, 5, 3, 3, 3, 9, 9],
        [2, 2, 7, 4, 4, 4, 4],
        [2, 2, 7, 4, 4, 4, 4],  # without a neighbour: the nearest row, the upper of two
        [1, 1, 1, 1, 1, 1, 1],
    ]
    np.testing.assert_array_equal(filled.values, expected)
    known = ~np.isnan(values)
    np.testing.assert_array_equal(filled.status == PixelStatus.MATCHED, known)
    np.testing.assert_array_equal(filled.status == PixelStatus.FILLED_OCCLUSION, ~known)
    np.testing.assert_array_equal(filled.confidence, np.where(known, 1, 0.25))


def test_rows_without_any_disparity_stay_empty():
    filled = rows_filled(np.full((3, 4), np.nan, np.float32), confidence=0.1)

    assert not filled.valid.any()
    assert (filled.confidence == 0).all()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"algorithm": "elas"}, r"unknown algorithm 'elas'; there are bm, sgbm"),
        ({"mode": "9way"}, r"unknown mode '9way'; there are sgbm, hh, 3way, hh4"),
        ({"algorithm": "bm", "block_px": 15}, r"bm has no modes, got 'hh'"),
        ({"fill": "median"}, r"unknown fill 'median'; there are ours, row"),
        ({"block_px": 4}, r"block_px of sgbm must be odd and at least 1, got 4 px"),
        (
            {"algorithm": "bm", "mode": "", "block_px": 3},
            r"block_px of bm must be odd and at least 5, got 3 px",
        ),
        ({"min_segment_px": -1}, r"min_segment_px must not be negative, got -1"),
    ],
)
def test_a_setting_that_cannot_be_is_named(settings, message):
    with pytest.raises(ValueError, match=message):
        OpenCvMatcher(**settings)


@pytest.mark.parametrize(
    ("searched", "message"),
    [
        (range(0), r"disparities must be consecutive, at least one, got range\(0, 0\)"),
        (range(0, 16, 2), r"disparities must be consecutive, at least one"),
        (range(3000), r"between -2047 and 2047 px, got 0 to 2999"),
        (range(-2100, -2000), r"between -2047 and 2047 px, got -2100 to -2001"),
    ],
)
def test_a_range_that_opencv_cannot_search_is_refused(searched, message):
    with pytest.raises(ValueError, match=message):
        OPENCV_MATCHERS["opencv-sgbm"](shifted_pair(4), searched)


def test_images_smaller_than_a_block_are_refused():
    with pytest.raises(
        ValueError, match=r"images are 40 x 14 \(width x height\) but a block is 15"
    ):
        OPENCV_MATCHERS["opencv-bm"](shifted_pair(4, height=14, width=40), SEARCHED)


HALF_WEIGHT = {"PianoL", "Playroom", "Playtable", "Shelves", "Vintage"}


@pytest.mark.slow
def test_the_figures_of_sgbm_on_middlebury_are_those_known_before(datasets):
    """Middlebury v3 at quarter size: errors times 4, weights 1 and 1/2, nothing clipped.

    The figures are of OpenCV's SGBM with a program that shared no code with this one.
    """
    matcher = OPENCV_MATCHERS["opencv-sgbm-rows"]
    folders = sorted(f for f in (datasets / "middlebury-v3" / "Q").iterdir() if f.is_dir())
    figures, clipped, weights = [], [], []
    for folder in folders:
        source = read_pair(folder / "im0.png", folder / "im1.png", folder / "calib.txt")
        truth = read_pfm(folder / "disp0GT.pfm")
        mask = cv2.imread(str(folder / "mask0nocc.png"), cv2.IMREAD_GRAYSCALE)
        known = np.isfinite(truth)
        visible = known & (mask == 255)
        weights.append(0.5 if folder.name in HALF_WEIGHT else 1.0)

        values = matcher(source.pair, source.disparities).values

        error_px = np.abs(values - truth)
        figures.append(
            [
                (4 * error_px[visible]).mean(),
                (4 * error_px[known]).mean(),
                100 * (4 * error_px[visible] > 2).mean(),
                100 * (error_px[known] > 2).mean(),
            ]
        )
        error_px = np.abs(np.clip(values, 0, source.disparities.stop) - truth)
        clipped.append([(4 * error_px[visible]).mean(), (4 * error_px[known]).mean()])
    assert len(folders) == 15

    weighted = np.average(figures, axis=0, weights=weights)
    assert weighted[0] == pytest.approx(11.81, rel=0.01)  # nonocc avgerr
    assert weighted[1] == pytest.approx(19.10, rel=0.01)  # all avgerr
    assert weighted[2] == pytest.approx(23.98, rel=0.01)  # nonocc bad2.0
    assert np.mean(figures, axis=0)[3] == pytest.approx(21.3, rel=0.01)  # zs-all
    # What clipping to [0, ndisp] gains: some filled and padded candidates lie beyond.
    assert np.average(clipped, axis=0, weights=weights) == pytest.approx([11.58, 18.84], rel=0.01)
