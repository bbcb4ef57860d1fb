"""Regions of small scenes, marked by hand."""

import numpy as np
import pytest

from calib import RectifiedGeometry
from calib.pair import RectifiedPair
from recon.evaluation.regions import near_edges, regions, without_texture
from recon.evaluation.scene import Scene, Truth

NAN = np.nan


def grey_image(levels) -> np.ndarray:
    """Return (H, W, 3) uint8 of grey levels (H, W)."""
    return np.repeat(np.asarray(levels, dtype=np.uint8)[..., None], 3, axis=2)


def scene_of(disparity, *, visible=None, left=None) -> Scene:
    """Return a scene of a true disparity; its left image is flat unless given."""
    disparity = np.asarray(disparity, dtype=np.float32)
    left = grey_image(np.zeros(disparity.shape)) if left is None else left
    geometry = RectifiedGeometry((left.shape[1], left.shape[0]), 100.0, (1.0, 1.0), (1.0, 1.0), 0.1)
    pair = RectifiedPair(left, left, geometry)
    return Scene("made", "up", pair, False, range(64), Truth(disparity, visible))


def marked_columns(mask) -> list[int]:
    """Return the columns that are marked from top to bottom; no other pixel may be."""
    columns = np.flatnonzero(mask.all(axis=0))
    assert mask.sum() == len(columns) * len(mask)
    return columns.tolist()


def test_known_pixels_are_either_seen_by_both_cameras_or_occluded():
    disparity = [[5, 5, NAN, NAN]]
    visible = np.array([[True, False, True, False]])

    masks = regions(scene_of(disparity, visible=visible))

    assert masks["all"].tolist() == [[True, True, False, False]]
    assert masks["nonocc"].tolist() == [[True, False, False, False]]
    assert masks["occluded"].tolist() == [[False, True, False, False]]


def test_edges_and_textureless_are_parts_of_what_both_cameras_see():
    disparity = [[5, 5, 9, 9, NAN]]
    visible = np.array([[True, False, True, True, True]])

    masks = regions(scene_of(disparity, visible=visible))

    # the jump reaches over the whole row, and the image is flat
    assert masks["edges"].tolist() == masks["nonocc"].tolist()
    assert masks["textureless"].tolist() == masks["nonocc"].tolist()


def test_without_a_mask_of_visible_pixels_the_parts_are_of_all_known_ones():
    masks = regions(scene_of([[5, 5, 9, NAN]]))

    assert set(masks) == {"all", "edges", "textureless"}
    assert masks["edges"].tolist() == masks["all"].tolist() == [[True, True, True, False]]
    assert masks["textureless"].tolist() == masks["all"].tolist()


def test_masks_are_boolean_and_of_the_size_of_the_truth():
    masks = regions(scene_of(np.ones((6, 8)), left=grey_image(np.zeros((3, 4)))))

    assert {(mask.dtype, mask.shape) for mask in masks.values()} == {(np.dtype(bool), (6, 8))}


def test_an_edge_reaches_four_pixels_beyond_the_two_at_the_jump():
    disparity = np.full((3, 30), 10.0)
    disparity[:, 15:] = 13  # between columns 14 and 15

    assert marked_columns(near_edges(disparity)) == list(range(10, 20))
    assert marked_columns(near_edges(disparity.T).T) == list(range(10, 20))


def test_the_corners_of_the_window_count():
    disparity = np.full((21, 21), 10.0)
    disparity[10, 10] = 20  # jumps to its four neighbours, which reach one further

    mask = near_edges(disparity)

    rows, columns = np.nonzero(mask)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (5, 15, 5, 15)
    # 11 x 11 without the corners, as the neighbours across a corner are not at a jump
    assert mask.sum() == 11 * 11 - 4


def test_a_gap_of_exactly_two_pixels_is_no_edge():
    slope = np.tile(np.arange(0, 60, 2.0), (3, 1))

    assert not near_edges(slope).any()
    assert near_edges(slope * 1.01).all()


def test_next_to_an_unknown_truth_there_is_no_edge():
    disparity = np.full((3, 30), 10.0)
    disparity[:, 15] = NAN
    disparity[:, 16:] = 40

    assert not near_edges(disparity).any()


def test_a_row_that_climbs_by_one_level_has_no_texture_and_one_by_two_has():
    climb = np.tile(np.arange(20), (5, 1))

    assert without_texture(grey_image(climb)).all()  # 1² = 1 is below 4
    assert not without_texture(grey_image(2 * climb)).any()  # 2² = 4 is not


def test_a_step_has_texture_as_far_as_the_mean_of_three_by_three_pixels_reaches_four():
    levels = np.zeros((5, 20))
    levels[:, 10:] = 4  # both neighbours of the step have a squared gradient of 16

    # windows over one of the two columns have a mean of 16 / 3, over both of 32 / 3: not below 4
    assert marked_columns(~without_texture(grey_image(levels))) == [8, 9, 10, 11]

    levels[:, 10:] = 3  # one column: 9 / 3 is below 4; both: 18 / 3 is not

    assert marked_columns(~without_texture(grey_image(levels))) == [9, 10]


def test_stripes_of_single_columns_have_texture():
    stripes = np.tile([0, 200], (5, 10))

    assert not without_texture(grey_image(stripes)).any()


def test_only_changes_along_a_row_are_texture():
    stripes = np.tile([[0], [200]], (5, 10))

    assert without_texture(grey_image(stripes)).all()


def test_colours_count_by_their_grey_value():
    ramp = np.tile(np.arange(0, 160, 8, dtype=np.uint8), (5, 1))
    red, green, blue = (np.zeros((5, 20, 3), dtype=np.uint8) for _ in range(3))
    red[..., 0] = green[..., 1] = blue[..., 2] = ramp

    # 0.299, 0.587 and 0.114 of 8 levels a pixel: two or three, four or five, at most one
    assert not without_texture(red).any()
    assert not without_texture(green).any()
    assert without_texture(blue).all()


@pytest.mark.parametrize("factor", [1, 2, 4])
def test_texture_is_found_at_the_size_of_the_image_and_enlarged(factor):
    levels = np.zeros((4, 12))
    levels[:, 6:] = 3  # textured in columns 5 and 6
    truth = np.full((4 * factor, 12 * factor), 5.0)

    masks = regions(scene_of(truth, left=grey_image(levels)))

    textured = list(range(5 * factor, 7 * factor))
    assert marked_columns(~masks["textureless"]) == textured


def test_a_truth_of_another_pair_is_refused():
    scene = scene_of(np.ones((9, 12)), left=grey_image(np.zeros((3, 4))))

    with pytest.raises(ValueError, match=r"left image is \(3, 4\) but the truth is \(9, 12\)"):
        regions(scene)
