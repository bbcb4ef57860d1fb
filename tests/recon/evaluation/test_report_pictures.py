"""Thumbnails: sizes, colours, and what a reader can tell from them."""

import io

import numpy as np
import pytest
from PIL import Image

from calib.pair import RectifiedPair
from calib.rig import RectifiedGeometry
from recon.colours import MISSING_COLOUR, colour_mapped, colour_range
from recon.evaluation.report.pictures import (
    ERROR_COLOURS,
    ERROR_EDGES_PX,
    INVALID_COLOUR,
    OCCLUDED_BRIGHTNESS,
    UNKNOWN_COLOUR,
    WIDEST_PX,
    error_classes,
    error_colours,
    result_pictures,
    scene_pictures,
)
from recon.evaluation.scene import Scene, Truth


def a_scene(truth, *, visible=None, full_px_per_px=1, pair_factor=1, benchmark="middlebury-v3"):
    height, width = (extent // pair_factor for extent in truth.shape)
    centre = (width / 2, height / 2)
    image = np.random.default_rng(1).integers(0, 256, (height, width, 3), dtype=np.uint8)
    pair = RectifiedPair(
        image, image, RectifiedGeometry((width, height), 100.0, centre, centre, 0.1)
    )
    return Scene(
        "set",
        "scene",
        pair,
        True,
        range(256),
        Truth(truth.astype(np.float32), visible, full_px_per_px=full_px_per_px),
        benchmark,
    )


def a_slope(height=40, width=60):
    return np.linspace(5, 50, height * width, dtype=np.float32).reshape(height, width)


def pixels(contents):
    return np.asarray(Image.open(io.BytesIO(contents)).convert("RGB"))


def error_map(values, scene):
    return pixels(result_pictures(values, scene)["error.png"])


def colours_in(picture):
    return {tuple(int(c) for c in colour) for colour in picture.reshape(-1, 3)}


def darker(colour):
    return tuple(round(channel * OCCLUDED_BRIGHTNESS) for channel in colour)


@pytest.mark.parametrize("edge_number", range(len(ERROR_EDGES_PX)))
def test_an_error_on_an_edge_has_the_colour_below_it_and_one_above_the_next(edge_number):
    edge = ERROR_EDGES_PX[edge_number]
    error = np.array([[edge, np.nextafter(edge, 99)]])

    colours = error_colours(error_classes(error, known=np.ones((1, 2), bool), visible=None))

    assert tuple(colours[0, 0]) == ERROR_COLOURS[edge_number]
    assert tuple(colours[0, 1]) == ERROR_COLOURS[edge_number + 1]


def test_errors_beyond_the_edges_have_the_first_and_the_last_colour():
    error = np.array([[0.0, 1e6]])

    colours = error_colours(error_classes(error, known=np.ones((1, 2), bool), visible=None))

    assert tuple(colours[0, 0]) == ERROR_COLOURS[0]
    assert tuple(colours[0, 1]) == ERROR_COLOURS[-1]


def test_all_colours_of_error_maps_differ():
    visible = [*ERROR_COLOURS, INVALID_COLOUR, UNKNOWN_COLOUR]
    occluded = [darker(colour) for colour in ERROR_COLOURS]

    assert len({*visible, *occluded}) == len(visible) + len(occluded)


def test_an_error_map_tells_missing_results_unknown_truth_and_occlusions_apart():
    truth = np.full((1, 5), 10.0)
    truth[0, 3:] = np.nan
    visible = np.array([[True, True, False, True, False]])
    values = np.array([[10.0, np.nan, 13.0, 10.0, np.inf]], np.float32)

    colours = error_map(values, a_scene(truth, visible=visible))

    assert [tuple(colour) for colour in colours[0].tolist()] == [
        ERROR_COLOURS[0],
        INVALID_COLOUR,
        darker(ERROR_COLOURS[3]),
        UNKNOWN_COLOUR,
        UNKNOWN_COLOUR,
    ]


def test_errors_have_one_colour_on_either_side_of_the_truth():
    values = np.array([[7.0, 13.0]], np.float32)

    assert colours_in(error_map(values, a_scene(np.full((1, 2), 10.0)))) == {ERROR_COLOURS[3]}


def test_an_infinite_disparity_is_no_result():
    values = np.array([[np.inf, -np.inf]], np.float32)

    assert colours_in(error_map(values, a_scene(np.full((1, 2), 10.0)))) == {INVALID_COLOUR}


def test_an_occluded_pixel_without_a_result_looks_as_if_it_had_none():
    values = np.array([[np.nan]], np.float32)

    colours = error_map(values, a_scene(np.full((1, 1), 9.0), visible=np.zeros((1, 1), bool)))

    assert colours_in(colours) == {INVALID_COLOUR}


@pytest.mark.parametrize(("full_px_per_px", "number"), [(1, 1), (2, 2), (4, 3)])
def test_errors_count_in_pixels_of_full_size(full_px_per_px, number):
    scene = a_scene(np.full((4, 4), 10.0), full_px_per_px=full_px_per_px)

    colours = error_map(np.full((4, 4), 10.75, np.float32), scene)

    assert colours_in(colours) == {ERROR_COLOURS[number]}  # 0.75, 1.5 and 3 px


def test_without_a_benchmark_errors_count_in_pixels_of_the_truth():
    scene = a_scene(np.full((4, 4), 10.0), full_px_per_px=4, benchmark="")

    colours = error_map(np.full((4, 4), 10.75, np.float32), scene)

    assert colours_in(colours) == {ERROR_COLOURS[1]}


@pytest.mark.parametrize("factor", [1, 2, 4])
def test_a_smaller_result_is_compared_at_the_size_of_the_truth(factor):
    truth = np.arange(8, 56, dtype=np.float32).reshape(6, 8).repeat(4, 0).repeat(4, 1)
    scene = a_scene(truth, pair_factor=factor)

    found = result_pictures(truth[::factor, ::factor] / factor, scene)

    assert colours_in(pixels(found["error.png"])) == {ERROR_COLOURS[0]}
    assert pixels(found["error.png"]).shape == (24, 32, 3)
    same = result_pictures(truth, scene)
    assert found["disparity.jpg"] == same["disparity.jpg"]


def test_a_result_of_another_size_is_refused():
    with pytest.raises(ValueError, match=r"\(10, 10\) but the truth is \(40, 60\)"):
        result_pictures(np.ones((10, 10), np.float32), a_scene(a_slope()))


def test_thumbnails_keep_their_proportions_and_small_images_their_size():
    wide = a_scene(a_slope(100, 4 * WIDEST_PX))
    small = a_scene(a_slope())

    of_wide = {**scene_pictures(wide), **result_pictures(wide.truth.disparity, wide)}
    of_small = {**scene_pictures(small), **result_pictures(small.truth.disparity, small)}

    assert set(of_wide) == {"left.jpg", "truth.jpg", "disparity.jpg", "error.png"}
    assert {pixels(picture).shape for picture in of_wide.values()} == {(25, WIDEST_PX, 3)}
    assert {pixels(picture).shape for picture in of_small.values()} == {(40, 60, 3)}


def test_a_truth_larger_than_its_pair_is_drawn_whole():
    scene = a_scene(a_slope(), pair_factor=2)

    pictures = scene_pictures(scene)

    assert pixels(pictures["left.jpg"]).shape == (20, 30, 3)
    assert pixels(pictures["truth.jpg"]).shape == (40, 60, 3)


def test_a_result_has_the_colours_of_the_truth_even_where_it_leaves_its_range():
    truth = a_slope()
    scene = a_scene(truth)
    lowest, highest = colour_range(truth)
    values = np.full_like(truth, 1000.0)

    true_colours = pixels(scene_pictures(scene)["truth.jpg"]).astype(int)
    found_colours = pixels(result_pictures(values, scene)["disparity.jpg"]).astype(int)

    nearest = colour_mapped(np.array([[highest]]), lowest, highest)[0, 0]
    assert np.abs(found_colours - nearest).max() <= 8  # JPEG
    assert np.abs(true_colours - colour_mapped(truth, lowest, highest)).mean() < 8
    assert result_pictures(truth, scene)["disparity.jpg"] == scene_pictures(scene)["truth.jpg"]


def test_shrinking_averages_disparities_and_leaves_missing_ones_out():
    truth = np.full((40, 2 * WIDEST_PX), 30.0, np.float32)
    truth[:20] = 10
    values = truth.copy()
    values[1::2] = np.nan
    values[:10] = np.nan
    values[30:, 1::2] = np.nan
    scene = a_scene(truth)

    found = pixels(result_pictures(values, scene)["disparity.jpg"]).astype(int)
    true = pixels(scene_pictures(scene)["truth.jpg"]).astype(int)

    assert np.abs(found[8:12] - true[8:12]).max() <= 24  # half the pixels exist: as if all did
    assert np.abs(found[:3] - np.array(MISSING_COLOUR)).max() <= 24
    assert np.abs(found[17:] - np.array(MISSING_COLOUR)).max() <= 24  # a quarter is too little


def test_shrinking_keeps_the_share_of_every_error_and_invents_no_colour():
    generator = np.random.default_rng(7)
    truth = np.full((400, 4 * WIDEST_PX), 50.0, np.float32)
    values = truth + generator.choice([0.0, 3.0, 40.0], truth.shape, p=[0.7, 0.2, 0.1])

    colours = error_map(values.astype(np.float32), a_scene(truth))

    shares = [
        (colours == ERROR_COLOURS[number]).all(axis=2).mean()
        for number in (0, 3, len(ERROR_COLOURS) - 1)
    ]
    np.testing.assert_allclose(shares, [0.7, 0.2, 0.1], atol=0.01)
    assert len(colours_in(colours)) == 3


def test_a_sparse_truth_is_found_within_each_block():
    truth = np.full((40, 2 * WIDEST_PX), np.nan, np.float32)
    truth[::2, ::2] = 20
    scene = a_scene(truth, benchmark="kitti")

    colours = error_map(np.full(truth.shape, 21.5, np.float32), scene)

    assert colours_in(colours) == {ERROR_COLOURS[2]}


def test_a_truth_that_is_nowhere_known_is_drawn():
    scene = a_scene(np.full((6, 8), np.nan))

    pictures = {**scene_pictures(scene), **result_pictures(np.ones((6, 8), np.float32), scene)}

    assert colours_in(pixels(pictures["error.png"])) == {UNKNOWN_COLOUR}


def test_drawing_changes_no_input_and_repeats_itself():
    truth = a_slope()
    truth[3, 4] = np.nan
    values = np.full_like(truth, 20)
    values[5, 6] = np.nan
    before = truth.copy(), values.copy()
    scene = a_scene(truth, visible=truth > 10)

    first = result_pictures(values, scene)

    np.testing.assert_array_equal(scene.truth.disparity, before[0])
    np.testing.assert_array_equal(values, before[1])
    assert result_pictures(values, scene) == first


def test_pictures_of_a_usual_scene_are_small():
    generator = np.random.default_rng(3)
    rough = generator.normal(0, 2, (124, 185)).repeat(4, 0).repeat(4, 1)
    truth = a_slope(496, 740)
    scene = a_scene(truth, visible=rough < 3, full_px_per_px=4)

    pictures = result_pictures((truth + rough).astype(np.float32), scene)

    assert sum(len(contents) for contents in pictures.values()) < 50_000
