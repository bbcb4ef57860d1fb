"""Every rule of every protocol on maps of a few pixels, worked out by hand."""

import cv2
import numpy as np
import pytest

from calib import RectifiedGeometry
from calib.pair import RectifiedPair
from recon.evaluation.protocols import (
    OFFICIAL_WEIGHTS,
    PROTOCOLS,
    REGIONS,
    enlarged,
    label,
    protocol_for,
    score,
    signed_errors,
)
from recon.evaluation.regions import regions
from recon.evaluation.scene import Scene, Truth
from recon.files import read_image, read_pfm

NAN = np.nan
OFFICIAL = PROTOCOLS["official"]
ZERO_SHOT = PROTOCOLS["zs-all"]
NOT_OFFICIAL = [name for name in PROTOCOLS if name != "official"]


def row(*values) -> np.ndarray:
    """Return a map of one row, (1, W) float32."""
    return np.array([values], dtype=np.float32)


def scene_of(disparity, *, smaller=1, ndisp=1000, benchmark="middlebury-v3", **truth) -> Scene:
    """Return a scene of a true disparity whose images are `smaller` times smaller than it."""
    disparity = np.asarray(disparity, dtype=np.float32)
    height, width = (length // smaller for length in disparity.shape)
    image = np.zeros((height, width, 3), dtype=np.uint8)
    geometry = RectifiedGeometry((width, height), 100.0, (1.0, 1.0), (1.0, 1.0), 0.1)
    pair = RectifiedPair(image, image, geometry)
    known = Truth(disparity, **{"visible": None, **truth})
    return Scene("made", "up", pair, False, range(ndisp), known, benchmark)


def errors(found, scene, protocol=OFFICIAL) -> list[float]:
    """Return signed errors in row order."""
    return signed_errors(found, scene, protocol).ravel().tolist()


def scored(found, scene, name="official") -> dict:
    return score(found, scene, PROTOCOLS[name], regions(scene))


@pytest.mark.parametrize("name", PROTOCOLS)
def test_a_perfect_map_has_no_error(name):
    truth = row(3, 150, 20)
    scene = scene_of(truth, visible=truth > 0)

    result = scored(truth, scene, name)

    for region, values in result.items():
        assert values.pop("pixels") == (0 if region == "occluded" else 3)
        assert set(values.values()) == ({None} if region == "occluded" else {0})


@pytest.mark.parametrize("name", PROTOCOLS)
def test_six_tenths_of_a_pixel_are_bad_at_half_a_pixel_and_four_tenths_are_not(name):
    truth = row(3, 150, 20)
    scene = scene_of(truth, visible=truth > 0)

    near, far = (next(iter(scored(truth + off, scene, name).values())) for off in (0.4, 0.6))

    assert (near["avgerr"], far["avgerr"]) == pytest.approx((0.4, 0.6), abs=1e-5)
    assert (near["bad0.5"], far["bad0.5"], far["bad1.0"]) == (0, 100, 0)


@pytest.mark.parametrize("name", PROTOCOLS)
def test_too_far_is_as_bad_as_too_near(name):
    truth = row(30, 150)
    scene = scene_of(truth, visible=truth > 0)

    first = next(iter(scored(truth + row(-3, 3), scene, name).values()))

    assert first["avgerr"] == first["rms"] == first["A50"] == 3
    assert first["bad2.0"] == 100


@pytest.mark.parametrize("name", PROTOCOLS)
@pytest.mark.parametrize("missing", [np.inf, -np.inf, NAN])
def test_a_map_without_a_result_is_invalid_everywhere(name, missing):
    truth = row(3, 150, 20)
    scene = scene_of(truth, visible=truth > 0, integer=True)

    result = scored(np.full_like(truth, missing), scene, name)

    first = next(iter(result.values()))
    assert first["invalid"] == first["bad4.0"] == 100
    assert first["avgerr"] is None


def test_official_clips_to_the_search_range():
    scene = scene_of(row(10, 10, 3), ndisp=16)
    found = row(50, 16, -5)

    assert errors(found, scene) == [6, 6, -3]  # 50 becomes 16, -5 becomes 0


@pytest.mark.parametrize("name", NOT_OFFICIAL)
def test_no_other_protocol_clips(name):
    scene = scene_of(row(10, 3), ndisp=16)

    assert errors(row(50, -5), scene, PROTOCOLS[name]) == [40, -8]


def test_the_end_of_the_search_range_grows_with_the_map():
    scene = scene_of(np.full((4, 8), 10.0), smaller=4, ndisp=4)

    result = signed_errors(row(5, 3), scene, OFFICIAL)

    # 5 becomes 20 and is clipped to 4 x 4 = 16; 3 becomes 12
    assert np.unique(result[:, :4]).tolist() == [6]
    assert np.unique(result[:, 4:]).tolist() == [2]


def test_the_search_range_belongs_to_the_pair_and_not_to_a_smaller_map():
    scene = scene_of(np.full((2, 4), 5.0), smaller=1, ndisp=8)

    result = signed_errors(row(7, 3), scene, OFFICIAL)

    assert np.unique(result[:, :2]).tolist() == [3]  # 14 becomes 8
    assert np.unique(result[:, 2:]).tolist() == [1]  # 6 stays


@pytest.mark.parametrize("factor", [1, 2, 4])
def test_a_smaller_map_is_repeated_and_its_values_multiplied(factor):
    small = np.array([[1.5, NAN, 3], [4, 5, 6.25]], dtype=np.float32)

    large = enlarged(small, (2 * factor, 3 * factor))

    y, x = np.indices(large.shape)
    np.testing.assert_array_equal(large, factor * small[y // factor, x // factor])
    assert large.dtype == np.float32


@pytest.mark.parametrize("factor", [2, 4])
@pytest.mark.parametrize("name", PROTOCOLS)
def test_half_and_quarter_size_maps_are_compared_with_a_full_size_truth(name, factor):
    small = np.array([[3, 4.5], [6, 7.25]], dtype=np.float32)
    scene = scene_of(np.kron(small, np.full((factor, factor), factor)) + 1, smaller=factor)

    result = signed_errors(small, scene, PROTOCOLS[name])

    assert np.unique(result).tolist() == [-1]  # in full-size pixels, not 1 / factor


@pytest.mark.parametrize(
    "truth_shape",
    [(9, 12), (6, 16), (12, 8), (6, 9), (2, 2), (24, 32), (3, 4, 1)],
    ids=["3 times", "unequal", "transposed", "odd", "larger map", "8 times", "channels"],
)
def test_other_sizes_are_refused(truth_shape):
    message = r"disparity map is \(3, 4\) but the truth is .*must be 1, 2 or 4 times smaller"

    with pytest.raises(ValueError, match=message):
        enlarged(np.ones((3, 4)), truth_shape)


def test_a_truth_of_whole_pixels_makes_official_round():
    scene = scene_of(row(10, 10, 10, 10), integer=True)

    assert errors(row(10.4, 9.6, 10.6, 8.6), scene) == [0, 0, 1, -1]


@pytest.mark.parametrize("name", PROTOCOLS)
def test_nothing_is_rounded_beside_a_truth_of_fractions(name):
    scene = scene_of(row(10, 10))

    assert errors(row(10.5, 9.25), scene, PROTOCOLS[name]) == [0.5, -0.75]


@pytest.mark.parametrize("name", NOT_OFFICIAL)
def test_no_other_protocol_rounds(name):
    scene = scene_of(row(10, 10), integer=True)

    assert errors(row(10.5, 9.25), scene, PROTOCOLS[name]) == [0.5, -0.75]


def test_halves_are_rounded_up():
    scene = scene_of(row(10, 10, 10), integer=True)
    below = np.nextafter(np.float32(0.5), np.float32(0))

    assert errors(row(10.5, 11.5, 9.5), scene) == [1, 2, 0]
    assert errors(row(below), scene_of(row(0), integer=True)) == [0]


def test_a_map_is_enlarged_before_it_is_rounded():
    scene = scene_of(np.full((2, 2), 10.0), smaller=2, integer=True)

    result = signed_errors(row(5.3), scene, OFFICIAL)

    assert np.unique(result).tolist() == [1]  # 10.6 becomes 11; 5.3 rounded first would give 10


def test_rounding_leaves_the_ends_of_the_search_range():
    scene = scene_of(row(0, 16, 16), ndisp=16, integer=True)

    assert errors(row(-0.6, 16.6, 15.5), scene) == [0, 0, 0]


def test_official_speaks_of_full_size_pixels_and_the_others_of_those_of_the_truth():
    scene = scene_of(row(10, 10), full_px_per_px=4)
    found = row(10.5, 8)

    assert errors(found, scene) == [2, -8]
    for name in NOT_OFFICIAL:
        assert errors(found, scene, PROTOCOLS[name]) == [0.5, -2]


def test_d1_takes_errors_and_truth_in_the_same_pixels():
    scene = scene_of(row(10, 50), full_px_per_px=4)
    found = row(10.8, 51.5)
    # in full-size pixels: 3.2 of 40 is more than 3 px and 5 %; 6 of 200 is 3 %

    assert scored(found, scene)["all"]["d1"] == 50
    assert scored(found, scene, "zs-all")["all"]["d1"] == 0


def test_errors_are_positive_where_the_result_is_too_near_and_missing_where_either_is():
    scene = scene_of(row(10, 10, NAN, 10))

    result = signed_errors(row(12, 9, 5, np.inf), scene, ZERO_SHOT)

    assert result.dtype == np.float32
    np.testing.assert_array_equal(result, row(2, -1, NAN, NAN))


def test_maps_in_double_precision_give_the_same_errors():
    scene = scene_of(row(10, 10))
    found = row(10.3, 9.1)

    assert errors(found.astype(np.float64), scene) == errors(found, scene)


def test_scoring_changes_neither_the_map_nor_the_truth():
    truth, found = row(10, 10, NAN), row(99, -3, np.inf)
    scene = scene_of(truth.copy(), ndisp=16, integer=True, full_px_per_px=4)
    before = found.copy()

    scored(found, scene)

    np.testing.assert_array_equal(found, before)
    np.testing.assert_array_equal(scene.truth.disparity, truth)


def test_official_counts_all_regions_apart():
    truth = np.full((20, 40), 10.0)
    truth[:, 20:] = 30
    visible = np.ones(truth.shape, dtype=bool)
    visible[:5] = False
    scene = scene_of(truth, visible=visible)

    result = scored(np.where(visible, truth, truth + 3), scene)

    assert tuple(result) == REGIONS
    # 800 pixels, 200 of them occluded; edges: 10 of 40 columns in the 15 rows in sight
    pixels = {region: values["pixels"] for region, values in result.items()}
    assert pixels == {
        "nonocc": 600,
        "all": 800,
        "occluded": 200,
        "edges": 150,
        "textureless": 600,
    }
    assert result["all"]["avgerr"] == 200 * 3 / 800
    assert (result["nonocc"]["avgerr"], result["occluded"]["avgerr"]) == (0, 3)


def test_zs_all_counts_occluded_pixels_and_zs_noc_does_not():
    truth = row(10, 10, 10, NAN)
    scene = scene_of(truth, visible=np.array([[True, True, False, True]]))
    found = row(10, 10, 13, 5)

    assert scored(found, scene, "zs-all").keys() == {"all"}
    assert scored(found, scene, "zs-all")["all"]["bad2.0"] == pytest.approx(100 / 3)
    assert scored(found, scene, "zs-noc").keys() == {"nonocc"}
    assert scored(found, scene, "zs-noc")["nonocc"]["bad2.0"] == 0


def test_zs_noc192_counts_true_disparities_below_192_only():
    truth = row(191, 192, 250, 10)
    scene = scene_of(truth, visible=np.array([[True, True, True, False]]))
    found = row(500, 192, 3, 99)  # what was found makes no difference

    result = scored(found, scene, "zs-noc192")

    assert result.keys() == {"nonocc"}
    assert result["nonocc"]["pixels"] == 1
    assert result["nonocc"]["avgerr"] == 309
    assert scored(found, scene, "zs-noc")["nonocc"]["pixels"] == 3


def test_the_cut_at_192_is_in_pixels_of_the_truth_whatever_its_size():
    truth = row(100, 150)
    scene = scene_of(truth, visible=truth > 0, full_px_per_px=4)

    assert scored(truth, scene, "zs-noc192")["nonocc"]["pixels"] == 2


def test_regions_that_a_scene_does_not_have_are_left_out():
    scene = scene_of(row(10, 10))

    assert scored(row(10, 10), scene).keys() == {"all", "edges", "textureless"}
    assert scored(row(10, 10), scene, "zs-noc") == {}


@pytest.mark.parametrize(
    ("benchmark", "resolved"), [("middlebury-v3", "official"), ("kitti", "kitti"), ("", "own-size")]
)
def test_official_means_the_rules_of_the_benchmark(benchmark, resolved):
    scene = scene_of(row(10), benchmark=benchmark)

    assert protocol_for("official", scene) is PROTOCOLS[resolved]
    assert protocol_for("zs-noc", scene) is PROTOCOLS["zs-noc"]


def test_unknown_names_are_named():
    scene = scene_of(row(10), benchmark="eth3d")

    with pytest.raises(ValueError, match=r"unknown protocol 'offical'; there are official, zs-all"):
        protocol_for("offical", scene)
    with pytest.raises(ValueError, match=r"no official rules for benchmark 'eth3d'; there are"):
        protocol_for("official", scene)


@pytest.mark.parametrize(
    ("full_px_per_px", "expected"), [(1, "official"), (2, "official@H"), (4, "official@Q")]
)
def test_official_names_the_size_of_a_smaller_truth_and_the_others_do_not(full_px_per_px, expected):
    scene = scene_of(row(10), full_px_per_px=full_px_per_px)

    assert label(OFFICIAL, scene) == expected
    for name in NOT_OFFICIAL:
        assert label(PROTOCOLS[name], scene) == name


def test_only_official_is_weighted():
    weighted = [protocol.name for protocol in PROTOCOLS.values() if protocol.weighted]

    assert weighted == ["official"]
    assert all(protocol.description.endswith(".") for protocol in PROTOCOLS.values())
    assert all(name == protocol.name for name, protocol in PROTOCOLS.items())


def test_five_of_fifteen_scenes_count_half():
    half = {name for name, weight in OFFICIAL_WEIGHTS.items() if weight == 0.5}

    assert half == {"PianoL", "Playroom", "Playtable", "Shelves", "Vintage"}
    assert len(OFFICIAL_WEIGHTS) == 15
    assert sum(OFFICIAL_WEIGHTS.values()) == 12.5


def test_a_real_scene_at_quarter_size_scores_in_full_size_pixels(datasets):
    folder = datasets / "middlebury-v3" / "Q" / "Teddy"
    left, right = read_image(folder / "im0.png"), read_image(folder / "im1.png")
    disparity = read_pfm(folder / "disp0GT.pfm")
    mask = cv2.imread(str(folder / "mask0nocc.png"), cv2.IMREAD_UNCHANGED)
    size = (left.shape[1], left.shape[0])
    geometry = RectifiedGeometry(size, 1500.0, (199.0, 187.0), (251.0, 187.0), 0.08)
    truth = Truth(disparity, mask == 255, full_px_per_px=4)
    pair = RectifiedPair(left, right, geometry)
    scene = Scene("Q", "Teddy", pair, True, range(64), truth, "middlebury-v3")

    exact, off = scored(disparity, scene), scored(disparity + 0.6, scene)

    assert label(protocol_for("official", scene), scene) == "official@Q"
    assert exact.keys() == set(REGIONS)
    for region in REGIONS:
        assert exact[region]["avgerr"] == exact[region]["bad0.5"] == exact[region]["invalid"] == 0
        assert off[region]["avgerr"] == pytest.approx(2.4, abs=1e-4)
        assert off[region]["bad2.0"] == 100
        assert off[region]["bad4.0"] == 0
    counts = {region: values["pixels"] for region, values in exact.items()}
    assert counts["all"] == counts["nonocc"] + counts["occluded"] == np.isfinite(disparity).sum()
    assert min(counts["edges"], counts["textureless"]) > 0
