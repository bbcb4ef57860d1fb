import numpy as np
import pytest
from comparing import POINTS, assert_see_alike, turned
from lenses import rotation

from calib import RectifiedGeometry, read_calibration, write_calibration

R = rotation(0.02, -0.04, 0.01)
CHAIN = f"""cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.277, 0.067, 0.00088, 0.00012]
  distortion_model: radtan
  intrinsics: [461.6, 460.2, 362.7, 246.0]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [{", ".join(map(repr, R[0].tolist()))}, -0.11]
  - [{", ".join(map(repr, R[1].tolist()))}, 0.0004]
  - [{", ".join(map(repr, R[2].tolist()))}, -0.0009]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [0.01, 0.02, -0.003, 0.0004]
  distortion_model: equidistant
  intrinsics: [459.2, 458.9, 370.1, 251.3]
  resolution: [752, 480]
  rostopic: /cam1/image_raw
"""
T = np.array([-0.11, 0.0004, -0.0009])


@pytest.fixture
def write(tmp_path):
    def write_text(text, name="camchain-rig.yaml"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write_text


def radtan(x, y, k1, k2, r1, r2):
    """Kalibr's radial-tangential lens, on the plane z = 1."""
    square = x**2 + y**2
    radial = 1 + k1 * square + k2 * square**2
    return (
        x * radial + 2 * r1 * x * y + r2 * (square + 2 * x**2),
        y * radial + 2 * r2 * x * y + r1 * (square + 2 * y**2),
    )


def equidistant(x, y, k1, k2, k3, k4):
    """Kalibr's equidistant lens, on the plane z = 1."""
    r = np.hypot(x, y)
    angle = np.arctan(r)
    bent = angle * (1 + k1 * angle**2 + k2 * angle**4 + k3 * angle**6 + k4 * angle**8)
    return x * bent / r, y * bent / r


def test_both_cameras_see_a_point_where_kalibr_says(write):
    x, y, z = POINTS.T
    expected_left = np.column_stack(radtan(x / z, y / z, -0.277, 0.067, 0.00088, 0.00012))
    x, y, z = (POINTS @ R.T + T).T  # T_cn_cnm1 carries points of cam0 into cam1
    expected_right = np.column_stack(equidistant(x / z, y / z, 0.01, 0.02, -0.003, 0.0004))

    record = read_calibration(write(CHAIN))

    rig = record.raw
    assert (record.format, record.notes, record.rectified) == ("kalibr", (), None)
    assert rig.left.size == rig.right.size == (752, 480)
    np.testing.assert_allclose(
        rig.left.project(POINTS), expected_left * [461.6, 460.2] + [362.7, 246.0]
    )
    np.testing.assert_allclose(
        rig.right.project(rig.right_from_left.apply(POINTS)),
        expected_right * [459.2, 458.9] + [370.1, 251.3],
    )


def test_the_pose_may_be_written_in_blocks(write):
    lines = [line for line in CHAIN.splitlines() if line.startswith("  - [")]
    text = CHAIN
    for line in lines:
        numbers = line.strip("- []").split(", ")
        text = text.replace(line, "  - - " + "\n    - ".join(numbers))

    assert_see_alike(
        read_calibration(write(text)).raw, read_calibration(write(CHAIN)).raw, tolerance_px=0
    )


def test_a_pose_through_the_inertial_unit_is_the_same(write):
    """T_cam_imu carries points of the inertial unit into a camera."""
    left = np.eye(4)
    left[:3, :3], left[:3, 3] = rotation(1.2, -0.3, 0.4), (0.03, 0.02, -0.01)
    between = np.eye(4)
    between[:3, :3], between[:3, 3] = R, T
    rows = [line for line in CHAIN.splitlines() if line.startswith("  - [")]
    pose = "\n".join(f"  - {row}" for row in (between @ left).tolist())
    text = CHAIN.replace("\n".join(rows), pose).replace("T_cn_cnm1", "T_cam_imu")
    text = text.replace(
        "cam0:\n", "cam0:\n  T_cam_imu:\n" + "".join(f"  - {row}\n" for row in left.tolist())
    )

    assert_see_alike(read_calibration(write(text)).raw, read_calibration(write(CHAIN)).raw)


def test_the_camera_at_the_left_is_the_left_one(write):
    swapped = CHAIN.replace("-0.11]", "0.11]")

    record = read_calibration(write(swapped))

    assert record.raw.left.K[0, 0] == 459.2
    assert record.notes == ("cam1 stands to the left of cam0: it was taken as the left camera",)
    in_cam0 = POINTS
    in_cam1 = POINTS @ R.T + np.array([0.11, 0.0004, -0.0009])
    np.testing.assert_allclose(record.raw.right_from_left.apply(in_cam1), in_cam0, atol=1e-12)


def test_further_cameras_are_noted(write):
    text = CHAIN + CHAIN[CHAIN.index("cam1:") :].replace("cam1:", "cam2:")

    record = read_calibration(write(text))

    assert record.notes == ("cam0 and cam1 were taken, not cam2",)


def test_the_size_may_be_given_where_the_file_lacks_it(write):
    path = write(CHAIN.replace("  resolution: [752, 480]\n", ""))

    assert read_calibration(path, image_size=(752, 480)).raw.left.size == (752, 480)
    with pytest.raises(ValueError, match="give image_size"):
        read_calibration(path)


@pytest.mark.parametrize("lens", ["ideal", "four", "fisheye"])
@pytest.mark.parametrize("spread", [0.03, 1.0])
def test_a_rig_comes_back(lens, spread, make_rig, rng, tmp_path):
    for _ in range(5):
        rig = turned(make_rig(lens), rng, spread=spread)

        write_calibration(tmp_path / "camchain.yaml", rig, format="kalibr")

        record = read_calibration(tmp_path / "camchain.yaml")
        assert_see_alike(record.raw, rig, tolerance_px=0)
        np.testing.assert_array_equal(record.raw.right.distortion, rig.right.distortion)


def test_a_geometry_alone_comes_back(tmp_path):
    geometry = RectifiedGeometry((160, 120), 90.1, (70.3, 55.7), (72.2, 55.7), 0.123)

    write_calibration(tmp_path / "camchain.yaml", geometry, format="kalibr")

    record = read_calibration(tmp_path / "camchain.yaml")
    assert (record.raw, record.rectified) == (None, geometry)


ERRORS = {
    "cut": (
        CHAIN[: CHAIN.rindex("  intrinsics")],
        "there is no cam1.intrinsics; got .* is the file cut off",
    ),
    "cut_early": (CHAIN[:200], "there is no cam1; got cam0"),
    "no_pose": (CHAIN.replace("T_cn_cnm1", "T"), "there is no cam1.T_cn_cnm1; got T"),
    "omni": (
        CHAIN.replace("camera_model: pinhole", "camera_model: omni", 1),
        "cam0.camera_model must be pinhole, got 'omni'; calibrate again with --models pinhole",
    ),
    "eucm": (CHAIN.replace(": pinhole", ": eucm"), "must be pinhole, got 'eucm'; calibrate again"),
    "ds": (CHAIN.replace(": pinhole", ": ds"), "must be pinhole, got 'ds'; calibrate again"),
    "fov": (
        CHAIN.replace("model: radtan", "model: fov"),
        "distortion_model must be radtan, equidistant or none, got 'fov'",
    ),
    "five": (
        CHAIN.replace("[-0.277,", "[-0.277, 0.1,"),
        r"cam0.distortion_coeffs must have shape \(4,\), got \(5,\)",
    ),
    "short_pose": (
        CHAIN.replace("  - [0.0, 0.0, 0.0, 1.0]\n", ""),
        r"cam1.T_cn_cnm1 must have shape \(4, 4\), got \(3, 4\)",
    ),
    "transposed": (
        CHAIN.replace("0.0, 0.0, 0.0, 1.0", "0.0, 0.1, 0.0, 1.0"),
        "cam1.T_cn_cnm1 must end with 0 0 0 1, .* is it transposed",
    ),
    "mirror": (
        CHAIN.replace(f"[{R[0, 0]}", f"[{-R[0, 0]}"),
        "cam1.T_cn_cnm1: R is not a rotation",
    ),
    "millimetres": (
        CHAIN.replace("-0.11]", "-110]"),
        "stand 110 m apart, as Kalibr files are in metres; was the size of the calibration target",
    ),
    "same_place": (
        CHAIN.replace("-0.11]", "0]").replace("0.0004]", "0]", 1).replace("-0.0009]", "0]"),
        "baseline must be positive, got 0 m",
    ),
}


@pytest.mark.parametrize(("text", "message"), ERRORS.values(), ids=ERRORS)
def test_a_file_that_cannot_be_used_is_named_with_its_fault(text, message, write):
    path = write(text)

    with pytest.raises(ValueError, match=message) as error:
        read_calibration(path)
    assert str(error.value).startswith(f"{path}: ")


def test_centimetres_are_read_where_they_are_said(write):
    path = write(CHAIN.replace("-0.11]", "-11]"))

    assert read_calibration(path, unit="cm").raw.baseline_m == pytest.approx(0.11, abs=1e-4)


@pytest.mark.parametrize("lens", ["five", "rational"])
def test_lenses_that_kalibr_lacks_are_refused(lens, make_rig, tmp_path):
    with pytest.raises(ValueError, match="radtan lens has k1, k2, p1 and p2 only"):
        write_calibration(tmp_path / "camchain.yaml", make_rig(lens), format="kalibr")
