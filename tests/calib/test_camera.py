import cv2
import numpy as np
import pytest
from lenses import LENSES

from calib import Camera

lenses = pytest.mark.parametrize("lens", LENSES)


def pixels_of(size, step=8):
    x, y = np.meshgrid(np.arange(0, size[0], step), np.arange(0, size[1], step))
    corner = [[size[0] - 1, size[1] - 1]]
    return np.concatenate([np.column_stack([x.ravel(), y.ravel()]), corner]).astype(float)


@lenses
def test_every_pixel_projects_back_onto_itself(lens, make_camera):
    camera = make_camera(lens)
    pixels = pixels_of(camera.size)

    rays = camera.unproject(pixels)

    np.testing.assert_array_equal(rays[:, 2], 1)
    np.testing.assert_allclose(camera.project(rays), pixels, atol=1e-8)


@lenses
def test_a_projected_point_lies_on_the_ray_of_its_pixel(lens, make_camera, rng):
    camera = make_camera(lens)
    points = rng.uniform([-0.6, -0.4, 1], [0.6, 0.4, 1], size=(50, 3)) * rng.uniform(
        0.5, 9, (50, 1)
    )

    rays = camera.unproject(camera.project(points))

    np.testing.assert_allclose(rays, points / points[:, 2:], atol=1e-9)


@lenses
def test_the_projection_is_that_of_opencv(lens, make_camera):
    camera = make_camera(lens)
    rays = camera.unproject(pixels_of(camera.size))
    still = np.zeros((3, 1))

    if camera.model == "fisheye":
        expected, _ = cv2.fisheye.projectPoints(
            rays[:, None], still, still, camera.K, camera.distortion
        )
    else:
        expected, _ = cv2.projectPoints(rays, still, still, camera.K, camera.distortion)

    np.testing.assert_allclose(camera.project(rays), expected[:, 0], atol=1e-9)


def test_a_lens_that_turns_back_does_not_mirror_the_outside_into_the_image(make_camera):
    camera = Camera((160, 120), make_camera("ideal").K, np.array([-0.3, 0, 0, 0]))
    turning = 1 / np.sqrt(0.9)  # where d/dr (r - 0.3 r^3) = 0
    points = np.array([[0.99 * turning, 0, 1], [1.01 * turning, 0, 1], [1.8, 0, 1]])

    visible = np.isfinite(camera.project(points)).all(axis=1)

    np.testing.assert_array_equal(visible, [True, False, False])
    np.testing.assert_array_equal(camera.can_see(points), visible)


def test_without_a_lens_the_projection_is_the_matrix(make_camera, rng):
    camera = make_camera("ideal")
    points = rng.uniform([-1, -1, 1], [1, 1, 4], size=(20, 3))

    homogeneous = points @ camera.K.T

    np.testing.assert_allclose(camera.project(points), homogeneous[:, :2] / homogeneous[:, 2:])


def test_a_fisheye_without_coefficients_is_linear_in_the_angle(make_camera):
    camera = Camera((100, 100), make_camera("ideal").K, np.zeros(4), "fisheye")
    angle = np.linspace(0, 1.4, 15)

    pixels = camera.project(np.column_stack([np.tan(angle), 0 * angle, np.ones(15)]))

    np.testing.assert_allclose(pixels[:, 0], camera.K[0, 2] + camera.K[0, 0] * angle)


@lenses
def test_resizing_moves_every_pixel_by_the_rule_of_pixel_centres(lens, make_camera, rng):
    camera = make_camera(lens)
    points = rng.uniform([-0.5, -0.4, 1], [0.5, 0.4, 1], size=(30, 3))

    resized = camera.resized((240, 60))

    assert resized.size == (240, 60)
    np.testing.assert_allclose(
        resized.project(points), (camera.project(points) + 0.5) * (1.5, 0.5) - 0.5
    )


def test_resizing_back_restores_the_matrix(make_camera):
    camera = make_camera()

    np.testing.assert_allclose(camera.resized((77, 31)).resized(camera.size).K, camera.K)


@pytest.mark.parametrize("lens", ["five", "fisheye"])
def test_points_that_are_not_in_front_have_no_pixel(lens, make_camera):
    points = np.array([[0.1, 0, 1], [0.1, 0, 0], [0.1, 0, -1]])

    visible = np.isfinite(make_camera(lens).project(points)).all(axis=1)

    np.testing.assert_array_equal(visible, [True, False, False])


@pytest.mark.parametrize("lens", ["four", "fisheye"])
def test_a_pixel_beyond_the_lens_has_no_ray(lens, make_camera):
    rays = make_camera(lens).unproject(np.array([[5000.0, 60], [80, 60]]))

    np.testing.assert_array_equal(np.isnan(rays).all(axis=1), [True, False])


@pytest.mark.parametrize("lens", ["five", "fisheye"])
def test_no_points_give_no_pixels(lens, make_camera):
    camera = make_camera(lens)

    assert camera.project(np.zeros((0, 3))).shape == (0, 2)
    assert camera.unproject(np.zeros((0, 2))).shape == (0, 3)


GOOD = np.array([[100.0, 0, 80], [0, 100, 60], [0, 0, 1]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"size": (0, 10)}, r"image size must be positive, got \(0, 10\)"),
        ({"K": np.eye(4)}, r"camera matrix must be \(3, 3\), got \(4, 4\)"),
        ({"K": GOOD * [[-1, 1, 1]] * 3}, "focal lengths must be positive"),
        ({"K": GOOD * np.nan}, "camera matrix must be finite"),
        ({"K": GOOD.T}, "is it transposed, or does it have skew"),
        ({"K": GOOD + 2 * np.eye(3, k=1) * [[1], [0], [0]]}, "does it have skew"),
        ({"distortion": np.zeros(6)}, r"0, 4, 5, 8, 12, 14 coefficients, got shape \(6,\)"),
        ({"distortion": np.zeros((1, 5))}, r"got shape \(1, 5\)"),
        ({"distortion": np.zeros(5), "model": "fisheye"}, "fisheye camera must have 4 coeff"),
        ({"distortion": np.full(5, np.inf)}, "distortion must be finite"),
        ({"model": "mirror"}, "must be one of pinhole, fisheye; got 'mirror'"),
    ],
)
def test_what_is_no_camera_is_refused(changes, message):
    values = {"size": (160, 120), "K": GOOD, "distortion": np.zeros(5), "model": "pinhole"}

    with pytest.raises(ValueError, match=message):
        Camera(**{**values, **changes})
