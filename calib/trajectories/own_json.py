"""This project's own file of poses: JSON with the units in the names, read back exactly."""

from __future__ import annotations

import json
from typing import Any

from calib.formats.section import Section
from calib.trajectories.protocol import Trajectory, TrajectoryReader, posed

__all__ = ["JSON_POSES", "json_text"]

MARK = "stereo-recon trajectory"
VERSION = 1


def _recognises(text: str) -> bool:
    return text.lstrip().startswith("{")


def _read(text: str) -> Trajectory:
    try:
        content = Section(json.loads(text))
    except json.JSONDecodeError as error:
        raise ValueError(f"not valid JSON ({error}); is the file cut off?") from error
    if content.value("format") != MARK:
        raise ValueError(f"format is {content.value('format')!r}, expected {MARK!r}")
    if content.value("version") != VERSION:
        raise ValueError(
            f"version is {content.value('version')!r} but this program reads {VERSION}; update it?"
        )
    entries = content.value("frames")
    if not isinstance(entries, list):
        raise ValueError(f"frames must be a list, got {type(entries).__name__}")  # noqa: TRY004  a user's mistake
    frames = [Section(entry, f"frames[{place}].") for place, entry in enumerate(entries)]
    poses = []
    for frame in frames:
        pose = frame.section("world_from_camera")
        poses.append(posed(pose.array("R", (3, 3)), pose.array("t_m", (3,)), pose.place[:-1]))
    named = bool(frames) and all("name" in frame for frame in frames)
    timed = bool(frames) and all("time_s" in frame for frame in frames)
    return Trajectory(
        tuple(poses),
        names=tuple(frame.text("name") for frame in frames) if named else None,
        times_s=tuple(frame.number("time_s") for frame in frames) if timed else None,
        format="json",
        notes=(content.text("note"),) if "note" in content else (),
    )


def json_text(trajectory: Trajectory) -> str:
    """Return the text of a file that `read_trajectory` reads exactly as it was."""
    frames = []
    for place, pose in enumerate(trajectory.world_from_camera):
        frame: dict[str, Any] = {}
        if trajectory.names is not None:
            frame["name"] = trajectory.names[place]
        if trajectory.times_s is not None:
            frame["time_s"] = trajectory.times_s[place]
        frame["world_from_camera"] = {"R": pose.R.tolist(), "t_m": pose.t.tolist()}
        frames.append(frame)
    content: dict[str, Any] = {"format": MARK, "version": VERSION}
    if trajectory.notes:
        content["note"] = " ".join(trajectory.notes)
    return json.dumps({**content, "frames": frames}, indent=1) + "\n"


JSON_POSES = TrajectoryReader(
    looks_like=f'stereo-recon JSON: {{"format": "{MARK}", "version": {VERSION}, "frames": [...]}}',
    recognises=_recognises,
    read=_read,
)
