from dataclasses import replace

import numpy as np
import pytest
from lenses import LENSES, rotation

from calib import Pose, RectifiedGeometry, Rectifier, StereoCalibration, StereoPair

SETTINGS = {
    "default": {},
    "everything": {"alpha": 1.0},
    "between": {"alpha": 0.4},
    "same_focal": {"alpha": None},
    "half": {"scale": 0.5},
    "other_size": {"size": (150, 80)},
    "own_centres": {"common_centre": False},
    "own_centres_wide": {"common_centre": False, "alpha": 1.0},
}
ROW_TOLERANCE_PX = 1e-6


def points_before(rig, rng, count=200):
    """(N, 3) in the frame of the left camera, seen by both."""
    directions = rng.uniform([-0.4, -0.35, 1], [0.4, 0.35, 1], size=(count, 3))
    return directions * rng.uniform(0.8, 30, (count, 1))


def seen_by(rectifier, points):
    """Rectified pixels of left and right, by way of the raw cameras."""
    rig = rectifier.calibration
    left = rectifier.points(rig.left.project(points), "left")
    right = rectifier.points(rig.right.project(rig.right_from_left.apply(points)), "right")
    return left, right


@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
@pytest.mark.parametrize("lens", LENSES)
def test_rows_agree_and_disparity_is_depth(lens, settings, make_rig, rng):
    rig = make_rig(lens)
    rectifier = Rectifier(rig, **settings)
    points = points_before(rig, rng)

    left, right = seen_by(rectifier, points)

    geometry, rectified = rectifier.geometry, points @ rectifier.rotations[0].T
    f, (cx, cy), Z = geometry.focal_px, geometry.centre_left, rectified[:, 2]
    disparity = f * geometry.baseline_m / Z + geometry.disparity_at_infinity
    assert np.isfinite(left).all()
    np.testing.assert_allclose(left[:, 1], right[:, 1], atol=ROW_TOLERANCE_PX)
    np.testing.assert_allclose(left[:, 0] - right[:, 0], disparity, atol=ROW_TOLERANCE_PX)
    np.testing.assert_allclose(left[:, 0], f * rectified[:, 0] / Z + cx, atol=ROW_TOLERANCE_PX)
    np.testing.assert_allclose(left[:, 1], f * rectified[:, 1] / Z + cy, atol=ROW_TOLERANCE_PX)


def test_the_baseline_is_the_distance_of_the_cameras(make_rig):
    rig = make_rig()

    assert Rectifier(rig).geometry.baseline_m == pytest.approx(rig.baseline_m, rel=1e-12)


def paint(X, Y):
    """(..., 3), smooth colours of the point (X, Y) of a plane, each channel its own."""
    red, green, blue = np.sin(7 * X + 2 * Y), np.cos(5 * X - 6 * Y), np.sin(9 * Y)
    return 128 + 100 * np.stack([red, green, blue], axis=-1)


def on_plane(rays, centre, depth):
    """Where rays from `centre` meet the plane Z = depth."""
    hit = centre + rays * ((depth - centre[2]) / rays[..., 2])[..., None]
    return paint(hit[..., 0], hit[..., 1])


def grid(size):
    return np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).astype(float)


@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
@pytest.mark.parametrize("lens", ["rational", "five", "fisheye"])
def test_a_rendered_scene_is_what_the_rectified_cameras_would_see(lens, settings, make_rig):
    depth, rig = 1.3, make_rig(lens)
    rectifier = Rectifier(rig, **settings)
    geometry = rectifier.geometry
    cameras = (rig.left, rig.right)
    stands = (np.zeros(3), np.array([geometry.baseline_m, 0, 0]))
    raw = []
    for camera, R, stand in zip(cameras, rectifier.rotations, stands, strict=True):
        rays = camera.unproject(grid(camera.size).reshape(-1, 2)) @ R.T
        image = on_plane(rays, stand, depth).reshape(*camera.size[::-1], 3)
        raw.append(image.round().astype(np.uint8))

    pair = rectifier(StereoPair(*raw, rig))

    centres = (geometry.centre_left, geometry.centre_right)
    for image, camera, R, stand, centre in zip(
        (pair.left, pair.right), cameras, rectifier.rotations, stands, centres, strict=True
    ):
        plane = (grid(geometry.size) - centre) / geometry.focal_px
        rays = np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1)
        pixels = camera.project((rays @ R).reshape(-1, 3)).reshape(plane.shape)
        beside = np.abs(pixels - (79.5, 59.5)) - (79.5, 59.5)  # > 0 outside the raw image
        inside = (beside < 0).all(axis=-1) & (np.abs(plane) < 1).all(axis=-1)  # not too slanted
        error = np.abs(image - on_plane(rays, stand, depth))[inside]
        assert inside.mean() > 0.3
        assert error.max() < 6  # rounding twice, and linear between pixels
        assert error.mean() < 1
        assert not image[~(beside < 1).all(axis=-1)].any()


@pytest.mark.parametrize("common_centre", [True, False])
@pytest.mark.parametrize("scale", [0.5, 1, 2])
@pytest.mark.parametrize("lens", LENSES)
def test_alpha_zero_leaves_nothing_black(lens, scale, common_centre, make_rig):
    rig = make_rig(lens)
    white = np.full((120, 160, 3), 255, np.uint8)

    pair = Rectifier(rig, scale=scale, common_centre=common_centre)(StereoPair(white, white, rig))

    assert pair.left.min() == pair.right.min() == 255


@pytest.mark.parametrize("common_centre", [True, False])
@pytest.mark.parametrize("lens", LENSES)
def test_alpha_one_loses_no_raw_pixel(lens, common_centre, make_rig):
    rig = make_rig(lens)
    rectifier = Rectifier(rig, alpha=1.0, common_centre=common_centre)

    for view in ("left", "right"):
        x, y = rectifier.points(grid(rig.left.size)[::7, ::7].reshape(-1, 2), view).T

        assert (x.min(), y.min()) >= (-0.5, -0.5)
        assert x.max() <= 159.5
        assert y.max() <= 119.5


def test_what_the_lens_cannot_see_is_black(make_camera):
    camera = replace(make_camera("ideal"), distortion=np.array([-0.25, 0.0, 0.0, 0.0]))
    rig = StereoCalibration(camera, camera, Pose(np.eye(3), np.array([-0.1, 0, 0])))
    white = np.full((120, 160, 3), 255, np.uint8)
    rectifier = Rectifier(rig, alpha=1.0)

    image = rectifier(StereoPair(white, white, rig)).left

    from_axis = grid(image.shape[1::-1]) - rectifier.geometry.centre_left
    distance = np.linalg.norm(from_axis, axis=-1) / rectifier.geometry.focal_px
    turning = 1 / np.sqrt(0.75)  # where d/dr (r - 0.25 r^3) = 0
    assert (distance > 1.01 * turning).sum() > 100
    assert not image[distance > 1.01 * turning].any()


def test_raising_alpha_lowers_the_focal_length(make_rig):
    focal = [Rectifier(make_rig(), alpha=alpha).geometry.focal_px for alpha in (0, 0.3, 0.7, 1)]

    assert focal == sorted(focal, reverse=True)
    assert len(set(focal)) == 4


@pytest.mark.parametrize("alpha", [0.0, 0.5, 1.0, None])
def test_scaling_the_output_is_resizing_the_geometry(alpha, make_rig):
    once, twice = (Rectifier(make_rig(), alpha=alpha, scale=s).geometry for s in (1, 2))

    expected = once.resized((320, 240))
    assert twice.size == expected.size
    assert twice.focal_px == pytest.approx(expected.focal_px)
    assert twice.centre_left == pytest.approx(expected.centre_left)
    assert twice.centre_right == pytest.approx(expected.centre_right)


def test_a_resized_calibration_gives_the_resized_geometry(make_rig):
    rig = make_rig()

    resized = Rectifier(rig.resized((320, 240))).geometry

    expected = Rectifier(rig).geometry.resized((320, 240))
    assert resized.focal_px == pytest.approx(expected.focal_px)
    assert resized.centre_left == pytest.approx(expected.centre_left)


def test_no_alpha_keeps_the_focal_length(make_camera):
    camera = make_camera("four", fx=110, fy=110)
    rig = StereoCalibration(camera, camera, Pose(np.eye(3), np.array([-0.1, 0, 0])))

    assert Rectifier(rig, alpha=None).geometry.focal_px == 110


def test_a_rectified_pair_is_left_as_it_is(make_camera, rng):
    camera = make_camera("ideal", fx=110, fy=110)
    rig = StereoCalibration(camera, camera, Pose(np.eye(3), np.array([-0.1, 0, 0])))
    left, right = rng.integers(0, 256, (2, 120, 160, 3), dtype=np.uint8)
    pair = StereoPair(left.copy(), right.copy(), rig)

    rectified = Rectifier(rig)(pair)

    np.testing.assert_array_equal(rectified.left, left)
    np.testing.assert_array_equal(rectified.right, right)
    np.testing.assert_array_equal(pair.left, left)
    assert rectified.geometry.centre_left == pytest.approx((camera.K[0, 2], camera.K[1, 2]))


def test_cameras_that_look_towards_each_other_keep_more_with_their_own_centres(make_camera):
    camera = make_camera("ideal")
    toed_in = Pose(rotation(0, -0.5, 0), np.array([-0.1, 0, 0.02]))
    rig = StereoCalibration(camera, camera, toed_in)

    own, common = (Rectifier(rig, common_centre=own).geometry for own in (False, True))

    assert own.focal_px < common.focal_px
    assert abs(own.disparity_at_infinity) > 20
    assert common.disparity_at_infinity == 0


def rig_with(make_camera, t, turn=(0.0, 0.0, 0.0), lens="five"):
    camera = make_camera(lens)
    return StereoCalibration(camera, camera, Pose(rotation(*turn), np.array(t)))


@pytest.mark.parametrize("lens", ["five", "fisheye"])
@pytest.mark.parametrize(
    ("t", "turn", "settings", "message"),
    [
        ([0.12, 0, 0], (0, 0, 0), {}, r"baseline must be positive, got -0.12 m; are the left and"),
        ([0.001, -0.1, 0], (0, 0, 0), {}, "one above the other"),
        ([0.001, 0.1, 0], (0, 0, 0), {}, "one above the other"),
        ([-0.0765, 0, 0.0644], (0, 1.4, 0), {}, "hardly a rectangle in common"),
        ([-0.1, 0, 0], (0, 2.2, 0), {}, "does not see a border of the raw image"),
        ([-0.1, 0, 0], (0, 0, 0), {"alpha": 1.5}, "alpha must be None or from 0 to 1, got 1.5"),
        ([-0.1, 0, 0], (0, 0, 0), {"scale": 0}, "scale must be positive, got 0"),
        ([-0.1, 0, 0], (0, 0, 0), {"scale": 2, "size": (9, 9)}, "size or scale, not both"),
    ],
)
def test_a_rig_or_setting_that_cannot_be_is_refused(lens, t, turn, settings, message, make_camera):
    with pytest.raises(ValueError, match=message):
        Rectifier(rig_with(make_camera, t, turn, lens), **settings)


def test_a_pair_of_another_size_is_refused(make_rig):
    rig, other = make_rig(), make_rig(size=(80, 60))
    small = np.zeros((60, 80, 3), np.uint8)

    with pytest.raises(ValueError, match="pair is 80 x 60 but the rectifier is for 160 x 120"):
        Rectifier(rig)(StereoPair(small, small, other))
    with pytest.raises(ValueError, match="left image is 80 x 60 but the calibration is for 160"):
        StereoPair(small, small, rig)


def test_cameras_of_two_models_can_stand_side_by_side(make_camera, rng):
    pose = Pose(rotation(0.01, 0.02, 0), np.array([-0.1, 0, 0]))
    rig = StereoCalibration(make_camera("fisheye"), make_camera("five"), pose)
    rectifier = Rectifier(rig)

    left, right = seen_by(rectifier, points_before(rig, rng))

    np.testing.assert_allclose(left[:, 1], right[:, 1], atol=ROW_TOLERANCE_PX)


GEOMETRY = RectifiedGeometry((160, 120), 110.0, (81.0, 61.0), (77.5, 61.0), 0.1)


def test_a_crop_keeps_depth_and_moves_the_centres():
    cropped = GEOMETRY.cropped((10, 20), (100, 50))

    assert cropped.size == (100, 50)
    assert cropped.centre_left == (71, 41)
    assert cropped.centre_right == (67.5, 41)
    back = replace(cropped, size=(160, 120), centre_left=(81, 61), centre_right=(77.5, 61))
    assert back == GEOMETRY
    assert cropped.disparity_at_infinity == GEOMETRY.disparity_at_infinity


def test_a_crop_that_leaves_the_image_is_refused():
    with pytest.raises(ValueError, match=r"window of \(100, 50\) .* at \(70, 20\) .* leaves"):
        GEOMETRY.cropped((70, 20), (100, 50))


def projections(**changes):
    left, right = (np.array([[100.0, 0, 80, 0], [0, 100, 60, 0], [0, 0, 1, 0]]) for _ in "lr")
    right[0, 3] = -20
    for (row, column), value in changes.get("right", {}).items():
        right[row, column] = value
    return left, right


def test_projections_give_the_geometry():
    geometry = RectifiedGeometry.from_projections(*projections(right={(0, 2): 83}), (160, 120))

    assert geometry == RectifiedGeometry((160, 120), 100, (80, 60), (83, 60), 0.2)


@pytest.mark.parametrize(
    ("right", "message"),
    [
        ({(0, 0): 101}, "focal lengths of a rectified pair agree, got 100, 100, 101, 100 px"),
        ({(1, 1): np.nan}, "focal lengths of a rectified pair agree"),
        ({(0, 3): 20}, "baseline must be positive, got -0.2 m"),
        ({(0, 3): 0, (1, 3): -20}, "one above the other"),
        ({(1, 2): 62}, "principal points lie in rows 60 and 62 px"),
    ],
)
def test_projections_of_no_rectified_pair_are_refused(right, message):
    with pytest.raises(ValueError, match=message):
        RectifiedGeometry.from_projections(*projections(right=right), (160, 120))
