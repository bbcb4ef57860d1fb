"""What stands in the report is of the row that it stands beside."""

from recon.evaluation.results import _curves


def entry(method, count):
    return {
        "method": method,
        "coverage": None,
        "reliability": None,
        "histogram": {"edges": [0.0], "counts": [count, 0]},
    }


def test_a_histogram_is_that_of_one_method_over_its_scenes():
    entries = [entry("ours", 3), entry("theirs", 50), entry("ours", 4)]

    curves = _curves(["ours", "theirs"], entries)

    assert curves["ours"]["histogram"]["counts"] == [7, 0]
    assert curves["theirs"]["histogram"]["counts"] == [50, 0]


def test_a_failed_scene_adds_nothing():
    entries = [entry("ours", 3), {"method": "ours", "error": "no truth"}]

    assert _curves(["ours"], entries)["ours"]["histogram"]["counts"] == [3, 0]
