import json

import numpy as np
import pytest
from comparing import POINTS, assert_see_alike, seen_by, turned
from lenses import rotation

from calib import Pose, RectifiedGeometry, read_calibration, write_calibration

CAMERAS = """# Camera list with one line of data per camera:
#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]
# Number of cameras: 3
1 OPENCV 640 480 500.5 501.25 320 240 -0.2 0.05 0.001 -0.002
2 SIMPLE_RADIAL 640 480 510.5 322 238.5 -0.1
7 PINHOLE 320 240 300 300 160 120
"""
# From COLMAP's documentation of rigs.txt.
QUATERNION = (
    -0.9999701516465348,
    -0.0011120266840749639,
    -0.0075347911527510894,
    0.0012985125893421306,
)
T = (-0.19316906391350164, 0.00085222218993398979, 0.0070758955539026785)
POSE = " ".join(map(repr, QUATERNION + T))
RIGS = f"""# Rig calib list with one line of data per calib:
#   RIG_ID, NUM_SENSORS, REF_SENSOR_TYPE, REF_SENSOR_ID, SENSORS[] as (SENSOR_TYPE, ...)
# Number of rigs: 1
1 2 CAMERA 1 CAMERA 2 1 {POSE}
"""
CONFIG = [
    {
        "cameras": [
            {
                "image_prefix": "rig1/camera1/",
                "ref_sensor": True,
                "camera_model_name": "OPENCV",
                "camera_params": [500.5, 501.25, 320, 240, -0.2, 0.05, 0.001, -0.002],
            },
            {
                "image_prefix": "rig1/camera2/",
                "cam_from_rig_rotation": list(QUATERNION),
                "cam_from_rig_translation": list(T),
                "camera_model_name": "SIMPLE_RADIAL",
                "camera_params": [510.5, 322, 238.5, -0.1],
            },
        ]
    }
]


@pytest.fixture
def write(tmp_path):
    """Write cameras.txt and rigs.txt, and return the path of the first."""

    def write_texts(cameras=CAMERAS, rigs=RIGS):
        for name, text in (("cameras.txt", cameras), ("rigs.txt", rigs)):
            if text is not None:
                (tmp_path / name).write_text(text)
        return tmp_path / "cameras.txt"

    return write_texts


@pytest.fixture
def write_config(tmp_path):
    def write_json(content):
        path = tmp_path / "rig_config.json"
        path.write_text(content if isinstance(content, str) else json.dumps(content))
        return path

    return write_json


def one_camera(line):
    """cameras.txt with this for the left camera."""
    first = CAMERAS.splitlines()[3]
    return CAMERAS.replace(first, f"1 {line}")


# What the numbers mean


def test_pixels_have_their_centres_half_a_pixel_further(write):
    """COLMAP calls the middle of the top-left pixel (0.5, 0.5)."""
    expected = seen_by("pinhole", np.array([[500.5, 0, 320], [0, 501.25, 240], [0, 0, 1]]),
                       [-0.2, 0.05, 0.001, -0.002], POINTS)  # fmt: skip

    left = read_calibration(write()).raw.left

    np.testing.assert_allclose(left.project(POINTS) + 0.5, expected)
    np.testing.assert_array_equal(left.K[:2, 2], [319.5, 239.5])


@pytest.mark.parametrize(
    ("line", "K", "lens"),
    [
        ("SIMPLE_PINHOLE 640 480 500 320 240", (500, 500, 320, 240), (0, 0, 0, 0, 0, 0, 0, 0)),
        ("PINHOLE 640 480 500 501 320 240", (500, 501, 320, 240), (0, 0, 0, 0, 0, 0, 0, 0)),
        ("SIMPLE_RADIAL 640 480 500 320 240 .1", (500, 500, 320, 240), (0.1, 0, 0, 0, 0, 0, 0, 0)),
        ("RADIAL 640 480 500 320 240 .1 .2", (500, 500, 320, 240), (0.1, 0.2, 0, 0, 0, 0, 0, 0)),
        (
            "FULL_OPENCV 640 480 500 501 320 240 .1 .2 .003 .004 .05 .06 .07 .08",
            (500, 501, 320, 240),
            (0.1, 0.2, 0.003, 0.004, 0.05, 0.06, 0.07, 0.08),
        ),
    ],
)
def test_lenses_bend_as_colmap_says(line, K, lens, write):
    """The formulas of COLMAP's camera models, with the centres of its pixels."""
    k1, k2, p1, p2, k3, k4, k5, k6 = lens
    u, v = (POINTS[:, :2] / POINTS[:, 2:]).T
    r2 = u**2 + v**2
    radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    x = K[0] * (u * radial + 2 * p1 * u * v + p2 * (r2 + 2 * u**2)) + K[2]
    y = K[1] * (v * radial + 2 * p2 * u * v + p1 * (r2 + 2 * v**2)) + K[3]

    left = read_calibration(write(one_camera(line))).raw.left

    np.testing.assert_allclose(left.project(POINTS) + 0.5, np.column_stack([x, y]))


def test_a_fisheye_is_opencvs(write):
    K = np.array([[300.0, 0, 320], [0, 301, 240], [0, 0, 1]])
    expected = seen_by("fisheye", K, [0.03, -0.01, 0.004, -0.001], POINTS)
    line = "OPENCV_FISHEYE 640 480 300 301 320 240 0.03 -0.01 0.004 -0.001"

    left = read_calibration(write(one_camera(line))).raw.left

    assert left.model == "fisheye"
    np.testing.assert_allclose(left.project(POINTS) + 0.5, expected)


@pytest.mark.parametrize("given", ["cameras.txt", "rigs.txt"])
def test_the_pose_carries_points_of_the_reference_into_the_other_camera(given, write):
    """Hamilton's rotation q p q^-1 of a point, by the product of quaternions."""
    w, x, y, z = QUATERNION
    left_product = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    right_product = np.array([[w, x, y, z], [-x, w, -z, y], [-y, z, w, -x], [-z, -y, x, w]])
    points = np.column_stack([np.zeros(len(POINTS)), POINTS])
    expected = (points @ (left_product @ right_product).T)[:, 1:] + T

    rig = read_calibration(write().with_name(given)).raw

    np.testing.assert_allclose(rig.right_from_left.apply(POINTS), expected, atol=1e-12)


def test_a_quarter_turn_about_y_is_the_documented_quaternion(write):
    """0.7071 0 0.7071 0 turns z into x."""
    pose = "0.7071067811865475 0 0.7071067811865476 0 0 0 -0.1"

    rig = read_calibration(write(rigs=f"1 2 CAMERA 1 CAMERA 2 1 {pose}\n")).raw

    # The centre of camera 2 is then -R^T t = (-0.1, 0, 0): it stands at the left.
    assert rig.left.K[0, 0] == 510.5
    np.testing.assert_allclose(
        rig.right_from_left.inverse().R, [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=1e-15
    )


def test_the_configuration_is_read_as_the_model_is(write, write_config):
    of_model = read_calibration(write())

    of_config = read_calibration(write_config(CONFIG), image_size=(640, 480))

    assert of_config.format == of_model.format == "colmap"
    assert_see_alike(of_config.raw, of_model.raw, tolerance_px=0)


# Units and what is left out


@pytest.mark.parametrize(("unit", "factor"), [("m", 1), ("cm", 0.01), ("mm", 0.001)])
def test_the_scale_is_noted_unless_the_caller_knows_it(unit, factor, write):
    length = np.linalg.norm(T)

    guessed, known = read_calibration(write()), read_calibration(write(), unit=unit)

    assert guessed.raw.baseline_m == pytest.approx(length)
    assert "unit of length is arbitrary" in guessed.notes[0]
    assert known.raw.baseline_m == pytest.approx(length * factor)
    assert known.notes == ()


def test_further_cameras_and_rigs_are_noted(write):
    rigs = f"3 1 CAMERA 7\n1 4 CAMERA 1 IMU 4 1 1 0 0 0 0 0 0 CAMERA 2 1 {POSE} CAMERA 7 0\n"

    record = read_calibration(write(rigs=rigs), unit="m")

    assert record.raw.right.K[0, 0] == 510.5
    assert record.notes == (
        "cameras 1 and 2 of rig 1 were taken, not 7",
        "rig 1 was taken, the first with two cameras of 2 rigs",
    )


def test_further_cameras_of_a_configuration_are_noted(write_config):
    rig = {"cameras": [*CONFIG[0]["cameras"], {"image_prefix": "rig1/camera3/"}]}

    record = read_calibration(write_config([{"cameras": []}, rig]), image_size=(640, 480))

    assert (
        record.notes[0] == "cameras rig1/camera1/ and rig1/camera2/ were taken, not rig1/camera3/"
    )


def test_a_reference_at_the_right_is_the_right_camera(write):
    rigs = "1 2 CAMERA 2 CAMERA 1 1 1 0 0 0 0.2 0 0\n"

    record = read_calibration(write(rigs=rigs), unit="m")

    assert (record.raw.left.K[0, 0], record.raw.right.K[0, 0]) == (500.5, 510.5)
    np.testing.assert_array_equal(record.raw.right_from_left.t, [-0.2, 0, 0])
    assert record.notes == (
        "camera 1 stands to the left of camera 2: it was taken as the left camera",
    )


# Round trips


@pytest.mark.parametrize("name", ["cameras.txt", "rigs.txt", "rig_config.json"])
@pytest.mark.parametrize("lens", ["ideal", "four", "five", "rational", "fisheye"])
@pytest.mark.parametrize("spread", [0.03, 1.5])
def test_a_rig_comes_back(name, lens, spread, make_rig, rng, tmp_path):
    for _ in range(5):
        rig = turned(make_rig(lens), rng, spread=spread)

        write_calibration(tmp_path / name, rig, format="colmap")

        record = read_calibration(tmp_path / name, image_size=(160, 120), unit="m")
        assert_see_alike(record.raw, rig)


def test_a_half_turn_comes_back(make_rig, tmp_path):
    rig = make_rig("four")
    R = rotation(0, 0, np.pi)
    rig = type(rig)(rig.left, rig.right, Pose(R, -R @ [0.1, 0, 0]))

    write_calibration(tmp_path / "rigs.txt", rig, format="colmap")

    assert_see_alike(read_calibration(tmp_path / "rigs.txt").raw, rig)


@pytest.mark.parametrize("name", ["cameras.txt", "rig_config.json"])
def test_a_geometry_alone_comes_back(name, tmp_path):
    geometry = RectifiedGeometry((160, 120), 90.25, (70.25, 55.5), (72.25, 55.5), 0.123)

    write_calibration(tmp_path / name, geometry, format="colmap")

    record = read_calibration(tmp_path / name, image_size=(160, 120))
    assert (record.raw, record.rectified) == (None, geometry)


def test_both_files_are_written(make_rig, tmp_path):
    write_calibration(tmp_path / "rigs.txt", make_rig(), format="colmap")

    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["cameras.txt", "rigs.txt"]


# Errors

ERRORS = {
    "cut_camera": (
        CAMERAS[: CAMERAS.index(" -0.002")],
        RIGS,
        r"camera 1 of cameras.txt: a OPENCV camera has 8 parameters .*, got 7; is the file cut",
    ),
    "cut_size": (
        CAMERAS[: CAMERAS.index(" 480")],
        RIGS,
        "camera 1 of cameras.txt must have a model, width, .* got '1 OPENCV 640'; is the file cut",
    ),
    "cut_rig": (CAMERAS, RIGS[:-60], "a line of rigs.txt ends before its pose; is the file cut"),
    "words": (one_camera("PINHOLE 640 480 f f 1 1"), RIGS, "must be 6 numbers, got '640 480 f f"),
    "other_lens": (
        one_camera("FOV 640 480 500 500 320 240 0.9"),
        RIGS,
        "camera model FOV cannot be read, only SIMPLE_PINHOLE, .* colmap image_undistorter",
    ),
    "no_pose": (
        CAMERAS,
        "1 2 CAMERA 1 CAMERA 2 0\n",
        "rigs.txt has no pose of camera 2 in rig 1",
    ),
    "no_rig": (CAMERAS, "1 1 CAMERA 1\n2 1 CAMERA 2\n", "holds no rig of two cameras"),
    "no_camera": (
        CAMERAS.replace("\n2 ", "\n5 "),
        RIGS,
        "rig 1 has camera 2, but cameras.txt holds 1, 5, 7; are both files of one model",
    ),
    "no_quaternion": (
        CAMERAS,
        RIGS.replace("-0.99997", "-0.89997"),
        r"quaternion \(w, x, y, z\) of length 1, got .* of length 0.9",
    ),
    "no_number": (CAMERAS, "1 x CAMERA 1 CAMERA 2\n1 2 CAMERA 1", "number of sensors, got 'x'"),
    "sizes": (
        CAMERAS.replace("L 640 480", "L 640 360"),
        RIGS,
        "both must have the same size",
    ),
}


@pytest.mark.parametrize(("cameras", "rigs", "message"), ERRORS.values(), ids=ERRORS)
@pytest.mark.parametrize("given", ["cameras.txt", "rigs.txt"])
def test_a_model_that_cannot_be_used_is_named_with_its_fault(cameras, rigs, message, given, write):
    path = write(cameras, rigs).with_name(given)

    with pytest.raises(ValueError, match=message) as error:
        read_calibration(path)
    assert str(error.value).startswith(f"{path}: ")


@pytest.mark.parametrize(("cameras", "rigs"), [(CAMERAS, None), (None, RIGS)])
def test_a_missing_half_is_named(cameras, rigs, write, tmp_path):
    write(cameras, rigs)
    (there,) = tmp_path.iterdir()
    missing = "rigs.txt" if rigs is None else "cameras.txt"

    with pytest.raises(ValueError, match=f"expected {missing} beside {there.name}"):
        read_calibration(there)


def test_binary_models_are_refused_with_what_to_do(tmp_path):
    (tmp_path / "cameras.bin").write_bytes(bytes(100))

    with pytest.raises(ValueError, match="colmap model_converter --output_type TXT"):
        read_calibration(tmp_path / "cameras.bin")


def changed(camera, **changes):
    cameras = [dict(entry) for entry in CONFIG[0]["cameras"]]
    cameras[camera].update(changes)
    return [{"cameras": [{k: v for k, v in one.items() if v is not None} for one in cameras]}]


CONFIG_ERRORS = {
    "cut": (json.dumps(CONFIG)[:-20], "not valid JSON .* is the file cut off"),
    "one_camera": ([{"cameras": CONFIG[0]["cameras"][:1]}], "no rig of two cameras"),
    "no_reference": (changed(0, ref_sensor=None), '"ref_sensor": true, got 0 of them'),
    "no_pose": (
        changed(1, cam_from_rig_rotation=None),
        r"there is no \[0\].cameras\[1\].cam_from_rig_rotation; got image_prefix",
    ),
    "short": (changed(1, cam_from_rig_translation=[1, 2]), r"must have shape \(3,\), got \(2,\)"),
    "no_lens": (
        changed(1, camera_params=None),
        "camera_model_name and camera_params are missing, .* give rigs.txt",
    ),
}


@pytest.mark.parametrize(("content", "message"), CONFIG_ERRORS.values(), ids=CONFIG_ERRORS)
def test_a_configuration_that_cannot_be_used_is_named_with_its_fault(
    content, message, write_config
):
    with pytest.raises(ValueError, match=message):
        read_calibration(write_config(content), image_size=(640, 480))


def test_a_configuration_needs_the_size_of_the_images(write_config):
    with pytest.raises(ValueError, match="give image_size"):
        read_calibration(write_config(CONFIG))


def test_what_colmap_cannot_hold_is_refused(make_rig, tmp_path):
    with pytest.raises(ValueError, match="has 8 lens coefficients, the camera has 12"):
        write_calibration(tmp_path / "rigs.txt", make_rig("thin_prism"), format="colmap")
    with pytest.raises(ValueError, match=r"cameras.txt and rigs.txt, got rig.txt"):
        write_calibration(tmp_path / "rig.txt", make_rig(), format="colmap")
    assert list(tmp_path.iterdir()) == []
