import re

import cv2
import numpy as np
import pytest
from comparing import POINTS, assert_see_alike, rectified_pixels, seen_by, turned
from lenses import LENSES, rotation

from calib import (
    CalibrationRecord,
    RectifiedGeometry,
    Rectifier,
    read_calibration,
    write_calibration,
)

SIZE = (160, 120)
K_LEFT = np.array([[112.0, 0, 78.5], [0, 113, 61], [0, 0, 1]])
K_RIGHT = np.array([[114.0, 0, 83], [0, 115, 59.25], [0, 0, 1]])
R = rotation(0.02, -0.03, 0.015)
T = np.array([-0.12, 0.004, -0.006])
ROS_MODELS = {
    "plumb_bob": ("pinhole", LENSES["five"][1]),
    "rational_polynomial": ("pinhole", LENSES["rational"][1]),
    "equidistant": ("fisheye", LENSES["fisheye"][1]),
    "fisheye": ("fisheye", LENSES["fisheye"][1]),
}


def rows(matrix):
    return ", ".join(f"{number:.17g}" for number in np.ravel(matrix))


def matrix_text(name, matrix, rows_and_columns=None):
    height, width = rows_and_columns or np.shape(matrix)
    return f"{name}:\n  rows: {height}\n  cols: {width}\n  data: [{rows(matrix)}]\n"


def camera_text(K, lens, R, P, *, model="plumb_bob", name="narrow_stereo/left"):
    """What camera_calibration saves of one camera."""
    return (
        f"image_width: {SIZE[0]}\nimage_height: {SIZE[1]}\ncamera_name: {name}\n"
        + matrix_text("camera_matrix", K)
        + (f"distortion_model: {model}\n" if model else "")
        + matrix_text("distortion_coefficients", lens, (1, len(lens)))
        + matrix_text("rectification_matrix", R)
        + matrix_text("projection_matrix", P)
    )


def message_text(K, lens, R, P, *, model="plumb_bob", style=("DKRP", False)):
    """What `rostopic echo` prints, or with blocks what `ros2 topic echo` does."""
    (d, k, r, p), blocks = style

    def numbers(values):
        if not blocks:
            return f" [{rows(values)}]"
        return "".join(f"\n- {value:.17g}" for value in np.ravel(values))

    return (
        "header:\n  seq: 4\n  stamp:\n    secs: 10\n    nsecs: 5\n  frame_id: 'left'\n"
        f"height: {SIZE[1]}\nwidth: {SIZE[0]}\ndistortion_model: {model}\n"
        f"{d}:{numbers(lens)}\n{k}:{numbers(K)}\n{r}:{numbers(R)}\n{p}:{numbers(P)}\n"
        "binning_x: 0\nbinning_y: 0\nroi:\n  x_offset: 0\n  y_offset: 0\n  height: 0\n"
        "  width: 0\n  do_rectify: False\n---\n"
    )


def stereo_rectified(kind, lens):
    """Return R and P of both cameras as camera_calibration computes them from R and T."""
    lens = np.array(lens, dtype=float)
    if kind == "fisheye":
        turn, flags = np.array(T)[:, None], cv2.CALIB_ZERO_DISPARITY
        return cv2.fisheye.stereoRectify(K_LEFT, lens, K_RIGHT, lens, SIZE, R, turn, flags)[:4]
    return cv2.stereoRectify(K_LEFT, lens, K_RIGHT, lens, SIZE, R, T[:, None], alpha=0)[:4]


@pytest.fixture
def pair(tmp_path):
    """Write left.yaml and right.yaml of a known rig; `text` makes one of them."""

    def write(model="plumb_bob", text=camera_text, names=("left.yaml", "right.yaml"), **changes):
        kind, lens = ROS_MODELS[model]
        R_left, R_right, P_left, P_right = stereo_rectified(kind, lens)
        sides = (K_LEFT, R_left, P_left), (K_RIGHT, R_right, P_right)
        for name, (K, turn, P) in zip(names, sides, strict=True):
            path = tmp_path / name
            path.parent.mkdir(exist_ok=True)
            path.write_text(text(K, lens, turn, P, **{"model": model, **changes}))
        return tmp_path / names[0], tmp_path / names[1]

    return write


# What the numbers mean


@pytest.mark.parametrize("model", ROS_MODELS)
def test_the_rig_is_the_one_that_was_calibrated(model, pair):
    left, _ = pair(model)
    kind, lens = ROS_MODELS[model]

    record = read_calibration(left)

    rig = record.raw
    assert record.format == "ros"
    assert record.notes == ()
    assert (rig.left.size, rig.left.model) == (SIZE, kind)
    np.testing.assert_array_equal(rig.left.K, K_LEFT)
    np.testing.assert_array_equal(rig.right.K, K_RIGHT)
    np.testing.assert_array_equal(rig.left.distortion, lens)
    np.testing.assert_allclose(rig.right_from_left.R, R, atol=1e-12)
    np.testing.assert_allclose(rig.right_from_left.t, T, atol=1e-12)


@pytest.mark.parametrize("model", ["plumb_bob", "equidistant"])
def test_raw_and_rectified_views_see_a_point_where_ros_says(model, pair):
    """P of the message projects points of the left rectified frame, which R turns into."""
    left, _ = pair(model)
    kind, lens = ROS_MODELS[model]
    R_left, R_right, P_left, P_right = stereo_rectified(kind, lens)
    rectified_frame = np.column_stack([POINTS @ R_left.T, np.ones(len(POINTS))])
    expected = [rectified_frame @ P.T for P in (P_left, P_right)]
    expected = [(pixels / pixels[:, 2:])[:, :2] for pixels in expected]

    record = read_calibration(left)

    in_right = POINTS @ record.raw.right_from_left.R.T + record.raw.right_from_left.t
    for K, turn, P, points, pixels in (
        (K_LEFT, R_left, P_left, POINTS, expected[0]),
        (K_RIGHT, R_right, P_right, in_right, expected[1]),
    ):
        raw = seen_by(kind, K, lens, points)
        np.testing.assert_allclose(rectified_pixels(kind, K, lens, turn, P, raw), pixels, atol=1e-4)
    geometry = record.rectified
    depth = (
        geometry.focal_px
        * geometry.baseline_m
        / (expected[0][:, 0] - expected[1][:, 0] - geometry.disparity_at_infinity)
    )
    np.testing.assert_allclose(depth, rectified_frame[:, 2], rtol=1e-9)


def test_the_rectified_geometry_is_that_of_p(tmp_path):
    K = np.array([[90.0, 0, 70], [0, 90, 55], [0, 0, 1]])
    for name, P in (
        ("left.yaml", [90, 0, 70, 0, 0, 90, 55, 0, 0, 0, 1, 0]),
        ("right.yaml", [90, 0, 72, -10.8, 0, 90, 55, 0, 0, 0, 1, 0]),
    ):
        lens = [-0.2, 0.1, 0, 0, 0]
        (tmp_path / name).write_text(camera_text(K, lens, np.eye(3), np.reshape(P, (3, 4))))

    record = read_calibration(tmp_path / "left.yaml")

    assert record.rectified.baseline_m == pytest.approx(0.12)
    assert (record.rectified.centre_left, record.rectified.centre_right) == ((70, 55), (72, 55))
    np.testing.assert_allclose(record.raw.right_from_left.t[1:], 0, atol=1e-15)


def test_cameras_that_are_rectified_already_are_not_raw(tmp_path):
    geometry = RectifiedGeometry(SIZE, 90, (70, 55), (72, 55), 0.12)

    write_calibration(tmp_path / "left.yaml", geometry, format="ros")

    record = read_calibration(tmp_path / "left.yaml")
    assert record.raw is None
    assert record.rectified.baseline_m == pytest.approx(0.12)
    assert record.rectified.centre_right == (72, 55)
    assert "the images were taken as rectified" in record.notes[0]


def test_projections_that_are_not_rectified_leave_the_raw_cameras(tmp_path):
    """As some drivers publish them: P is the raw camera matrix."""
    for name, K, shift in (("left.yaml", K_LEFT, 0.0), ("right.yaml", K_RIGHT, -11.4)):
        P = np.column_stack([K, [shift, 0, 0]])
        (tmp_path / name).write_text(camera_text(K, LENSES["five"][1], np.eye(3), P))

    record = read_calibration(tmp_path / "left.yaml")

    assert record.rectified is None
    assert "only the raw cameras were taken" in record.notes[0]
    np.testing.assert_allclose(record.raw.right_from_left.t, [-0.1, 0, 0], atol=1e-15)


# How the files may look


@pytest.mark.parametrize(
    "names",
    [
        ("left.yaml", "right.yaml"),
        ("LEFT.yml", "RIGHT.yml"),
        ("stereoLeft.yaml", "stereoRight.yaml"),
        ("bright_left.yaml", "bright_right.yaml"),
        ("rig_l.yaml", "rig_r.yaml"),
        ("rig-l_640.yaml", "rig-r_640.yaml"),
        ("cam0.yaml", "cam1.yaml"),
        ("camera_0.yaml", "camera_1.yaml"),
        ("left/info.yaml", "right/info.yaml"),
        ("left/left.yaml", "right/right.yaml"),
        ("right_rig/left.yaml", "right_rig/right.yaml"),
        ("left_of_car/cam0_left.yaml", "left_of_car/cam1_right.yaml"),
    ],
)
def test_either_file_finds_the_other(names, pair):
    paths = pair(names=names)

    first, second = (read_calibration(path) for path in paths)

    assert_see_alike(first.raw, second.raw, tolerance_px=0)
    np.testing.assert_array_equal(first.raw.left.K, K_LEFT)
    assert first.source == paths[0]
    assert first.rectified == second.rectified


@pytest.mark.parametrize("style", [("DKRP", False), ("dkrp", False), ("dkrp", True)])
def test_a_message_is_read_as_the_file_is(style, pair):
    of_file = read_calibration(pair()[0])

    of_message = read_calibration(pair(text=message_text, style=style)[1])

    assert_see_alike(of_message.raw, of_file.raw, tolerance_px=0)
    assert of_message.rectified == of_file.rectified


def test_one_file_may_hold_both_cameras(pair, tmp_path):
    left, right = pair()
    whole = "".join(
        f"{path.stem}:\n" + "".join(f"  {line}\n" for line in path.read_text().splitlines())
        for path in (right, left)
    )
    expected = read_calibration(left)
    (tmp_path / "rig.yaml").write_text(whole)

    record = read_calibration(tmp_path / "rig.yaml")

    assert_see_alike(record.raw, expected.raw, tolerance_px=0)


def test_a_lens_without_a_model_is_plumb_bob_as_in_ros(pair):
    expected = read_calibration(pair()[0])

    record = read_calibration(pair(model="plumb_bob", text=without_model)[0])

    assert_see_alike(record.raw, expected.raw, tolerance_px=0)


def without_model(K, lens, R, P, **_):
    return camera_text(K, lens, R, P, model=None)


@pytest.mark.parametrize(("unit", "factor"), [("m", 1), ("cm", 0.01), ("mm", 0.001)])
def test_a_unit_of_the_caller_overrides_metres(unit, factor, pair):
    left, _ = pair()

    record = read_calibration(left, unit=unit)

    assert record.raw.baseline_m == pytest.approx(np.linalg.norm(T) * factor)
    assert record.rectified.baseline_m == pytest.approx(np.linalg.norm(T) * factor)


# Round trips


@pytest.mark.parametrize("lens", ["ideal", "four", "five", "rational", "fisheye"])
@pytest.mark.parametrize("named", ["left.yaml", "right.yaml"])
def test_a_rig_comes_back(lens, named, make_rig, rng, tmp_path):
    for _ in range(5):
        rig = turned(make_rig(lens), rng, spread=0.03)

        write_calibration(tmp_path / named, rig, format="ros")

        record = read_calibration(tmp_path / "left.yaml")
        assert sorted(entry.name for entry in tmp_path.iterdir()) == ["left.yaml", "right.yaml"]
        assert_see_alike(record.raw, rig)
        rectified = Rectifier(rig).geometry
        assert record.rectified.focal_px == rectified.focal_px
        assert record.rectified.centre_right == rectified.centre_right
        assert record.rectified.baseline_m == pytest.approx(rectified.baseline_m)


def test_a_rectified_geometry_of_its_own_is_kept(make_rig, tmp_path):
    rig = make_rig("five")
    geometry = RectifiedGeometry(SIZE, 101.5, (77, 58), (81, 58), rig.baseline_m)
    record = CalibrationRecord(rig, geometry, tmp_path, "json")

    write_calibration(tmp_path / "left.yaml", record, format="ros")

    came = read_calibration(tmp_path / "right.yaml").rectified
    assert (came.focal_px, came.centre_left, came.centre_right) == (101.5, (77, 58), (81, 58))


def test_what_is_written_rectifies_the_photographs(make_rig, tmp_path):
    rig = make_rig("five")

    write_calibration(tmp_path / "left.yaml", rig, format="ros")

    rectifier = Rectifier(rig)
    for side, camera in (("left", rig.left), ("right", rig.right)):
        text = (tmp_path / f"{side}.yaml").read_text()
        data = [
            line.split("[")[1].rstrip("]").split(",") for line in text.splitlines() if "[" in line
        ]
        turn, P = np.array(data[2], float).reshape(3, 3), np.array(data[3], float).reshape(3, 4)
        pixels = np.array([[20.0, 30], [80, 60], [140, 100]])
        np.testing.assert_allclose(
            rectified_pixels("pinhole", camera.K, camera.distortion, turn, P, pixels),
            rectifier.points(pixels, side),
            atol=1e-2,  # OpenCV's iteration
        )


def test_each_camera_may_have_a_folder(make_rig, tmp_path):
    (tmp_path / "left").mkdir()
    with pytest.raises(FileNotFoundError, match=r"there is no folder .*right to write info.yaml"):
        write_calibration(tmp_path / "left" / "info.yaml", make_rig("five"), format="ros")
    assert list((tmp_path / "left").iterdir()) == []
    (tmp_path / "right").mkdir()

    write_calibration(tmp_path / "left" / "info.yaml", make_rig("five"), format="ros")

    assert_see_alike(read_calibration(tmp_path / "right" / "info.yaml").raw, make_rig("five"))


# Errors


def test_a_missing_other_half_is_named(pair):
    left, right = pair()
    right.unlink()

    with pytest.raises(ValueError, match=r"expected the other one in .*right.yaml, but there is"):
        read_calibration(left)


@pytest.mark.parametrize("name", ["ost.yaml", "bright.yaml", "lens.yaml", "cam2.yaml"])
def test_a_name_without_a_side_is_refused(name, pair):
    left, _ = pair()
    camera = left.rename(left.with_name(name))

    with pytest.raises(ValueError, match=r"name does not say which; call the two files left.yaml"):
        read_calibration(camera)
    with pytest.raises(ValueError, match=r"the name must say which: .*; got rig.yaml"):
        write_calibration(
            left.with_name("rig.yaml"),
            RectifiedGeometry(SIZE, 90, (70, 55), (72, 55), 0.12),
            format="ros",
        )


CHANGES = {
    "cut": (lambda text: text[:-40], "line 20: .*cut off"),
    "cut_earlier": (
        lambda text: text[: text.index("projection_matrix")],
        "there is no projection_matrix; got image_width, .* is the file cut off",
    ),
    "short": (
        lambda text: text.replace("0, 0, 1]", "0, 1]", 1),
        "camera_matrix.data must be 3 x 3 numbers, got 8; is the file cut off",
    ),
    "wrong_size": (
        lambda text: text.replace("rows: 3\n  cols: 4", "rows: 4\n  cols: 3"),
        "projection_matrix must be 3 x 4, got 4 x 3",
    ),
    "unknown_lens": (
        lambda text: text.replace("plumb_bob", "omni"),
        "distortion_model must be plumb_bob, .*; got 'omni'",
    ),
    "not_calibrated": (
        lambda text: text.replace("data: [112", "data: [0"),
        "camera_matrix has no inverse, got .* is the camera not calibrated",
    ),
    "no_focal_length": (
        lambda text: re.sub(
            r"(cols: 4\n  data: \[.*?, .*?, .*?, .*?, .*?, )[^,]*", r"\g<1>0", text
        ),
        "projection_matrix has no inverse",
    ),
    "words": (
        lambda text: text.replace("data: [112", "data: [f"),
        "camera_matrix.data must be numbers",
    ),
}


@pytest.mark.parametrize(("change", "message"), CHANGES.values(), ids=CHANGES)
@pytest.mark.parametrize("given", [0, 1], ids=["given", "beside"])
def test_a_damaged_file_is_named_with_its_fault(change, message, given, pair):
    paths = pair()
    paths[0].write_text(change(paths[0].read_text()))

    with pytest.raises(ValueError, match=message) as error:
        read_calibration(paths[given])
    assert paths[0].name in str(error.value)


def test_swapped_files_are_refused(pair):
    left, _ = pair(names=("right.yaml", "left.yaml"))

    with pytest.raises(ValueError, match=r"baseline must be positive, .* swapped"):
        read_calibration(left)


@pytest.mark.parametrize(
    ("shift", "message"),
    [
        ([0, -11.2, 0], "stand one above the other"),
        ([11.2, 0, 0], "baseline must be positive, got -0.1 m; are the left and right .* swapped"),
    ],
)
def test_cameras_that_are_not_side_by_side_are_refused(shift, message, tmp_path):
    K = np.array([[112.0, 0, 78.5], [0, 112, 61], [0, 0, 1]])
    for name, column in (("left.yaml", [0, 0, 0]), ("right.yaml", shift)):
        P = np.column_stack([K, column])
        (tmp_path / name).write_text(camera_text(K, [0.0] * 5, np.eye(3), P))

    with pytest.raises(ValueError, match=message):
        read_calibration(tmp_path / "left.yaml")


def test_cameras_calibrated_one_by_one_are_refused(tmp_path):
    P = np.column_stack([K_LEFT, np.zeros(3)])
    for name in ("left.yaml", "right.yaml"):
        (tmp_path / name).write_text(camera_text(K_LEFT, [0.0] * 5, np.eye(3), P))

    with pytest.raises(ValueError, match=r"no -f B .* as a stereo pair"):
        read_calibration(tmp_path / "left.yaml")


def test_a_mirror_is_no_rotation(pair):
    left, _ = pair(text=lambda K, lens, R, P, **_: camera_text(K, lens, np.diag([-1, 1, 1]) @ R, P))

    with pytest.raises(ValueError, match="R is not a rotation"):
        read_calibration(left)


def test_a_baseline_in_millimetres_is_asked_about(pair):
    def in_millimetres(K, lens, R, P, **_):
        return camera_text(K, lens, R, P * [1, 1, 1, 1000])

    left, _ = pair(text=in_millimetres)

    with pytest.raises(ValueError, match=r"stand 120.* m apart, as ROS files are in metres; was"):
        read_calibration(left)
    assert read_calibration(left, unit="mm").raw.baseline_m == pytest.approx(np.linalg.norm(T))


@pytest.mark.parametrize(
    ("old", "new"), [("binning_x: 0", "binning_x: 2"), ("y_offset: 0", "y_offset: 8")]
)
def test_a_message_of_cropped_or_binned_images_is_refused(old, new, pair):
    left, _ = pair(text=message_text)
    left.write_text(left.read_text().replace(old, new))

    with pytest.raises(ValueError, match="binned or cropped in the camera"):
        read_calibration(left)


def test_what_ros_cannot_hold_is_refused(make_rig, tmp_path):
    path, rig = tmp_path / "left.yaml", make_rig("five")
    wide = RectifiedGeometry((200, 120), 90, (70, 55), (72, 55), rig.baseline_m)
    long = RectifiedGeometry(SIZE, 90, (70, 55), (72, 55), 0.3)

    with pytest.raises(ValueError, match="up to 8 coefficients, the camera has 12"):
        write_calibration(path, make_rig("thin_prism"), format="ros")
    with pytest.raises(ValueError, match="hold one image size"):
        write_calibration(path, CalibrationRecord(rig, wide, path, "json"), format="ros")
    with pytest.raises(ValueError, match="are they of one rig"):
        write_calibration(path, CalibrationRecord(rig, long, path, "json"), format="ros")
    assert list(tmp_path.iterdir()) == []
