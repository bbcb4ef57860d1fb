"""Real files; skipped unless RECON_DATASETS names the folder that holds them."""

import json

import cv2
import numpy as np
import pytest

from calib import Camera, Pose, Rectifier, StereoCalibration, StereoPair, read_calibration

SCENES = 15


def test_every_middlebury_scene_reads_the_same_however_it_is_spaced(datasets):
    folders = sorted((datasets / "middlebury-v3" / "Q").iterdir())
    assert len(folders) == SCENES

    for folder in folders:
        official, as_found = (
            read_calibration(folder / name) for name in ("calib.txt", "calib.asfound.txt")
        )
        height, width = cv2.imread(str(folder / "im0.png")).shape[:2]

        assert official.rectified == as_found.rectified
        assert official.disparities == as_found.disparities
        assert official.rectified.size == (width, height)


@pytest.mark.parametrize(
    ("scene", "focal_px", "doffs", "baseline_m", "count"),
    [
        ("Motorcycle", 999.421, 32.778, 0.193001, 70),
        ("Jadeplant", 1823.297, 201.044, 0.380135, 160),
        ("Teddy", 1500, 52, 0.080, 64),
    ],
)
def test_middlebury_numbers_are_the_published_ones(
    scene, focal_px, doffs, baseline_m, count, datasets
):
    record = read_calibration(datasets / "middlebury-v3" / "Q" / scene / "calib.txt")

    assert record.rectified.focal_px == focal_px
    assert record.rectified.baseline_m == pytest.approx(baseline_m)
    assert record.rectified.disparity_at_infinity == pytest.approx(-doffs)
    assert record.disparities == range(count)


@pytest.mark.parametrize("scene", ["Motorcycle", "Pipes", "PlaytableP"])
def test_half_and_quarter_size_differ_by_a_resize(scene, datasets):
    half, quarter = (
        read_calibration(datasets / "middlebury-v3" / size / scene / "calib.txt").rectified
        for size in "HQ"
    )

    assert half.focal_px == pytest.approx(2 * quarter.focal_px)
    assert half.disparity_at_infinity == pytest.approx(2 * quarter.disparity_at_infinity)


def test_kitti_has_the_published_baseline_raw_and_rectified(datasets):
    record = read_calibration(datasets / "kitti" / "2015" / "calib_cam" / "000002.txt")

    assert record.rectified.size == (1242, 375)
    assert record.rectified.focal_px == pytest.approx(721.538, abs=1e-3)
    assert record.rectified.centre_left == pytest.approx((609.559, 172.854), abs=1e-3)
    assert record.rectified.baseline_m == pytest.approx(0.5327, abs=1e-4)
    assert record.raw.baseline_m == pytest.approx(0.5327, abs=1e-4)


def test_kitti_can_be_rectified_again_from_its_raw_cameras(datasets):
    rig = read_calibration(datasets / "kitti" / "2015" / "calib_cam" / "000002.txt").raw

    geometry = Rectifier(rig).geometry

    assert geometry.baseline_m == pytest.approx(0.5327, abs=1e-4)
    assert 600 < geometry.focal_px < 1000


def test_bare_kitti_rows_are_the_grey_cameras(datasets):
    path = datasets / "sequences" / "kitti-odometry-snippet" / "calib.txt"

    geometry = read_calibration(path, image_size=(1226, 370)).rectified

    assert geometry.focal_px == pytest.approx(707.0912)
    assert geometry.centre_left == pytest.approx((601.8873, 183.1104))
    assert geometry.baseline_m == pytest.approx(0.537, abs=1e-3)


def test_k_txt_has_its_baseline(datasets):
    path = datasets / "other" / "foundationstereo-demo" / "K.txt"

    geometry = read_calibration(path, image_size=(960, 540)).rectified

    assert geometry.baseline_m == pytest.approx(0.063)
    assert geometry.focal_px == pytest.approx(754.668, abs=1e-3)


def test_a_raw_pair_is_rectified_by_its_factory_calibration(datasets):
    folder = datasets / "calibration" / "s2m2-raw-pair-drifted"
    images = [
        cv2.imread(str(folder / f"1_10_sensor_raw_{side}.png"))[..., ::-1]
        for side in ("left", "right")
    ]
    record = read_calibration(folder / "1_01_camera_param_head.xml", image_size=(2048, 1536))

    pair = Rectifier(record.raw, scale=0.25)(StereoPair(*images, record.raw))

    assert record.raw.baseline_m == pytest.approx(0.130, abs=1e-3)
    assert pair.left.shape == pair.right.shape == (384, 512, 3)
    assert pair.left.mean() == pytest.approx(images[0].mean(), rel=0.2)


def test_opencv_sample_intrinsics_alone_ask_for_the_extrinsics(datasets):
    path = datasets / "calibration" / "opencv-chessboard" / "opencv_samples_intrinsics.yml"

    with pytest.raises(ValueError, match="other half opencv_samples_extrinsics"):
        read_calibration(path)


def test_a_real_rational_lens_fills_the_rectified_view(datasets):
    published = (
        datasets / "calibration" / "charuco-wideangle" / "published_calibration_results.json"
    )
    content = json.loads(published.read_text())
    left, right = (
        Camera(
            (1280, 800),
            np.array(content[f"{side}_camera_calibration_data"]["camera_matrix"]),
            np.ravel(content[f"{side}_camera_calibration_data"]["dist_coeffs"]),
        )
        for side in ("left", "right")
    )
    rig = StereoCalibration(left, right, Pose(np.eye(3), np.array([-0.075, 0.00124, -0.00055])))
    white = np.full((800, 1280, 3), 255, np.uint8)

    pair = Rectifier(rig)(StereoPair(white, white, rig))

    assert min(pair.left.min(), pair.right.min()) == 255
    # The outermost 50 pixels of the diagonal are beyond what the polynomials reach.
    pixels = np.array([[0.0, 400], [640, 0], [60, 60], [1220, 740]])
    np.testing.assert_allclose(left.project(left.unproject(pixels)), pixels, atol=1e-6)
    assert np.isnan(left.unproject(np.zeros((1, 2)))).all()
