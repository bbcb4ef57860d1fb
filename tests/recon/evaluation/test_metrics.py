"""Errors summarised in numbers, each worked out by hand."""

import json

import numpy as np
import pytest

from recon.evaluation.metrics import (
    MEASURES,
    THRESHOLDS_PX,
    coverage_curve,
    error_histogram,
    measures,
    reliability_curve,
)

NAN = np.nan


def row(*values) -> np.ndarray:
    """Return an image of one row, (1, W) float32."""
    return np.array([values], dtype=np.float32)


def everywhere(values) -> np.ndarray:
    return np.ones(values.shape, dtype=bool)


def measured(*errors, truth=1000.0) -> dict:
    """Return the measures of a row of errors at one true disparity."""
    error = row(*errors)
    return measures(error, np.full_like(error, truth), everywhere(error))


def test_a_perfect_map_has_no_error():
    result = measured(0, 0, 0)

    assert result.pop("pixels") == 3
    assert set(result.values()) == {0}


def test_wrong_and_missing_pixels_add_up_to_bad_ones():
    result = measured(0.25, 0.75, 3, NAN)

    assert [result[f"wrong{threshold}"] for threshold in THRESHOLDS_PX] == [50, 25, 25, 0]
    assert result["invalid"] == 25
    assert [result[f"bad{threshold}"] for threshold in THRESHOLDS_PX] == [75, 50, 50, 25]


@pytest.mark.parametrize("threshold", THRESHOLDS_PX)
def test_an_error_of_exactly_the_threshold_is_not_bad(threshold):
    above = np.nextafter(np.float32(threshold), np.float32(9))

    result = measured(threshold, threshold, threshold, above)

    assert result[f"bad{threshold}"] == result[f"wrong{threshold}"] == 25


def test_averages_are_over_the_pixels_with_a_result():
    result = measured(1, 1, 4, NAN)

    assert result["avgerr"] == 2  # (1 + 1 + 4) / 3
    assert result["rms"] == pytest.approx(6**0.5, rel=1e-12)  # (1 + 1 + 16) / 3 = 6


def test_quantiles_are_the_errors_of_pixels_by_nearest_rank():
    errors = np.random.default_rng(3).permutation(np.arange(1, 201))  # 1 .. 200

    result = measured(*errors, NAN)

    # 50, 90, 95 and 99 % of 200 pixels
    assert [result[name] for name in ("A50", "A90", "A95", "A99")] == [100, 180, 190, 198]


def test_quantiles_between_two_pixels_take_the_larger_error():
    assert measured(1, 2, 3)["A50"] == 2  # rank ceil(1.5) = 2
    assert measured(1, 2, 3, 4)["A50"] == 2  # rank 2, not the mean of 2 and 3
    assert measured(1, 2, 3, 4)["A90"] == 4  # rank ceil(3.6)
    assert measured(7)["A50"] == measured(7)["A99"] == 7


def test_d1_asks_for_more_than_three_pixels_and_more_than_five_percent():
    error = row(4, 4, 2, 3, 5, NAN)
    truth = row(40, 100, 10, 10, 100, 10)
    # 4 px of 40 are 10 %: bad. 4 of 100 are 4 %: good. 2 px, 3 px: good. 5 of 100 are exactly
    # 5 %: good. No result: bad.

    result = measures(error, truth, everywhere(error))

    assert result["d1"] == pytest.approx(100 * 2 / 6)


def test_only_counted_pixels_count():
    error = row(0, 8, NAN, 1)
    truth = row(50, 50, NAN, 50)
    counted = np.array([[True, False, False, True]])

    result = measures(error, truth, counted)

    assert result["pixels"] == 2
    assert result["avgerr"] == 0.5
    assert result["bad0.5"] == 50
    assert result["invalid"] == result["d1"] == 0


def test_nothing_counted_gives_no_figure():
    error = row(1, 2)

    result = measures(error, error, ~everywhere(error))

    assert result.pop("pixels") == 0
    assert set(result.values()) == {None}


def test_a_map_without_any_result_is_all_bad_and_has_no_mean():
    result = measured(NAN, NAN)

    assert {result[f"bad{threshold}"] for threshold in THRESHOLDS_PX} == {100}
    assert {result[f"wrong{threshold}"] for threshold in THRESHOLDS_PX} == {0}
    assert result["invalid"] == result["d1"] == 100
    assert {result[name] for name in ("avgerr", "rms", "A50", "A90", "A95", "A99")} == {None}


@pytest.mark.parametrize("errors", [(1, 2, NAN), (NAN, NAN)])
def test_measures_have_their_names_and_go_into_json(errors):
    result = measured(*errors)

    assert tuple(result) == MEASURES
    assert json.loads(json.dumps(result, allow_nan=False)) == result


def test_means_keep_their_digits_over_many_pixels():
    error = np.full((300, 500), 0.1, dtype=np.float32)
    error[0, 0] = 20000

    result = measures(error, error, everywhere(error))

    expected = (149_999 * float(np.float32(0.1)) + 20000) / 150_000
    assert result["avgerr"] == pytest.approx(expected, rel=1e-12)


def test_the_coverage_curve_of_four_pixels():
    error, confidence = row(3, 2, 0, NAN), row(0.5, 0.7, 0.9, 0.8)
    # surest first: 0; 0, 2; 0, 2, 3; the fourth has no result and no place; 2 px are not bad

    curve = coverage_curve(error, confidence, everywhere(error), steps=4)

    assert curve["share"] == [25, 50, 75, 100]
    assert curve["bad2.0"] == pytest.approx([0, 0, 100 / 3, None])
    assert curve["avgerr"] == pytest.approx([0, 1, 5 / 3, None])
    assert curve["auc"] == pytest.approx(100 / 9)


def test_what_is_said_is_held_against_what_came_true():
    right, confidence = row(1, 0, 1, 1, 1) > 0, row(0.95, 0.91, 1.0, 0.25, 0.2)
    counted = row(1, 1, 1, 1, 0) > 0

    curve = reliability_curve(right, confidence, counted)

    assert curve["pixels"] == [0, 0, 1, 0, 0, 0, 0, 0, 0, 3]
    assert curve["said"] == pytest.approx([0, 0, 0.25, 0, 0, 0, 0, 0, 0, 2.86])
    assert curve["right"] == [0, 0, 1, 0, 0, 0, 0, 0, 0, 2]


def test_pixels_of_one_confidence_share_their_mean():
    error, confidence = row(0, 8, 1, 3), row(1, 0.5, 0.5, 0.5)
    # after the first pixel three equals: mean error 4, two of three bad

    curve = coverage_curve(error, confidence, everywhere(error), steps=4)

    assert curve["avgerr"] == pytest.approx([0, 4 / 2, 8 / 3, 12 / 4])
    assert curve["bad2.0"] == pytest.approx([0, 100 / 3, 400 / 9, 50])


def test_the_place_of_a_pixel_does_not_matter_to_the_coverage_curve():
    generator = np.random.default_rng(5)
    error = generator.exponential(2, (20, 30))
    error[generator.random(error.shape) < 0.1] = NAN
    confidence = np.round(generator.random(error.shape), 1)  # many equal ones

    curve = coverage_curve(error, confidence, everywhere(error))
    turned = coverage_curve(error[::-1, ::-1], confidence[::-1, ::-1], everywhere(error))

    for name in ("bad2.0", "avgerr"):
        assert curve[name] == pytest.approx(turned[name])


def test_shares_of_a_fraction_of_a_pixel_take_that_fraction():
    error, confidence = row(6, 0), row(0.1, 0.9)

    curve = coverage_curve(error, confidence, everywhere(error), steps=4)

    assert curve["avgerr"] == pytest.approx([0, 0, 3 / 1.5, 3])  # of 0.5, 1, 1.5 and 2 pixels


def test_the_last_share_of_a_dense_map_is_the_whole_map():
    generator = np.random.default_rng(7)
    error = generator.exponential(2, (20, 30))
    confidence = generator.random(error.shape)
    counted = generator.random(error.shape) < 0.6
    whole = measures(error, np.full_like(error, 99), counted)

    curve = coverage_curve(error, confidence, counted)

    assert curve["share"] == [5 * step for step in range(1, 21)]
    assert curve["bad2.0"][-1] == pytest.approx(whole["bad2.0"])
    assert curve["avgerr"][-1] == pytest.approx(whole["avgerr"])


@pytest.mark.parametrize("errors", [(), (NAN, NAN)])
def test_a_coverage_curve_of_no_result_has_no_point(errors):
    error = row(*errors)

    curve = coverage_curve(error, error, everywhere(error), steps=2)

    assert curve == {
        "share": [50, 100],
        "bad2.0": [None, None],
        "avgerr": [None, None],
        "auc": None,
    }


def test_errors_fall_into_quarter_pixels_and_two_open_ends():
    signed = row(-99, -4, -0.25, -0.01, 0, 0.24, 0.25, 3.99, 4, 99, NAN, 1)
    counted = everywhere(signed)
    counted[0, -1] = False

    result = error_histogram(signed, counted)

    edges, counts = result["edges"], result["counts"]
    assert edges == [-4 + 0.25 * number for number in range(33)]
    assert len(counts) == 34
    filled = {number: count for number, count in enumerate(counts) if count}
    # below -4; -4 .. -3.75; -0.25 .. 0; 0 .. 0.25; 0.25 .. 0.5; 3.75 .. 4; 4 and above
    assert filled == {0: 1, 1: 1, 16: 2, 17: 2, 18: 1, 32: 1, 33: 2}
    assert edges[16 - 1] == -0.25


def test_a_histogram_counts_as_its_edges_say():
    signed = np.random.default_rng(1).normal(0, 3, (50, 40)).astype(np.float32)
    inner = error_histogram(signed, everywhere(signed))

    expected, _ = np.histogram(signed, [-np.inf, *inner["edges"], np.inf])

    assert inner["counts"] == expected.tolist()
