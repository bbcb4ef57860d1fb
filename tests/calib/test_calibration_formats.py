import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import (
    CalibrationRecord,
    RectifiedGeometry,
    read_calibration,
    write_calibration,
)
from calib.formats import READERS, WRITERS, CalibrationFile

GEOMETRY = RectifiedGeometry((640, 480), 511.3, (311.25, 243.5), (318.75, 243.5), 0.1234)

MIDDLEBURY = """cam0=[500.5 0 310.25; 0 500.5 240.75; 0 0 1]
cam1=[500.5 0 322.5; 0 500.5 240.75; 0 0 1]
doffs=12.25
baseline=121.5
width=640
height=480
ndisp=96
isint=0
"""
MIDDLEBURY_GEOMETRY = RectifiedGeometry(
    (640, 480), 500.5, (310.25, 240.75), (322.5, 240.75), 0.1215
)

KITTI_ROWS = {
    "P0": "700 0 600 0 0 700 180 0 0 0 1 0",
    "P1": "700 0 600 -378 0 700 180 0 0 0 1 0",
    "P2": "700 0 600 42 0 700 180 0.2 0 0 1 0.003",
    "P3": "700 0 600 -329 0 700 180 2.1 0 0 1 0.003",
}
KITTI_RAW = """calib_time: 01-Jan-2020 10:00:00
corner_dist: 9.95e-02
S_02: 1.4e+03 5.2e+02
K_02: 960 0 696 0 957 224 0 0 1
D_02: -0.37 0.2 0.001 0.0005 -0.07
R_02: 1 0 0 0 1 0 0 0 1
T_02: 0.06 0 0
S_rect_02: 1.24e+03 3.76e+02
P_rect_02: 720 0 610 43.2 0 720 173 0 0 0 1 0
S_03: 1.4e+03 5.2e+02
K_03: 904 0 695 0 902 224 0 0 1
D_03: -0.36 0.18 0.0006 -0.0004 -0.05
R_03: 0.9999995 -0.001 0 0.001 0.9999995 0 0 0 1
T_03: -0.47 0 0
S_rect_03: 1.24e+03 3.76e+02
P_rect_03: 720 0 610 -338.4 0 720 173 0 0 0 1 0
"""

TAGGED_XML = """<?xml version="1.0" ?>
<data>
  <distorted_left_intrinsic>
    <fx>130</fx><fy>131</fy><cx>80</cx><cy>60</cy><dist>-0.2, 0.1, 0.001, 0, -0.04</dist>
  </distorted_left_intrinsic>
  <distorted_right_intrinsic>
    <fx>132</fx><fy>133</fy><cx>81</cx><cy>61</cy><dist>-0.21, 0.11, 0, 0.002, -0.05</dist>
  </distorted_right_intrinsic>
  <stereo_extrinsic>
    <rotation>1, 0, 0, 0, 1, 0, 0, 0, 1</rotation>
    <translation>-0.13, 0.001, -0.002</translation>
  </stereo_extrinsic>
</data>
"""


def yaml_matrix(name, rows, cols, numbers):
    return (
        f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n"
        f"   data: [ {', '.join(str(number) for number in numbers)} ]\n"
    )


MATRIX_LEFT = [100.0, 0, 80, 0, 101, 60, 0, 0, 1]
MATRIX_RIGHT = [102.0, 0, 81, 0, 103, 61, 0, 0, 1]
IDENTITY = [1.0, 0, 0, 0, 1, 0, 0, 0, 1]
LENS = [-0.2, 0.1, 0.001, 0.002, -0.03]


def yaml_intrinsics(left=("M1", "D1"), right=("M2", "D2"), lens=LENS):
    return (
        yaml_matrix(left[0], 3, 3, MATRIX_LEFT)
        + yaml_matrix(left[1], 1, len(lens), lens)
        + yaml_matrix(right[0], 3, 3, MATRIX_RIGHT)
        + yaml_matrix(right[1], len(lens), 1, lens)
    )


def yaml_extrinsics(t=(-0.12, 0.001, 0), names=("R", "T")):
    return yaml_matrix(names[0], 3, 3, IDENTITY) + yaml_matrix(names[1], 3, 1, t)


HEAD = "%YAML:1.0\n---\n"
SIZE = "imageSize: [ 160, 120 ]\n"


@pytest.fixture
def write(tmp_path):
    def write_text(text, name="calib.txt"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write_text


def assert_same_rig(one, other, rel=0.0):
    for came, expected in ((one.left, other.left), (one.right, other.right)):
        assert (came.size, came.model) == (expected.size, expected.model)
        np.testing.assert_allclose(came.K, expected.K, rtol=rel)
        np.testing.assert_allclose(came.distortion, expected.distortion, rtol=rel)
    np.testing.assert_allclose(one.right_from_left.R, other.right_from_left.R, rtol=rel)
    np.testing.assert_allclose(one.right_from_left.t, other.right_from_left.t, rtol=rel)


def assert_same_geometry(one, other):
    assert replace(one, baseline_m=1.0) == replace(other, baseline_m=1.0)
    assert one.baseline_m == pytest.approx(other.baseline_m, rel=1e-14)


# Round trips


@pytest.mark.parametrize("ending", [".json", ".yml", ".yaml", ".xml"])
@pytest.mark.parametrize("lens", ["four", "five", "rational", "thin_prism", "tilted", "fisheye"])
def test_raw_and_rectified_come_back_exactly(lens, ending, make_rig, tmp_path):
    path, rig = tmp_path / f"calib{ending}", make_rig(lens)
    record = CalibrationRecord(rig, GEOMETRY, path, "json")

    write_calibration(path, record)

    came = read_calibration(path)
    assert_same_rig(came.raw, rig)
    assert_same_geometry(came.rectified, GEOMETRY)
    assert came.notes == ()
    assert came.source == path


@pytest.mark.parametrize("ending", [".json", ".yml", ".xml", ".txt"])
def test_a_geometry_alone_comes_back(ending, tmp_path):
    path = tmp_path / f"calib{ending}"

    write_calibration(path, GEOMETRY)

    came = read_calibration(path)
    assert came.raw is None
    assert_same_geometry(came.rectified, GEOMETRY)


@pytest.mark.parametrize("ending", [".json", ".yml", ".xml"])
def test_a_rig_alone_comes_back(ending, make_rig, tmp_path):
    path, rig = tmp_path / f"calib{ending}", make_rig()

    write_calibration(path, rig)

    came = read_calibration(path)
    assert came.rectified is None
    assert_same_rig(came.raw, rig)


@pytest.mark.parametrize("ending", [".json", ".yml"])
def test_cameras_without_distortion_come_back_without(ending, make_rig, tmp_path):
    path = tmp_path / f"calib{ending}"

    write_calibration(path, make_rig("ideal"))

    assert not read_calibration(path).raw.left.distortion.any()


@pytest.mark.parametrize("ending", [".json", ".txt"])
def test_the_range_of_disparities_comes_back(ending, tmp_path):
    path = tmp_path / f"calib{ending}"

    write_calibration(path, CalibrationRecord(None, GEOMETRY, path, "json", range(70)))

    assert read_calibration(path).disparities == range(70)


def test_the_json_names_its_units(tmp_path):
    write_calibration(tmp_path / "calib.json", GEOMETRY)

    content = json.loads((tmp_path / "calib.json").read_text())
    assert content["rectified"] == {
        "size_px": [640, 480],
        "focal_px": 511.3,
        "centre_left_px": [311.25, 243.5],
        "centre_right_px": [318.75, 243.5],
        "baseline_m": 0.1234,
    }


def test_writing_leaves_one_file_and_replaces_an_older_one(tmp_path):
    path = tmp_path / "calib.json"
    path.write_text("older")

    write_calibration(path, GEOMETRY)

    assert [entry.name for entry in tmp_path.iterdir()] == ["calib.json"]
    assert read_calibration(path).rectified == GEOMETRY


def test_a_failed_writing_leaves_the_older_file(make_rig, tmp_path):
    path = tmp_path / "calib.txt"
    path.write_text("older")

    with pytest.raises(ValueError, match="holds a rectified geometry only; write"):
        write_calibration(path, make_rig())
    assert path.read_text() == "older"


def test_an_interrupted_writing_leaves_the_older_file_alone(tmp_path, monkeypatch):
    path = tmp_path / "calib.json"
    path.write_text("older")

    def fail(*_):
        raise OSError("disk is gone")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(OSError, match="disk is gone"):
        write_calibration(path, GEOMETRY)
    assert [entry.name for entry in tmp_path.iterdir()] == ["calib.json"]
    assert path.read_text() == "older"


@pytest.mark.parametrize(
    ("name", "error", "message"),
    [
        ("calib.toml", ValueError, r"ends in .json, .yml, .yaml, .xml, .txt; got '.toml'"),
        ("nowhere/calib.json", FileNotFoundError, "there is no folder .*nowhere to write"),
    ],
)
def test_a_place_that_cannot_be_written_is_refused(name, error, message, tmp_path):
    with pytest.raises(error, match=message):
        write_calibration(tmp_path / name, GEOMETRY)


@pytest.mark.parametrize(
    ("name", "format", "message"),
    [
        ("calib.yaml", "yaml", "format must be one of json, opencv, middlebury, .*; got 'yaml'"),
        ("left.txt", "ros", r"a ros calibration file ends in .yaml, .yml; got '.txt'"),
        ("calib.yaml", "json", r"a json calibration file ends in .json; got '.yaml'"),
    ],
)
def test_a_format_that_does_not_fit_is_refused(name, format, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        write_calibration(tmp_path / name, GEOMETRY, format=format)
    assert list(tmp_path.iterdir()) == []


NAMES = {
    "json": "calib.json",
    "opencv": "left.yaml",
    "middlebury": "calib.txt",
    "ros": "left.yaml",
    "kalibr": "left.yaml",
    "kitti": "calib.txt",
    "colmap": "cameras.txt",
}


@pytest.mark.parametrize(
    ("format", "raw"),
    [*((name, False) for name in NAMES), *((name, True) for name in NAMES if name != "middlebury")],
)
def test_a_written_file_is_told_from_all_other_formats(format, raw, make_rig, tmp_path):
    path = tmp_path / NAMES[format]

    write_calibration(path, make_rig("four") if raw else GEOMETRY, format=format)

    assert read_calibration(path).format == format


@pytest.mark.parametrize(
    "text",
    [
        HEAD + SIZE + "distortion_model: plumb_bob\n" + yaml_intrinsics() + yaml_extrinsics(),
        HEAD + yaml_matrix("camera_matrix", 3, 3, MATRIX_LEFT),
        yaml_matrix("camera_matrix", 3, 3, MATRIX_LEFT),
    ],
    ids=["head", "one_camera", "no_head"],
)
def test_opencvs_yaml_is_told_from_ros(text, write):
    file = CalibrationFile(write(text), text)

    assert [name for name, reader in READERS.items() if reader.recognises(file)] == ["opencv"]


@pytest.mark.parametrize("older", [("left.yaml", "right.yaml"), ("right.yaml",), ()])
def test_two_files_are_written_both_or_neither(older, tmp_path, monkeypatch):
    for name in older:
        (tmp_path / name).write_text("older")
    replace_file = Path.replace

    def fail_at_the_second(path, target):
        if target.name == "right.yaml":
            raise OSError("disk is gone")
        return replace_file(path, target)

    monkeypatch.setattr(Path, "replace", fail_at_the_second)
    with pytest.raises(OSError, match="disk is gone"):
        write_calibration(tmp_path / "left.yaml", GEOMETRY, format="ros")
    assert sorted(entry.name for entry in tmp_path.iterdir()) == sorted(older)
    assert all((tmp_path / name).read_text() == "older" for name in older)


def test_opencv_files_hold_one_lens_model_only(make_rig, make_camera, tmp_path):
    rig = replace(make_rig("five"), right=make_camera("fisheye"))

    with pytest.raises(ValueError, match="two cameras of one model; write"):
        write_calibration(tmp_path / "calib.yml", rig)


# Middlebury


def test_middlebury_is_in_millimetres_with_a_range_of_disparities(write):
    record = read_calibration(write(MIDDLEBURY))

    assert record.format == "middlebury"
    assert record.rectified == MIDDLEBURY_GEOMETRY
    assert record.rectified.disparity_at_infinity == -12.25
    assert record.disparities == range(96)
    assert record.raw is None


@pytest.mark.parametrize(
    "text",
    [
        MIDDLEBURY.replace("=", "= ").replace("[", "[ ").replace("]", " ] ").replace(";", " ;"),
        MIDDLEBURY.replace("\n", "\r\n"),
        "\ufeff" + MIDDLEBURY.replace("\n", " \n "),
        "\n\n" + MIDDLEBURY.replace("; ", ";\n"),
    ],
    ids=["blanks", "windows", "indented", "broken_lines"],
)
def test_middlebury_is_read_however_it_is_spaced(text, write):
    assert read_calibration(write(text)).rectified == MIDDLEBURY_GEOMETRY


def test_middlebury_without_doffs_takes_it_from_the_matrices(write):
    text = MIDDLEBURY.replace("doffs=12.25\n", "")

    assert read_calibration(write(text)).rectified == MIDDLEBURY_GEOMETRY


# KITTI


def kitti(*names):
    return "".join(f"{name}: {KITTI_ROWS[name]}\n" for name in names)


def test_kitti_prefers_the_colour_cameras(write):
    path = write(kitti("P0", "P1", "P2", "P3") + "Tr: 1 0 0 0 0 1 0 0 0 0 1 0\n")

    record = read_calibration(path, image_size=(1240, 370))

    assert_same_geometry(
        record.rectified, RectifiedGeometry((1240, 370), 700, (600, 180), (600, 180), 0.53)
    )
    assert record.notes == ("cameras 2 and 3 (colour) were taken, not 0 and 1 (grey)",)


@pytest.mark.parametrize(
    "text",
    [kitti("P0", "P1"), f"{KITTI_ROWS['P0']}\n{KITTI_ROWS['P1']}"],
    ids=["named", "bare"],
)
def test_kitti_takes_the_grey_cameras_where_there_are_no_others(text, write):
    record = read_calibration(write(text), image_size=(1240, 370))

    assert record.format == "kitti"
    assert record.rectified.baseline_m == pytest.approx(0.54)
    assert record.notes == ()


def test_kitti_gives_both_the_raw_and_the_rectified_rig(write):
    record = read_calibration(write(KITTI_RAW))

    rig = record.raw
    assert_same_geometry(
        record.rectified, RectifiedGeometry((1240, 376), 720, (610, 173), (610, 173), 0.53)
    )
    assert rig.left.size == (1400, 520)
    assert rig.left.K[0, 0] == 960
    assert rig.right.distortion[1] == 0.18
    # x_3 = R_3 x_0 + T_3 and x_2 = x_0 + T_2
    np.testing.assert_allclose(rig.right_from_left.t, [-0.53, -6e-5, 0], atol=1e-6)


@pytest.mark.parametrize(("size", "part"), [((1400, 520), "raw"), ((1240, 376), "rectified")])
def test_the_size_of_the_images_picks_the_raw_or_the_rectified_part(size, part, write):
    other = {"raw": "rectified", "rectified": "raw"}[part]

    record = read_calibration(write(KITTI_RAW), image_size=size)

    assert getattr(record, part) is not None
    assert getattr(record, other) is None
    assert f"the {other} part is for" in record.notes[-1]


# K.txt and tagged XML


@pytest.mark.parametrize("separator", [" ", "\n", ", "])
def test_k_txt_is_a_matrix_and_a_baseline_in_metres(separator, write):
    numbers = ["700.5", "0.0", "320", "0", "700.5", "240", "0", "0", "1.0"]

    record = read_calibration(write(separator.join(numbers) + " \n0.063\n"), image_size=(640, 480))

    assert record.format == "k_txt"
    assert_same_geometry(
        record.rectified, RectifiedGeometry((640, 480), 700.5, (320, 240), (320, 240), 0.063)
    )


def test_tagged_xml_gives_the_raw_cameras(write):
    record = read_calibration(write(TAGGED_XML, "head.xml"), image_size=(160, 120))

    assert record.format == "tagged_xml"
    np.testing.assert_array_equal(record.raw.right.K, [[132, 0, 81], [0, 133, 61], [0, 0, 1]])
    np.testing.assert_array_equal(record.raw.left.distortion, [-0.2, 0.1, 0.001, 0, -0.04])
    np.testing.assert_array_equal(record.raw.right_from_left.t, [-0.13, 0.001, -0.002])
    assert "a baseline of 0.13" in record.notes[0]


# OpenCV


SPELLINGS = [
    (("M1", "D1"), ("M2", "D2"), ("R", "T")),
    (("K1", "D1"), ("K2", "D2"), ("R", "T")),
    (("cameraMatrix1", "distCoeffs1"), ("cameraMatrix2", "distCoeffs2"), ("R", "T")),
    (
        ("camera_matrix_left", "distortion_coefficients_left"),
        ("camera_matrix_right", "distortion_coefficients_right"),
        ("rotation_matrix", "translation_vector"),
    ),
    (("Left_Camera_Matrix", "Left_Dist"), ("Right_Camera_Matrix", "Right_Dist"), ("R", "Trans")),
    (("cameraMatrixL", "distCoeffsL"), ("cameraMatrixR", "distCoeffsR"), ("R", "T")),
]


@pytest.mark.parametrize("size", [SIZE, "image_width: 160\nimage_height: 120\n", None])
@pytest.mark.parametrize(("left", "right", "pose"), SPELLINGS)
def test_opencv_is_read_by_any_of_the_names_in_use(left, right, pose, size, write):
    path = write(HEAD + yaml_intrinsics(left, right) + yaml_extrinsics(names=pose) + (size or ""))

    record = read_calibration(path, image_size=None if size else (160, 120))

    rig = record.raw
    assert record.format == "opencv"
    assert rig.left.size == (160, 120)
    np.testing.assert_array_equal(rig.left.K.ravel(), MATRIX_LEFT)
    np.testing.assert_array_equal(rig.right.K.ravel(), MATRIX_RIGHT)
    np.testing.assert_array_equal(rig.right.distortion, LENS)
    np.testing.assert_array_equal(rig.right_from_left.t, [-0.12, 0.001, 0])


@pytest.mark.parametrize("named", ["intrinsics.yml", "extrinsics.yml"])
def test_either_half_of_an_opencv_pair_finds_the_other(named, write, tmp_path):
    write(HEAD + yaml_intrinsics(), "intrinsics.yml")
    write(HEAD + yaml_extrinsics(), "extrinsics.yml")

    rig = read_calibration(tmp_path / named, image_size=(160, 120)).raw

    np.testing.assert_array_equal(rig.left.K.ravel(), MATRIX_LEFT)
    assert rig.baseline_m == pytest.approx(0.12, abs=1e-4)


def test_an_opencv_rotation_may_be_a_vector(write):
    turn = yaml_matrix("R", 3, 1, [0, 0, np.pi / 2]) + yaml_matrix("T", 3, 1, [-0.1, 0, 0])

    rig = read_calibration(write(HEAD + SIZE + yaml_intrinsics() + turn)).raw

    quarter = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    np.testing.assert_allclose(rig.right_from_left.R, quarter, atol=1e-15)


def test_opencv_projections_give_the_rectified_geometry_too(write):
    P1 = yaml_matrix("P1", 3, 4, [90, 0, 70, 0, 0, 90, 55, 0, 0, 0, 1, 0])
    P2 = yaml_matrix("P2", 3, 4, [90, 0, 72, -10.8, 0, 90, 55, 0, 0, 0, 1, 0])
    text = HEAD + SIZE + yaml_intrinsics() + yaml_extrinsics() + P1 + P2

    record = read_calibration(write(text))

    assert_same_geometry(
        record.rectified, RectifiedGeometry((160, 120), 90, (70, 55), (72, 55), 0.12)
    )
    assert read_calibration(write(HEAD + SIZE + P1 + P2)).raw is None


@pytest.mark.parametrize("text", ["model: fisheye\n", "model: Kannala-Brandt\n", "fisheye: 1\n"])
def test_an_opencv_file_may_be_of_a_fisheye(text, write):
    lens = yaml_intrinsics(lens=[0.1, 0.02, 0.003, 0.0004])

    record = read_calibration(write(HEAD + SIZE + text + lens + yaml_extrinsics()))

    assert record.raw.left.model == "fisheye"
    assert len(record.notes) == 1  # of the unit


def test_four_coefficients_of_an_unnamed_model_are_noted(write):
    lens = yaml_intrinsics(lens=[0.1, 0.02, 0.003, 0.0004])

    record = read_calibration(write(HEAD + SIZE + lens + yaml_extrinsics()))

    assert record.raw.left.model == "pinhole"
    assert "add 'model: fisheye'" in record.notes[1]


def test_an_opencv_file_without_its_head_is_read(write):
    record = read_calibration(write(SIZE + yaml_intrinsics() + yaml_extrinsics()))

    np.testing.assert_array_equal(record.raw.left.K.ravel(), MATRIX_LEFT)


@pytest.mark.parametrize(
    ("length", "unit", "stated", "baseline_m", "notes"),
    [
        (0.12, None, "", 0.12, 1),
        (9.9, None, "", 9.9, 1),
        (120, None, "", 0.12, 1),
        (12, "cm", "", 0.12, 0),
        (120, "mm", "", 0.12, 0),
        (12, "m", "", 12, 0),
        (12, None, "unit: cm\n", 0.12, 0),
        (12, "mm", "unit: cm\n", 0.012, 0),
    ],
)
def test_a_length_without_a_unit_is_guessed_and_noted(
    length, unit, stated, baseline_m, notes, write
):
    P1 = yaml_matrix("P1", 3, 4, [90, 0, 70, 0, 0, 90, 55, 0, 0, 0, 1, 0])
    P2 = yaml_matrix("P2", 3, 4, [90, 0, 72, -90 * length, 0, 90, 55, 0, 0, 0, 1, 0])
    text = HEAD + SIZE + stated + yaml_intrinsics() + yaml_extrinsics((-length, 0, 0)) + P1 + P2

    record = read_calibration(write(text), unit=unit)

    assert record.raw.baseline_m == pytest.approx(baseline_m)
    assert record.rectified.baseline_m == pytest.approx(baseline_m)
    assert len(record.notes) == notes


# Errors


def opencv(text):
    return HEAD + SIZE + text


GOOD_JSON = {
    "format": "stereo-recon calibration",
    "version": 1,
    "rectified": {
        "size_px": [640, 480],
        "focal_px": 500,
        "centre_left_px": [320, 240],
        "centre_right_px": [320, 240],
        "baseline_m": 0.1,
    },
}


def own_json(**changes):
    return json.dumps({**GOOD_JSON, **changes})


def own_rectified(**changes):
    return own_json(rectified={**GOOD_JSON["rectified"], **changes})


ERRORS = {
    "garbage": ("hello world", r"unknown calibration format, the file begins with 'hello world'"),
    "empty": ("", "unknown calibration format"),
    "no_doffs_agreement": (
        MIDDLEBURY.replace("doffs=12.25", "doffs=3"),
        r"doffs is 3 px but cx1 - cx0 is 12.25 px",
    ),
    "swapped": (
        MIDDLEBURY.replace("baseline=", "baseline=-"),
        r"baseline must be positive, got -0.1215 m; are the left and right cameras swapped\?",
    ),
    "no_baseline": (MIDDLEBURY.replace("baseline=121.5\n", ""), "there is no baseline="),
    "cut_matrix": (MIDDLEBURY[:70], r"cam1 must be \[fx 0 cx; .* is it cut off\?"),
    "short_matrix": (MIDDLEBURY.replace("0 0 1]", "0 0]"), "cam0 must be 9 numbers, got 8"),
    "word_for_number": (
        MIDDLEBURY.replace("width=640", "width=wide"),
        "width must be 1 numbers, got 'wide'",
    ),
    "infinite": (MIDDLEBURY.replace("baseline=121.5", "baseline=inf"), "baseline must be finite"),
    "no_size_middlebury": (
        MIDDLEBURY.replace("width=640\nheight=480\n", ""),
        r"does not say for which image size it is; give image_size=\(width, height\)",
    ),
    "only_width": (MIDDLEBURY.replace("height=480\n", ""), "there is no height="),
    "two_focal_lengths": (
        MIDDLEBURY.replace("cam1=[500.5", "cam1=[510"),
        "focal lengths of a rectified pair agree, got 500.5, 500.5, 510, 500.5 px",
    ),
    "no_size_kitti": (kitti("P0", "P1"), "give image_size"),
    "one_camera": (kitti("P2"), "there are no projections of two cameras; .* got P2; is the file"),
    "short_row": (kitti("P2", "P3")[:-20], "P3 must be 12 numbers, got 6; is the file cut off"),
    "cut_k": ("700 0 320 0 700 240 0 0 1", r"\(9\) and baseline .* must be 10 numbers, got 9"),
    "cut_bare_row": (KITTI_ROWS["P0"] + "\n700 0 600", "must be 10 numbers, got 15"),
    "transposed_k": ("700 0 0 0 700 0 320 240 1 0.1", r"must end with 0 0 1, got \[320.0, 240.0"),
    "cut_xml": (TAGGED_XML[:400], "not valid XML .* is the file cut off"),
    "xml_without_pose": (
        TAGGED_XML.replace("translation", "shift"),
        "no element <stereo_extrinsic> <translation>",
    ),
    "cut_yaml": (opencv(yaml_intrinsics()[:-30]), "OpenCV cannot read it; is the file cut off"),
    "yaml_count": (
        opencv(yaml_intrinsics() + yaml_matrix("R", 3, 3, [1, 0]) + yaml_matrix("T", 3, 1, [1])),
        "matrix R cannot be read: its numbers are not rows x cols",
    ),
    "no_translation": (
        opencv(yaml_intrinsics()),
        "neither a translation T between the cameras nor projections P1 and P2; got imagesize, m1",
    ),
    "no_matrix": (opencv(yaml_extrinsics()), "no camera matrix of the left camera"),
    "no_rotation": (
        opencv(yaml_intrinsics() + yaml_matrix("T", 3, 1, [-0.1, 0, 0])),
        "a translation T between the cameras but no rotation R",
    ),
    "no_baseline_opencv": (
        opencv(yaml_intrinsics() + yaml_extrinsics((0, 0, 0))),
        "baseline must be positive, got 0 m; is the translation missing",
    ),
    "mirror": (
        opencv(yaml_intrinsics() + yaml_extrinsics()).replace(
            "1.0, 0, 0, 0, 1,", "-1, 0, 0, 0, 1,"
        ),
        "R is not a rotation",
    ),
    "long_baseline": (
        opencv(yaml_intrinsics() + yaml_extrinsics((-20_000, 0, 0))),
        "stand 20000 apart in a unit that the file does not say; say the unit with --unit",
    ),
    "unknown_unit": (
        opencv("unit: inch\n" + yaml_intrinsics() + yaml_extrinsics()),
        "unit must be m, cm or mm, got 'inch'",
    ),
    "unknown_model": (
        opencv("model: mirror\n" + yaml_intrinsics() + yaml_extrinsics()),
        "camera model must be pinhole or fisheye, got 'mirror'",
    ),
    "six_coefficients": (
        opencv(yaml_intrinsics(lens=[0.1] * 6) + yaml_extrinsics()),
        r"0, 4, 5, 8, 12, 14 coefficients, got shape \(6,\)",
    ),
    "no_size_opencv": (HEAD + yaml_intrinsics() + yaml_extrinsics(), "give image_size"),
    "cut_json": (own_json()[:-5], "not valid JSON .* is the file cut off"),
    "newer_json": (own_json(version=2), "version is 2 but this program reads 1"),
    "json_not_object": (own_json(rectified=[1]), r"rectified must be an object \{...\}, got \[1\]"),
    "json_key": (
        own_json(rectified={"size_px": [1, 1]}),
        "there is no rectified.focal_px; got size",
    ),
    "json_shape": (
        own_rectified(size_px=[1]),
        r"rectified.size_px must have shape \(2,\), got \(1,\)",
    ),
    "json_word": (own_rectified(focal_px="f"), "rectified.focal_px must be numbers, got 'f'"),
    "json_nothing": (own_json(rectified=None), "must hold raw cameras or a rectified geometry"),
    "json_swapped": (own_rectified(baseline_m=-0.12), "baseline must be positive, got -0.12 m"),
}


@pytest.mark.parametrize(("text", "message"), ERRORS.values(), ids=ERRORS)
def test_a_file_that_cannot_be_used_is_named_with_its_fault(text, message, write):
    path = write(text)

    with pytest.raises(ValueError, match=message) as error:
        read_calibration(path)
    assert str(error.value).startswith(f"{path}: ")


def test_an_unknown_format_lists_the_known_ones(write):
    with pytest.raises(ValueError, match="known formats are") as error:
        read_calibration(write("hello"))

    for reader in READERS.values():
        assert reader.looks_like in str(error.value)


def test_an_extrinsics_file_alone_asks_for_its_other_half(write):
    with pytest.raises(ValueError, match=r"other half my_intrinsics.yml beside it"):
        read_calibration(write(opencv(yaml_extrinsics()), "my_extrinsics.yml"))
    with pytest.raises(ValueError, match=r"other half my_extrinsics.xml beside it"):
        read_calibration(write(opencv(yaml_intrinsics()), "my_intrinsics.xml"))


def test_a_calibration_for_other_images_is_refused(write):
    with pytest.raises(ValueError, match=r"is for 640 x 480 images but the images are 320 x 240"):
        read_calibration(write(MIDDLEBURY), image_size=(320, 240))


def test_what_is_no_file_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"there is no calibration file .*missing.txt"):
        read_calibration(tmp_path / "missing.txt")
    with pytest.raises(ValueError, match="is a folder; give the calibration file in it"):
        read_calibration(tmp_path)


def test_an_unknown_unit_is_refused(write):
    with pytest.raises(ValueError, match="unit must be m, cm, mm or None, got 'inch'"):
        read_calibration(write(MIDDLEBURY), unit="inch")


def test_bytes_that_are_no_text_are_an_unknown_format(tmp_path):
    path = tmp_path / "calib.bin"
    path.write_bytes(bytes(range(256)) * 4)

    with pytest.raises(ValueError, match="unknown calibration format"):
        read_calibration(path)


def test_every_written_format_can_be_read():
    assert WRITERS.keys() <= READERS.keys()
    assert WRITERS.keys() == NAMES.keys()
