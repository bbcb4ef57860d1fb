"""`reconstruct sequence`: many pairs with poses, one mesh and one cloud."""

from __future__ import annotations

import contextlib
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from tyro.conf import Positional

from recon.cli.rectify import said
from recon.cli.terminal import (
    Device,
    Out,
    Overrides,
    Unit,
    console,
    device_named,
    preset_with,
    warn,
)

if TYPE_CHECKING:
    from calib.pose import Pose
    from recon.sequence import DepthSource, FrameOnDisk, SequenceSettings
    from recon.settings import Preset

__all__ = ["sequence"]

Poses = Literal["auto", "kitti", "tum", "colmap", "json"]


@dataclass(frozen=True)
class Inputs:
    """What is fused: frames, where their depth comes from, and where they were taken.

    Attributes:
        frames: in order.
        source: of the depths.
        poses: one a frame; None where they are estimated.
        described: for run.json.
    """

    frames: tuple[FrameOnDisk, ...]
    source: DepthSource
    poses: tuple[Pose, ...] | None
    described: dict[str, Any]


def sequence(  # noqa: PLR0913  every one is an option of the command
    folder: Positional[Path],
    /,
    *,
    calib: Path | None = None,
    poses: Path | None = None,
    format: Poses = "auto",
    out: Out,
    left: str | None = None,
    right: str | None = None,
    intrinsics: tuple[float, float, float, float] | None = None,
    depth_unit: float = 0.001,
    rectified: bool = False,
    raw: bool = False,
    unit: Unit | None = None,
    preset: str = "fast",
    scale: float = 1.0,
    min_disparity: int | None = None,
    max_disparity: int | None = None,
    voxel: float | None = None,
    max_depth: float | None = None,
    min_confidence: float = 0.3,
    min_views: int = 2,
    keep_frames: bool = False,
    ignore_rectification: bool = False,
    device: Device = "auto",
    recording: Literal["save", "none"] = "save",
    settings: Path | None = None,
    override: Overrides = (),
) -> None:
    """Fuse many pairs of a moving rig, or colours and depths, to one mesh and one cloud.

    A run that was ended goes on where it was when it is started again.

    Args:
        folder: with image_0 and image_1, left and right, cam0 and cam1, or *_left.* and *_right.*;
            with --intrinsics color and depth.
        calib: calibration of the rig, in any format of `reconstruct pair`.
        poses: where the camera was: KITTI poses, TUM trajectory, COLMAP images.txt or our JSON, of
            the left camera as its pictures are, raw or rectified. Estimated from frame to frame if
            not given, and then they drift.
        format: of the poses; told from the file if not given.
        out: folder for the results.
        left: quoted pattern of the left pictures, for other layouts; with --right.
        right: of the right ones.
        intrinsics: FX FY CX CY of a depth camera, in place of --calib.
        depth_unit: length of one step of its depths, metres.
        rectified: the rows of the pictures agree already.
        raw: the pictures are to be undistorted and rectified.
        unit: of the lengths in the calibration, where it does not say.
        preset: name of a preset (see `reconstruct presets`) or path of a TOML file.
        scale: resize the pairs first.
        min_disparity: smallest x_left - x_right to search, pixels at the size that is matched.
        max_disparity: largest one; both are estimated where neither you nor the calibration says.
        voxel: side of a voxel in metres; chosen from the depths if not given.
        max_depth: metres beyond which nothing is made; chosen from the error if not given.
        min_confidence: leave out depths that are less likely to be right than this, in [0, 1].
        min_views: fewest frames that must agree on a surface.
        keep_frames: keep the depths of all frames (OUT/.frames) after the run, to fuse them again.
        ignore_rectification: go on even if the rows of the first pair are far from agreeing.
        device: where to match.
        recording: write a Rerun recording, or not.
        settings: TOML file with settings that replace those of the preset.
        override: one setting such as aggregation.radius_px=7; may be given again and again.
    """
    from recon.sequence import RgbdSource, SequenceSettings, find_depth_frames, find_pairs

    fusing = SequenceSettings(voxel, max_depth, min_confidence, min_views)
    if (calib is None) == (intrinsics is None):
        raise ValueError("give --calib for pairs, or --intrinsics for colours and depths")
    if rectified and raw:
        raise ValueError("say --rectified or --raw, not both")
    if intrinsics is not None:
        frames = find_depth_frames(folder)
        placed, described = _placed(frames, poses, format)
        source: DepthSource = RgbdSource.of(intrinsics, depth_unit)
        return _run(Inputs(frames, source, placed, described), fusing, out, recording, keep_frames)
    assert calib is not None
    stated = True if rectified else False if raw else None
    wanted = preset_with(preset, settings, override)
    frames = find_pairs(folder, left, right)
    placed, described = _placed(frames, poses, format)
    stereo = _stereo(
        frames,
        (calib, unit, stated),
        wanted,
        (scale, _limits(min_disparity, max_disparity)),
        device_named(device),
        ignore_rectification,
    )
    return _run(Inputs(frames, stereo, placed, described), fusing, out, recording, keep_frames)


def _limits(low: int | None, high: int | None) -> range | None:
    """Return the disparities that were asked for."""
    if low is None and high is None:
        return None
    if high is None:
        raise ValueError("give --max-disparity too")
    return range(low or 0, high + 1)


def _placed(
    frames: tuple[FrameOnDisk, ...], poses: Path | None, format: Poses
) -> tuple[tuple[Pose, ...] | None, dict[str, Any]]:
    """Return the poses of the frames, and what is said of them in run.json."""
    from calib.trajectories import read_trajectory
    from recon.sequence import poses_of_frames
    from recon.sequence.odometry import LABEL

    described: dict[str, Any] = {"frames": f"{frames[0].first} to {frames[-1].first}"}
    if poses is None:
        warn(f"no --poses: {LABEL}")
        return None, {**described, "poses": LABEL}
    trajectory = read_trajectory(poses, format=None if format == "auto" else format)
    found, how = poses_of_frames(trajectory, frames)
    console.print(f"{len(frames)} frames, {trajectory.format} poses matched {how}", soft_wrap=True)
    for note in trajectory.notes:
        console.print(f"note: {note}", soft_wrap=True)
    return found, {
        **described,
        "poses": str(poses),
        "format of poses": trajectory.format,
        "poses matched": how,
    }


def _stereo(
    frames: tuple[FrameOnDisk, ...],
    calibration: tuple[Path, Unit | None, bool | None],
    preset: Preset,
    matching: tuple[float, range | None],
    device: str,
    ignore_rectification: bool,
) -> DepthSource:
    """Look at the first pair, say what was found, and return the source of all depths."""
    from recon.rectification import CheckedPair, check_rectification
    from recon.sequence import StereoSource
    from recon.sequence.sources import looked_at_first

    calib, unit, rectified = calibration
    scale, disparities = matching
    look = looked_at_first(
        frames, calib, rectified=rectified, unit=unit, scale=scale, disparities=disparities
    )
    for note in look.source.notes:
        console.print(f"note: {note}", soft_wrap=True)
    said(CheckedPair(look.pair, check_rectification(look.pair)), ignore=ignore_rectification)
    return StereoSource(
        calib, preset, look.disparities, look.pair.geometry, look.rectifier, unit, device
    )


def _run(
    inputs: Inputs,
    settings: SequenceSettings,
    out: Path,
    recording: Literal["save", "none"],
    keep_frames: bool,
) -> None:
    """Fuse and write: all or nothing, but for the depths that are kept for another try."""
    from recon.files import write_json
    from recon.observer import all_of
    from recon.output import all_or_nothing, forget_unfinished
    from recon.report import versions
    from recon.sequence import fuse_sequence
    from recon.sequence.kept_frames import KeptFrames
    from recon.sequence.output import (
        KEPT_FRAMES,
        SEQUENCE_OUTPUTS,
        sequence_report,
        write_sequence,
    )

    begun = time.perf_counter(), time.process_time()
    kept = KeptFrames(out / KEPT_FRAMES)
    if inputs.source.is_slow:
        kept.forget_others({inputs.source.fingerprint(frame) for frame in inputs.frames})
    forget_unfinished(out)
    try:
        with (
            all_or_nothing(out, SEQUENCE_OUTPUTS) as folder,
            _recorder(recording, folder / "recording.rrd") as recorder,
        ):
            fused = fuse_sequence(
                inputs.frames,
                inputs.source,
                inputs.poses,
                settings,
                kept=kept,
                observe=all_of(_say, recorder),
            )
            write_sequence(folder, fused)
            report = {
                **inputs.described,
                **sequence_report(fused),
                "depths": inputs.source.settings(),
                "seconds": round(time.perf_counter() - begun[0], 2),
                "seconds of all processors": round(time.process_time() - begun[1], 2),
                "versions": versions(),
            }
            recorder("run", report)
            write_json(folder / "run.json", report)
    except BaseException:
        if kept.folder.is_dir():
            warn(
                f"the depths of the frames so far are kept in {kept.folder}; the same command "
                "goes on from them"
            )
        raise
    if not keep_frames:
        shutil.rmtree(kept.folder, ignore_errors=True)
    _conclude(report, out)


def _recorder(
    recording: Literal["save", "none"], path: Path
) -> contextlib.AbstractContextManager[Callable[[str, object], None]]:
    """Return the observer that draws, or one that does not."""
    from recon.observer import ignore

    if recording == "none":
        return contextlib.nullcontext(ignore)
    from recon.viewer.sequence import SequenceObserver

    return SequenceObserver(path)


def _say(_stage: str, result: object) -> None:
    """Print one line a frame."""
    from recon.fusion import Fusion
    from recon.sequence import FusedFrame

    if isinstance(result, Fusion):
        console.print(
            f"voxels of {result.voxel_m:g} m, surfaces within {result.truncation_m:g} m; at least "
            f"{result.min_views} frames must agree",
            soft_wrap=True,
        )
    if isinstance(result, FusedFrame):
        frame = result.frame
        how = " (kept by an earlier run)" if frame.from_disk else ""
        step = f", fitness {frame.step.fitness:.0%}" if frame.step is not None else ""
        console.print(
            f"  {result.number + 1:>4} of {result.count} {frame.name}: {result.volume.blocks:,} "
            f"blocks{step}{how}",
            soft_wrap=True,
        )


def _conclude(report: dict[str, Any], out: Path) -> None:
    """Print what was made and where it lies."""
    if "drift" in report:
        warn(f"{report['poses']}; {_drift_in_words(report['drift'])}")
    console.print(f"{report['in short']}; results lie in {out}", soft_wrap=True)


def _drift_in_words(drift: str | dict[str, float]) -> str:
    if isinstance(drift, str):
        return f"drift {drift}"
    metres, degrees, _ = drift.values()
    return f"the last frame, placed by the first, lies {metres:.3f} m and {degrees:.2f} degrees off"
