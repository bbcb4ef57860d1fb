"""Poses files of KITTI, TUM, COLMAP and our own."""

import numpy as np
import pytest

from calib import Pose
from calib.trajectories import (
    TRAJECTORY_READERS,
    TRAJECTORY_WRITERS,
    Trajectory,
    read_trajectory,
    write_trajectory,
)

WALK = Trajectory(
    tuple(
        Pose.from_values(np.array([0.1 * n, -0.2 * n, 0.05, 1.5 * n, 0.1, -0.3 * n]))
        for n in range(5)
    ),
    names=tuple(f"{n:06d}" for n in range(5)),
    times_s=tuple(0.1 * n + 7.25 for n in range(5)),
)
QUARTER_TURN_ABOUT_Y = np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # x to -z, z to x
KITTI_LINE = "1 0 0 0.5 0 1 0 0 0 0 1 2\n"


def written(tmp_path, text, name="poses.txt"):
    path = tmp_path / name
    path.write_text(text)
    return path


@pytest.mark.parametrize("format", TRAJECTORY_WRITERS)
def test_what_was_written_is_read_again(format, tmp_path):
    write_trajectory(tmp_path / "poses", WALK, format=format)

    read = read_trajectory(tmp_path / "poses")

    assert read.format == format
    for ours, theirs in zip(WALK.world_from_camera, read.world_from_camera, strict=True):
        np.testing.assert_allclose(theirs.R, ours.R, atol=2e-9)
        np.testing.assert_allclose(theirs.t, ours.t, atol=2e-9)


def test_our_own_file_is_exact_and_keeps_names_and_times(tmp_path):
    write_trajectory(tmp_path / "poses.json", WALK)

    read = read_trajectory(tmp_path / "poses.json")

    assert (read.names, read.times_s) == (WALK.names, WALK.times_s)
    pairs = zip(WALK.world_from_camera, read.world_from_camera, strict=True)
    assert all((a.R == b.R).all() and (a.t == b.t).all() for a, b in pairs)
    assert list(tmp_path.iterdir()) == [tmp_path / "poses.json"]


def test_every_reader_has_a_writer():
    assert TRAJECTORY_READERS.keys() == TRAJECTORY_WRITERS.keys()


def test_kitti_rows_carry_the_camera_to_the_first_frame(tmp_path):
    # Along z, as the readme of the odometry benchmark says: z points forward.
    path = written(tmp_path, "1 0 0 0 0 1 0 0 0 0 1 0\n" + "0 0 1 0.5 0 1 0 0.25 -1 0 0 2\n")

    second = read_trajectory(path).world_from_camera[1]

    np.testing.assert_array_equal(second.R, QUARTER_TURN_ABOUT_Y)
    np.testing.assert_array_equal(second.apply(np.zeros((1, 3)))[0], [0.5, 0.25, 2])


def test_tum_quaternions_have_the_real_part_last_and_carry_the_camera_to_the_world(tmp_path):
    half = np.sqrt(0.5)
    path = written(tmp_path, f"# comment\n1305031102.1758 1 2 3 0 {half:.7f} 0 {half:.7f}\n")

    trajectory = read_trajectory(path)

    np.testing.assert_allclose(trajectory.world_from_camera[0].R, QUARTER_TURN_ABOUT_Y, atol=1e-7)
    np.testing.assert_array_equal(trajectory.world_from_camera[0].t, [1, 2, 3])
    assert trajectory.times_s == (1305031102.1758,)


def test_colmap_poses_carry_the_world_to_the_camera_and_are_inverted(tmp_path):
    half = np.sqrt(0.5)
    text = (
        "# Image list with two lines of data per image:\n"
        f"1 {half:.9f} 0 {half:.9f} 0 1 2 3 1 left/a b.png\n"
        "10.5 20.5 -1 11.5 21.5 7\n"
        f"2 1 0 0 0 0 0 5 1 left/c.png\n"
        "\n"
    )

    trajectory = read_trajectory(written(tmp_path, text, "images.txt"))

    first, second = trajectory.world_from_camera
    np.testing.assert_allclose(first.R, QUARTER_TURN_ABOUT_Y.T, atol=1e-8)
    np.testing.assert_allclose(first.inverse().t, [1, 2, 3], atol=1e-8)
    np.testing.assert_array_equal(second.t, [0, 0, -5])
    assert trajectory.names == ("left/a b.png", "left/c.png")
    assert "arbitrary" in trajectory.notes[0]


def test_seven_numbers_are_tum_without_times(tmp_path):
    trajectory = read_trajectory(written(tmp_path, "1 2 3 0 0 0 1\n4 5 6 0 0 0 1\n"))

    assert trajectory.format == "tum"
    assert trajectory.times_s is None
    assert "in order" in trajectory.notes[0]


@pytest.mark.parametrize(
    ("text", "format", "message"),
    [
        (KITTI_LINE, "tum", r"expected TUM.* has 12 words.*it looks like KITTI"),
        ("0 1 2 3 0 0 0 1\n", "kitti", r"expected KITTI.* has 8 words.*it looks like TUM"),
        (KITTI_LINE, "colmap", r"expected COLMAP.*it looks like KITTI"),
        ("1 2 3\n", None, r"has 3 words.*in no known format of poses"),
        ("", None, r"holds no pose"),
        (KITTI_LINE + "1 0 0 0.5 0 1 0 0\n", None, r"line 2 must be 12 numbers, got 8"),
        (KITTI_LINE + "2 0 0 0 0 1 0 0 0 0 1 2\n", None, r"line 2: .*from the identity by 3;"),
        ("1 0 0 0 0 1 0 0 0 0 -1 0\n", None, r"line 1: R is not a rotation.*a mirror"),
        ("0 1 2 3 0 0 0 2\n", None, r"line 1: .*length 1.*length 2.*qx qy qz qw"),
        ("5 1 2 3 0 0 0 1\n4 1 2 3 0 0 0 1\n", None, r"line 2: the time 4 s does not come after"),
        ("1 1 0 0 0 0 0 5 1 a.png\n2 1 0 0 0 0 0 5 1 b.png\n", None, r"line 2 .*lines lost"),
        ("1 1 0 0 0 0 0 x 1 a.png\n\n", None, r"line 1 must be 7 numbers"),
        ("1 1 0 0 0 0 0 5 1 a.png\n\n2 1 0 0\n", None, r"line 3 must be IMAGE_ID QW.*cut off"),
        ('{"format": "stereo-recon trajectory", "version": 2}', None, r"version is 2"),
        ('{"format": "another"}', None, r"expected 'stereo-recon trajectory'"),
        ('{"format": "stereo-recon traj', None, r"not valid JSON.*cut off"),
    ],
)
def test_what_is_wrong_with_a_file_is_named(text, format, message, tmp_path):
    path = written(tmp_path, text)

    with pytest.raises(ValueError, match=rf"(?s)poses\.txt: .*{message}"):
        read_trajectory(path, format=format)


def test_a_file_that_is_missing_and_a_format_that_is_unknown_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no file of poses .*none\.txt"):
        read_trajectory(tmp_path / "none.txt")
    with pytest.raises(ValueError, match="format must be one of json, colmap, kitti, tum"):
        read_trajectory(written(tmp_path, KITTI_LINE), format="euroc")


def test_poses_that_files_round_are_rotations_again(tmp_path):
    rounded = np.round(WALK.world_from_camera[3].R, 4)
    line = " ".join(f"{x:.4f}" for x in np.column_stack([rounded, [1, 2, 3]]).ravel())

    R = read_trajectory(written(tmp_path, line)).world_from_camera[0].R

    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(R, rounded, atol=1e-4)
