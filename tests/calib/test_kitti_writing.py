import numpy as np
import pytest
from comparing import POINTS, assert_see_alike, rectified_pixels, seen_by, turned

from calib import CalibrationRecord, RectifiedGeometry, Rectifier, read_calibration
from calib.formats import write_calibration

GEOMETRY = RectifiedGeometry((150, 100), 101.5, (77.25, 58), (81, 58), 0.1234)


def entries(path):
    """What the file says, without our reader."""
    lines = (line.split(": ") for line in path.read_text().splitlines())
    return {key: np.array(numbers.split(), dtype=float) for key, numbers in lines}


@pytest.mark.parametrize("lens", ["ideal", "four", "five"])
def test_a_rig_comes_back(lens, make_rig, rng, tmp_path):
    path = tmp_path / "calib_cam_to_cam.txt"
    for _ in range(5):
        rig = turned(make_rig(lens), rng, spread=0.03)

        write_calibration(path, rig, format="kitti")

        record = read_calibration(path)
        rectified = Rectifier(rig).geometry
        assert (record.format, record.notes) == ("kitti", ())
        assert_see_alike(record.raw, rig)
        assert record.rectified.baseline_m == pytest.approx(rectified.baseline_m, rel=1e-14)
        assert record.rectified.centre_left == rectified.centre_left


def test_raw_and_rectified_of_different_sizes_come_back(make_rig, tmp_path):
    path, rig = tmp_path / "calib.txt", make_rig("five")

    write_calibration(path, CalibrationRecord(rig, GEOMETRY, path, "json"), format="kitti")

    record = read_calibration(path)
    assert_see_alike(record.raw, rig, tolerance_px=0)
    assert record.rectified.baseline_m == pytest.approx(GEOMETRY.baseline_m, rel=1e-14)
    assert record.rectified.size == (150, 100)
    assert record.rectified.centre_right == (81, 58)


def test_a_geometry_alone_comes_back(tmp_path):
    write_calibration(tmp_path / "calib.txt", GEOMETRY, format="kitti")

    record = read_calibration(tmp_path / "calib.txt")
    assert record.raw is None
    assert record.rectified.focal_px == 101.5
    assert record.rectified.baseline_m == pytest.approx(GEOMETRY.baseline_m, rel=1e-14)


def test_both_views_see_a_point_where_kitti_says(make_rig, rng, tmp_path):
    """x_i = R_i x_0 + T_i in the raw cameras, and P_rect_i R_rect_0 x_0 in rectified pixels.

    Source: Geiger et al., Vision meets Robotics: The KITTI Dataset, IJRR 2013, section 4.1.
    """
    path, rig = tmp_path / "calib.txt", turned(make_rig("five"), rng, spread=0.03)

    write_calibration(path, rig, format="kitti")

    found = entries(path)
    rectified = np.column_stack([POINTS @ found["R_rect_00"].reshape(3, 3).T, np.ones(len(POINTS))])
    for camera, lens in (("00", rig.left), ("01", rig.right)):
        points = POINTS @ found[f"R_{camera}"].reshape(3, 3).T + found[f"T_{camera}"]
        K, D = found[f"K_{camera}"].reshape(3, 3), found[f"D_{camera}"]
        P = found[f"P_rect_{camera}"].reshape(3, 4)
        pixels = rectified @ P.T
        raw = seen_by("pinhole", K, D, points)
        np.testing.assert_allclose(raw, lens.project(points), atol=1e-9)
        np.testing.assert_allclose(
            rectified_pixels("pinhole", K, D, found[f"R_rect_{camera}"].reshape(3, 3), P, raw),
            pixels[:, :2] / pixels[:, 2:],
            atol=1e-4,  # OpenCV's iteration
        )
        np.testing.assert_array_equal(found[f"S_{camera}"], rig.left.size)


@pytest.mark.parametrize("lens", ["rational", "fisheye"])
def test_lenses_that_kitti_lacks_are_refused(lens, make_rig, tmp_path):
    with pytest.raises(ValueError, match="KITTI's lens has 5 coefficients of a pinhole camera"):
        write_calibration(tmp_path / "calib.txt", make_rig(lens), format="kitti")
