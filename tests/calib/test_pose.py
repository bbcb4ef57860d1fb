import numpy as np
import pytest

from calib import Pose
from calib.pose import nearest_rotation


@pytest.fixture
def poses(rng):
    def random_pose():
        Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        return Pose(Q * np.linalg.det(Q), rng.normal(size=3))

    return [random_pose() for _ in range(3)]


def assert_same(one, other):
    np.testing.assert_allclose(one.R, other.R, atol=1e-14)
    np.testing.assert_allclose(one.t, other.t, atol=1e-14)


def test_a_pose_after_its_inverse_is_the_identity(poses):
    for pose in poses:
        assert_same(pose @ pose.inverse(), Pose.identity())
        assert_same(pose.inverse() @ pose, Pose.identity())


def test_composition_is_associative(poses):
    a, b, c = poses

    assert_same((a @ b) @ c, a @ (b @ c))


def test_a_composition_applies_the_right_pose_first(poses, rng):
    c_from_b, b_from_a, _ = poses
    points = rng.normal(size=(20, 3))

    np.testing.assert_allclose(
        (c_from_b @ b_from_a).apply(points), c_from_b.apply(b_from_a.apply(points)), atol=1e-14
    )


def test_a_quarter_turn_about_z_takes_x_to_y():
    pose = Pose(np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([0, 0, 2]))

    np.testing.assert_array_equal(pose.apply(np.array([[1.0, 0, 0]])), [[0, 1, 2]])


def test_a_pose_does_not_share_the_arrays_it_was_made_from():
    R, t = np.eye(3), np.zeros(3)
    pose = Pose(R, t)

    R[0, 0], t[0] = 5, 5

    assert_same(pose, Pose.identity())


@pytest.mark.parametrize(
    ("R", "t", "message"),
    [
        (np.eye(4), np.zeros(3), r"R must be \(3, 3\), got \(4, 4\)"),
        (np.eye(3), np.zeros((3, 1)), r"translation must be \(3,\), got \(3, 1\)"),
        (np.eye(3), np.array([0, np.nan, 0]), "translation must be finite"),
        (np.eye(3) * 1.01, np.zeros(3), "differs from the identity by 0.0201"),
        (np.diag([1.0, 1, -1]), np.zeros(3), "R must be a rotation"),
        (np.full((3, 3), np.nan), np.zeros(3), "R must be a rotation"),
    ],
)
def test_what_is_no_pose_is_refused(R, t, message):
    with pytest.raises(ValueError, match=message):
        Pose(R, t)


def test_a_rounded_rotation_is_repaired_and_an_exact_one_is_kept(poses):
    R = poses[0].R

    repaired = nearest_rotation(R.round(4))

    assert nearest_rotation(R) is R
    np.testing.assert_allclose(repaired @ repaired.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(repaired, R, atol=2e-4)


@pytest.mark.parametrize("matrix", [np.diag([1.0, 1, -1]), np.eye(3) * 1.1, np.ones((3, 3))])
def test_what_rounding_cannot_explain_is_not_repaired(matrix):
    with pytest.raises(ValueError, match="R is not a rotation"):
        nearest_rotation(matrix)
