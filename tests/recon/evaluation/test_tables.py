"""Means, and the two forms in which other programs read them."""

import csv
import io
import json

import pytest

from recon.evaluation.tables import csv_of, failures, mean_figures, whole_result
from recon.files import write_json

METHODS = {"ours": {"kind": "preset", "settings": {}}, "theirs": {"kind": "files", "settings": {}}}


def entry(method, scene, avgerr, *, dataset="middlebury-v3/Q", label="official@Q", **more):
    figures = {"nonocc": {"avgerr": avgerr, "bad2.0": 10 * avgerr, "pixels": 100}}
    return {
        "method": method,
        "dataset": dataset,
        "scene": scene,
        "size": [1000, 500],
        "disparities": [0, 99],
        "protocols": {label: figures},
        "depth": {"nonocc": {"median_relative": 0.01}},
        "cloud": None,
        "coverage": {"share": [50, 100], "bad2.0": [1.0, None], "avgerr": [1.0, None]},
        "reliability": None,
        "histogram": {"edges": [0, 1], "counts": [3]},
        "seconds": 2.0,
        "peak_mb": 800.0,
        "scoring_seconds": 0.1,
        **more,
    }


def result(entries, problems=()):
    return whole_result(
        entries,
        METHODS,
        protocols=("official",),
        versions={"numpy": "2"},
        command="reconstruct evaluate",
        problems=problems,
    )


def test_official_means_weigh_five_scenes_half():
    entries = [entry("ours", "Teddy", 1.0), entry("ours", "Vintage", 4.0)]

    found = result(entries)["methods"]["ours"]["protocol"]["official@Q"]

    assert found["mean"]["nonocc"]["avgerr"] == pytest.approx((1.0 + 0.5 * 4.0) / 1.5)
    assert found["plain_mean"]["nonocc"]["avgerr"] == pytest.approx(2.5)
    assert found["scenes_counted"] == 2


def test_other_protocols_weigh_all_scenes_the_same():
    entries = [entry("ours", name, e, label="zs-all") for name, e in (("Teddy", 1), ("Vintage", 4))]

    found = result(entries)["methods"]["ours"]["protocol"]["zs-all"]

    assert found["mean"]["nonocc"]["avgerr"] == found["plain_mean"]["nonocc"]["avgerr"] == 2.5


def test_a_failed_scene_is_a_row_and_no_part_of_the_mean():
    entries = [
        entry("ours", "Teddy", 1.0),
        {"method": "ours", "dataset": "middlebury-v3/Q", "scene": "Pipes", "error": "no truth"},
    ]

    found = result(entries)["methods"]["ours"]["protocol"]["official@Q"]

    assert found["scenes"]["Pipes"] == {"dataset": "middlebury-v3/Q", "error": "no truth"}
    assert found["mean"]["nonocc"]["avgerr"] == 1.0
    assert (found["scenes_counted"], found["scenes_failed"]) == (1, 1)
    assert failures(entries) == ["ours on middlebury-v3/Q/Pipes: no truth"]


def test_where_all_scenes_failed_they_stand_under_what_was_asked_for():
    entries = [{"method": "ours", "dataset": "x", "scene": "a", "error": "no truth"}]

    found = result(entries)["methods"]["ours"]["protocol"]

    assert found["official"]["scenes"]["a"]["error"] == "no truth"
    assert found["official"]["mean"] == {}


def test_scenes_of_another_benchmark_stand_under_its_own_protocol():
    entries = [
        entry("ours", "Teddy", 1.0),
        entry("ours", "000002_10", 3.0, dataset="kitti/2015", label="kitti"),
        {"method": "ours", "dataset": "kitti/2015", "scene": "000003_10", "error": "cut off"},
    ]

    found = result(entries)["methods"]["ours"]["protocol"]

    assert list(found["official@Q"]["scenes"]) == ["Teddy"]
    assert list(found["kitti"]["scenes"]) == ["000002_10", "000003_10"]


def test_scenes_that_share_a_name_keep_that_of_their_data_set():
    entries = [entry("ours", "Art", 1.0, dataset=d, label="own-size") for d in ("a", "b")]

    found = result(entries)["methods"]["ours"]["protocol"]["own-size"]["scenes"]

    assert list(found) == ["a/Art", "b/Art"]


def test_times_are_given_by_size_and_by_hypotheses():
    figures = result([entry("ours", "Teddy", 1.0)])["methods"]["ours"]["protocol"]["official@Q"]
    scene = figures["scenes"]["Teddy"]

    assert scene["seconds"] == 2.0
    assert scene["seconds_per_mp"] == 4.0  # 0.5 MP
    assert scene["seconds_per_gdisp"] == pytest.approx(2.0 / 0.05)  # 0.5 MP x 100 / 1000


def test_the_mean_passes_over_what_a_scene_lacks():
    scenes = [
        {"nonocc": {"avgerr": 1.0, "pixels": 5}, "peak_mb": 7.0},
        {"nonocc": {"avgerr": None, "pixels": 0}, "peak_mb": 9.0, "cloud": None},
        {"nonocc": {"avgerr": 4.0, "pixels": 6}, "seconds": None, "coverage": {"share": [1]}},
    ]

    mean = mean_figures(scenes, [1.0, 1.0, 2.0])

    assert mean == {"nonocc": {"avgerr": 3.0, "pixels": 11}, "peak_mb": 9.0}


def test_the_json_has_the_keys_that_others_read(tmp_path):
    entries = [entry("ours", "Teddy", 1.0), entry("theirs", "Teddy", 2.0, seconds=None)]
    write_json(tmp_path / "results.json", result(entries, problems=["x is no data set"]))

    read = json.loads((tmp_path / "results.json").read_text())

    assert read.keys() == {"methods", "problems", "versions", "command"}
    protocol = read["methods"]["ours"]["protocol"]["official@Q"]
    assert protocol["mean"]["nonocc"]["avgerr"] == 1.0
    assert protocol["mean"]["nonocc"]["bad2.0"] == 10.0
    assert protocol["plain_mean"].keys() == protocol["mean"].keys()
    assert {"nonocc", "seconds", "peak_mb"} <= protocol["scenes"]["Teddy"].keys()
    assert read["methods"]["theirs"]["kind"] == "files"


def test_the_csv_has_one_row_a_region_of_every_scene_and_mean():
    entries = [
        entry("ours", "Teddy", 1.0),
        {"method": "ours", "dataset": "middlebury-v3/Q", "scene": "Pipes", "error": "no, truth"},
    ]

    rows = list(csv.DictReader(io.StringIO(csv_of(result(entries)))))

    by_scene = {row["scene"]: row for row in rows}
    assert by_scene.keys() == {"(weighted mean)", "(plain mean)", "Teddy", "Pipes"}
    assert by_scene["Teddy"]["avgerr"] == "1.0"
    assert by_scene["Teddy"]["region"] == "nonocc"
    assert by_scene["Teddy"]["depth.nonocc.median_relative"] == "0.01"
    assert by_scene["Pipes"]["error"] == "no, truth"
