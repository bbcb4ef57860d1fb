"""Which files are frames, which poses are theirs, and what is said when something is amiss."""

import numpy as np
import pytest

from calib import Pose
from calib.trajectories import Trajectory
from recon.cli import main
from recon.files import image_size, read_depth, write_image
from recon.fusion import DepthNoise, DepthView
from recon.sequence import (
    RgbdSource,
    SequenceSettings,
    find_depth_frames,
    find_pairs,
    poses_of_frames,
)
from recon.sequence.kept_frames import KeptFrames
from recon.sequence.sources import SeenFrame

PICTURE = np.full((6, 8, 3), 90, np.uint8)
POSES = tuple(Pose(np.eye(3), np.array([float(n), 0, 0])) for n in range(3))


def pictures(folder, *names, image=PICTURE):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        write_image(folder / name, image)


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("image_0/{}.png", "image_1/{}.png"),
        ("image_2/{}.png", "image_3/{}.png"),
        ("left/{}.png", "right/{}.png"),
        ("cam0/data/{}.png", "cam1/data/{}.png"),
        ("shot{}_left.png", "shot{}_right.png"),
    ],
)
def test_every_layout_is_found_and_numbers_are_in_natural_order(left, right, tmp_path):
    for number in (10, 9, 100):
        pictures(tmp_path, left.format(number), right.format(number))

    frames = find_pairs(tmp_path)

    assert [frame.first for frame in frames] == [
        tmp_path / left.format(number) for number in (9, 10, 100)
    ]
    assert [frame.second for frame in frames] == [
        tmp_path / right.format(number) for number in (9, 10, 100)
    ]


def test_colour_is_taken_where_kitti_has_both(tmp_path):
    for side in range(4):
        pictures(tmp_path, f"image_{side}/0.png", f"image_{side}/1.png")

    assert find_pairs(tmp_path)[0].first == tmp_path / "image_2/0.png"


def test_patterns_serve_other_layouts(tmp_path):
    pictures(tmp_path, "a/x1.png", "a/x2.png", "b/x1.png", "b/x2.png")

    frames = find_pairs(tmp_path, "a/*.png", str(tmp_path / "b" / "*.png"))

    assert [frame.name for frame in frames] == ["x1", "x2"]
    with pytest.raises(ValueError, match="both --left and --right"):
        find_pairs(tmp_path, "a/*.png")


def test_a_missing_frame_is_named(tmp_path):
    pictures(tmp_path, *(f"left/{n}.png" for n in range(3)), "right/0.png", "right/2.png")

    with pytest.raises(ValueError, match=r"left/1\.png has no right .*3 and 2 files"):
        find_pairs(tmp_path)


def test_a_size_that_changes_is_named(tmp_path):
    pictures(tmp_path, "left/0.png", "left/1.png", "right/0.png")
    pictures(tmp_path, "right/1.png", image=PICTURE[:4])

    with pytest.raises(ValueError, match=r"right/1\.png is 8 x 4 but .*left/0\.png is 8 x 6"):
        find_pairs(tmp_path)


def test_a_folder_without_a_sequence_says_what_was_expected(tmp_path):
    pictures(tmp_path, "photo.png")

    with pytest.raises(ValueError, match=r"image_0 and image_1.*it holds photo\.png.*--left"):
        find_pairs(tmp_path)
    with pytest.raises(ValueError, match="the folder does not exist"):
        find_depth_frames(tmp_path / "nowhere")


def test_the_size_in_the_head_of_a_file_is_that_of_the_picture(tmp_path):
    pictures(tmp_path, "a.png", "a.jpg")

    assert image_size(tmp_path / "a.png") == image_size(tmp_path / "a.jpg") == (8, 6)
    (tmp_path / "b.png").write_text("<html>")
    with pytest.raises(ValueError, match=r"b\.png is not an image: it is a web page"):
        image_size(tmp_path / "b.png")


def frames_named(folder, *names):
    pictures(folder, *(f"{side}/{name}.png" for side in ("left", "right") for name in names))
    return find_pairs(folder)


def test_poses_without_names_go_in_order_and_must_be_as_many(tmp_path):
    frames = frames_named(tmp_path, "0", "1", "2")

    poses, how = poses_of_frames(Trajectory(POSES), frames)

    assert poses == POSES
    assert "in order" in how
    with pytest.raises(ValueError, match=r"there are 2 poses but 3 frames \(0 to 2\)"):
        poses_of_frames(Trajectory(POSES[:2]), frames)


def test_poses_with_names_go_by_them(tmp_path):
    frames = frames_named(tmp_path, "0", "1")
    names = ("elsewhere/2.png", "left/1.png", "left/0.png")

    poses, how = poses_of_frames(Trajectory(POSES, names=names), frames)

    assert poses == (POSES[2], POSES[1])
    assert "by the names" in how
    with pytest.raises(ValueError, match=r"frame 0\.png has no pose.*not registered"):
        poses_of_frames(Trajectory(POSES[:2], names=names[:2]), frames)


def test_poses_with_times_go_by_them_if_the_names_are_times(tmp_path):
    frames = frames_named(tmp_path, "10.004", "10.100", "10.201")
    times = (10.0, 10.1, 10.2)

    poses, how = poses_of_frames(Trajectory(POSES, times_s=times), frames)

    assert poses == POSES
    assert "at most 4.0 ms" in how
    with pytest.raises(ValueError, match=r"10\.201\.png has no pose: .*0\.101 s away"):
        poses_of_frames(Trajectory(POSES[:2], times_s=times[:2]), frames)


def test_depths_are_read_in_their_unit(tmp_path):
    values = np.array([[0, 1000], [2500, 65535]], np.uint16)
    write_image(tmp_path / "d.png", values)

    depth = read_depth(tmp_path / "d.png", per_metre=5000)

    np.testing.assert_allclose(depth, [[np.nan, 0.2], [0.5, 13.107]], rtol=1e-6)
    write_image(tmp_path / "c.png", PICTURE)
    with pytest.raises(ValueError, match=r"c\.png has 3 channels of uint8; expected depths"):
        read_depth(tmp_path / "c.png")


def test_a_kept_frame_is_read_as_it_was_and_a_damaged_one_is_not(tmp_path):
    kept = KeptFrames(tmp_path / "kept")
    depth = np.array([[1.5, np.nan]], np.float32)
    times = np.array([[0.25, np.nan]], np.float16)
    frame = SeenFrame(depth, np.array([[255, 0]], np.uint8), np.zeros((1, 2, 3), np.uint8), times)

    kept.put("one", frame)
    kept.put("two", frame)

    read = kept.get("one")
    np.testing.assert_array_equal(read.depth, depth)
    np.testing.assert_array_equal(read.trust, frame.trust)
    np.testing.assert_array_equal(read.noise_times, times)
    assert kept.get("three") is None
    (tmp_path / "kept" / "one.npz").write_bytes(b"PK\x03\x04 cut off")
    assert kept.get("one") is None
    kept.forget_others({"two"})
    assert [path.name for path in (tmp_path / "kept").iterdir()] == ["two.npz"]


def test_other_files_or_settings_have_another_fingerprint(tmp_path):
    pictures(tmp_path, "color/0.png", "color/1.png")
    pictures(tmp_path, "depth/0.png", image=np.full((6, 8), 700, np.uint16))
    pictures(tmp_path, "depth/1.png", image=np.full((6, 8), 800, np.uint16))
    frames = find_depth_frames(tmp_path)
    source, other = RgbdSource(np.eye(3)), RgbdSource(np.eye(3), per_metre=5000)

    assert source.fingerprint(frames[0]) == source.fingerprint(frames[0])
    assert len({s.fingerprint(f) for s in (source, other) for f in frames}) == 4


def test_the_voxel_follows_the_pixel_or_the_error_or_what_is_seen_whichever_is_largest():
    def voxel(noise, *, times=None, width=8):
        depth, image = np.full((6, width), 4.0, np.float32), np.zeros((6, width, 3), np.uint8)
        trust, K = np.ones(depth.shape, np.float32), np.diag([100.0, 100, 1])
        if times is not None:
            times = np.resize(np.array(times, np.float32), depth.shape)
        view = DepthView(depth, trust, image, K, noise, Pose.identity(), times)
        return SequenceSettings().fusion_for([view], 1).voxel_m

    assert voxel(DepthNoise(0.001, 0.0)) == pytest.approx(0.06)
    assert voxel(DepthNoise(0.2, 0.0)) == pytest.approx(0.1)
    # Half of the pixels are ten times less sure, and hardly count: sqrt(2) of what the others say.
    assert voxel(DepthNoise(0.2, 0.0), times=(1, 10)) == pytest.approx(0.15)
    assert voxel(DepthNoise(0.001, 0.0), width=1200) == pytest.approx(0.12)


@pytest.mark.parametrize(
    ("poses", "options", "message"),
    [
        ("1 0 0 0 0 1 0 0 0 0 1 0\n", (), "there are 1 poses but 2 frames"),
        ("2 0 0 0 0 1 0 0 0 0 1 0\n" * 2, (), "from the identity by 3"),
        ("1 0 0 0 0 1 0 0 0 0 1 0\n" * 2, ("--format", "tum"), "it looks like KITTI"),
        ("1 0 0 0 0 1 0 0 0 0 1 0\n" * 2, ("--left", "left/*.png"), "both --left and --right"),
        ("1 0 0 0 0 1 0 0 0 0 1 0\n" * 2, ("--preset", "none"), "none"),
    ],
)
def test_bad_input_is_named_and_leaves_nothing_behind(poses, options, message, tmp_path, capsys):
    frames_named(tmp_path, "0", "1")
    (tmp_path / "poses.txt").write_text(poses)
    (tmp_path / "K.txt").write_text("100 0 4 0 100 3 0 0 1\n0.1\n")

    with pytest.raises(SystemExit, match="2"):
        main(
            [
                *("sequence", str(tmp_path), "--calib", str(tmp_path / "K.txt")),
                *("--poses", str(tmp_path / "poses.txt"), "-o", str(tmp_path / "out"), *options),
            ]
        )

    assert message in capsys.readouterr().err.replace("\n", " ")
    assert not (tmp_path / "out").exists()
