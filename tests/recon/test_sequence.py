"""A rig walks by a generated still life; what it saw is fused to one surface."""

import json
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
import walking
from rendered import QUICK
from rerun.chunk import RrdReader

from calib import Pose
from calib.trajectories import read_trajectory
from recon.cli import main
from recon.files import read_ply
from recon.sequence import RgbdSource, StereoSource, find_depth_frames, find_pairs, fuse_sequence
from recon.sequence.odometry import LABEL
from recon.sequence.output import SEQUENCE_OUTPUTS
from recon.sequence.sources import looked_at_first
from recon.settings import load_preset
from recon.training.walks import off_surface, seen_from

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def pairs(tmp_path_factory):
    """The walk on disk, and QUICK as a preset beside it."""
    folder = walking.on_disk(tmp_path_factory.mktemp("walk") / "pairs", walking.walk())
    (folder / "quick.toml").write_text(QUICK)
    return folder


@pytest.fixture(scope="module")
def depths(tmp_path_factory):
    return walking.with_depths(tmp_path_factory.mktemp("depths") / "frames", walking.walk())


def command(folder, out, *options):
    return [
        *("sequence", str(folder), "--calib", str(folder / "rig.json"), "-o", str(out)),
        *("--poses", str(folder / "poses.txt"), "--preset", str(folder / "quick.toml"), *options),
    ]


def of_depths(folder, out, *options):
    numbers = [str(number) for number in walking.INTRINSICS]
    return ["sequence", str(folder), "--intrinsics", *numbers, "-o", str(out), *options]


def in_view(points, pose):
    """Points of the world in the frame of a camera, those that it has in its image."""
    seen = pose.inverse().apply(points.astype(np.float64))
    x, y, z = seen.T
    (cx, cy), f = walking.VIEW.centre, walking.VIEW.focal_px
    column, row = f * x / z + cx, f * y / z + cy
    shown = (column >= 0) & (row >= 0) & (column < 2 * cx + 1) & (row < 2 * cy + 1)
    return seen[shown & (z > 0)]


def depth_seen(vertices, faces, view, pose):
    """Return the depth (H, W) of a mesh in the world as a view sees it from a pose."""
    from open3d import core, t

    scene = t.geometry.RaycastingScene()
    seen = pose.inverse().apply(vertices.astype(np.float64)).astype(np.float32)
    scene.add_triangles(core.Tensor(seen), core.Tensor(faces.astype(np.uint32)))
    ones = replace(view, depth=np.ones_like(view.depth))
    rays = ones.positions(np.ones(view.depth.shape, bool)).astype(np.float32)
    origins = np.zeros_like(rays)
    met = scene.cast_rays(core.Tensor(np.concatenate([origins, rays], axis=1)))["t_hit"].numpy()
    return np.where(np.isfinite(met), met, np.nan).reshape(view.depth.shape)


def test_the_fused_surface_is_nearer_to_the_truth_than_any_pair_by_half(pairs):
    walk, frames = walking.walk(), find_pairs(pairs)
    look = looked_at_first(frames, pairs / "rig.json")
    source = StereoSource(
        pairs / "rig.json", load_preset("fast"), look.disparities, look.pair.geometry
    )

    fused = fuse_sequence(frames, source, walk.poses)

    for place in (0, walking.STEPS // 2, walking.STEPS - 1):
        pose = walk.poses[place]
        there = seen_from(walk.scene, pose)
        view = source.view(source.see(frames[place]), Pose.identity())
        cast = depth_seen(fused.surface.vertices, fused.surface.faces, view, pose)
        used = fused.fusion.solid(view)
        used &= np.isfinite(cast)
        alone = np.median(off_surface(there, view.positions(used)))
        together = np.median(off_surface(there, replace(view, depth=cast).positions(used)))
        assert together * 1.5 < alone
        assert used.mean() > 0.3


def test_a_run_that_was_killed_goes_on_and_gives_the_same_files(pairs, tmp_path):
    main(command(pairs, tmp_path / "whole", "--recording", "none"))
    killed = tmp_path / "killed"
    code = "from recon.cli import main; main()"
    arguments = command(pairs, killed, "--recording", "none")
    running = subprocess.Popen([sys.executable, "-c", code, *arguments], stdout=subprocess.DEVNULL)
    while len(list(killed.glob(".frames/*.npz"))) < 4:
        assert running.poll() is None, "it ended before it could be killed"
        time.sleep(0.002)
    running.send_signal(signal.SIGKILL)
    running.wait()
    assert {path.name for path in killed.iterdir() if path.name[:11] != ".unfinished"} == {
        ".frames"
    }

    main(arguments)

    for name in ("mesh.glb", "cloud.ply", "trajectory.json"):
        assert (killed / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    report = json.loads((killed / "run.json").read_text())
    assert report["frames kept by an earlier run"] >= 4
    whole = {path.name for path in (tmp_path / "whole").iterdir()}
    assert {path.name for path in killed.iterdir()} == whole
    assert whole == SEQUENCE_OUTPUTS.keys() - {"recording.rrd"}


def test_frames_of_other_settings_are_not_taken(pairs, tmp_path):
    out = tmp_path / "out"
    main(command(pairs, out, "--recording", "none", "--keep-frames"))
    first = {path.name for path in (out / ".frames").iterdir()}

    main(command(pairs, out, "--recording", "none", "--keep-frames", "--voxel", "0.08"))
    again = json.loads((out / "run.json").read_text())["frames kept by an earlier run"]
    same = {path.name for path in (out / ".frames").iterdir()}
    options = ("--set", "aggregation.radius_px=3")
    main(command(pairs, out, "--recording", "none", "--keep-frames", *options))

    others = {path.name for path in (out / ".frames").iterdir()}
    assert (again, same) == (walking.STEPS, first)
    assert json.loads((out / "run.json").read_text())["frames kept by an earlier run"] == 0
    assert not others & first


def test_without_poses_they_are_estimated_and_the_drift_is_said(depths, tmp_path, capsys):
    main(of_depths(depths, tmp_path / "out", "--recording", "none"))

    assert LABEL in capsys.readouterr().err.replace("\n", " ")
    report = json.loads((tmp_path / "out" / "run.json").read_text())
    assert report["poses"] == LABEL
    assert len(report["steps"]) == walking.STEPS - 1
    estimated = read_trajectory(tmp_path / "out" / "trajectory.json")
    assert estimated.notes == (LABEL,)
    truth = walking.walk().poses
    apart = [
        np.linalg.norm(ours.t - exact.t)
        for ours, exact in zip(estimated.world_from_camera, truth, strict=True)
    ]
    walked = np.linalg.norm(truth[-1].t - truth[0].t)
    assert max(apart) < 0.1 * walked
    kitti = read_trajectory(tmp_path / "out" / "trajectory_kitti.txt")
    tum = read_trajectory(tmp_path / "out" / "trajectory_tum.txt")
    for other in (kitti, tum):
        np.testing.assert_allclose(
            other.world_from_camera[-1].t, estimated.world_from_camera[-1].t, atol=1e-8
        )


def test_a_step_that_cannot_be_estimated_is_named(depths):
    frames = find_depth_frames(depths)
    source = RgbdSource.of(walking.INTRINSICS, 0.001)

    class Blind(RgbdSource):
        def see(self, frame):
            seen = super().see(frame)
            if frame.name == "3":
                seen.depth[:] = np.random.default_rng(0).uniform(0.5, 9, seen.depth.shape)
            return seen

    with pytest.raises(ValueError, match=r"motion from frame 2 to 3 could not .*--poses"):
        fuse_sequence(frames, Blind(source.K), None)


def test_the_results_of_depths_are_exact_and_the_recording_has_a_timeline(depths, tmp_path):
    main(of_depths(depths, tmp_path / "out", "--poses", str(depths / "poses.txt")))

    assert {path.name for path in (tmp_path / "out").iterdir()} == SEQUENCE_OUTPUTS.keys()
    walk, cloud = walking.walk(), read_ply(tmp_path / "out" / "cloud.ply")
    there = seen_from(walk.scene, walk.poses[2])
    off = off_surface(there, in_view(cloud.points, walk.poses[2]))
    assert np.median(off) < 0.003
    schema = RrdReader(tmp_path / "out" / "recording.rrd").store().schema()
    drawn = {
        "/world/model",
        "/world/mesh",
        "/world/camera",
        "/world/camera/photograph",
        "/world/camera/depth",
        "/summary",
    }
    assert drawn <= set(schema.entity_paths())
    assert (tmp_path / "out" / "recording.rrd").stat().st_size < 10e6
