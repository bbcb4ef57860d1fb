"""Each frame of a sequence with the depths it saw and the pose it saw them from."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from calib.pose import Pose
from recon.fusion import DepthView
from recon.sequence.frames import FrameOnDisk
from recon.sequence.kept_frames import KeptFrames
from recon.sequence.odometry import Step, estimated_step
from recon.sequence.sources import DepthSource, SeenFrame

__all__ = ["PlacedFrame", "Sight", "placed_frames", "sight_of"]

Sight = Callable[[FrameOnDisk], tuple[SeenFrame, bool]]
"""Gives what a frame shows, and whether that was kept by an earlier run."""


@dataclass(frozen=True, eq=False)
class PlacedFrame:
    """A frame and where it was taken.

    Attributes:
        name: of the frame.
        view: its depths and the pose of their camera, rectified.
        pose: world_from_camera of the camera that took the files.
        step: how it was placed; None where its pose was given, and for the first.
        from_disk: whether its depths were kept by an earlier run.
    """

    name: str
    view: DepthView
    pose: Pose
    step: Step | None
    from_disk: bool


def sight_of(source: DepthSource, kept: KeptFrames | None) -> Sight:
    """Return how frames are seen: from what was kept, else from their files.

    Args:
        source: of the depths.
        kept: where they are kept, if that takes long; nowhere if not given.
    """
    of_this_run: set[str] = set()

    def sight(frame: FrameOnDisk) -> tuple[SeenFrame, bool]:
        if kept is None or not source.is_slow:
            return source.see(frame), False
        fingerprint = source.fingerprint(frame)
        earlier = kept.get(fingerprint)
        if earlier is not None:
            return earlier, fingerprint not in of_this_run
        seen = source.see(frame)
        kept.put(fingerprint, seen)
        of_this_run.add(fingerprint)
        return seen, False

    return sight


def placed_frames(
    frames: Sequence[FrameOnDisk], source: DepthSource, sight: Sight, poses: Sequence[Pose] | None
) -> Iterator[PlacedFrame]:
    """Give the frames one after the other, at given poses or each placed by the one before.

    Args:
        frames: in order.
        source: of the depths.
        sight: gives them.
        poses: of the camera of the files, one a frame; estimated if not given.

    Raises:
        ValueError: if a step cannot be estimated; the message names its frames.
    """
    before: PlacedFrame | None = None
    for number, frame in enumerate(frames):
        seen, from_disk = sight(frame)
        pose, step = Pose.identity(), None
        if poses is not None:
            pose = poses[number]
        elif before is not None:
            step = _step(before, source.view(seen, pose), frame.name)
            pose = _of_files(source, before.view.world_from_camera @ step.before_from_after)
        before = PlacedFrame(frame.name, source.view(seen, pose), pose, step, from_disk)
        yield before


def _step(before: PlacedFrame, after: DepthView, name: str) -> Step:
    """Estimate a step; the camera may have moved as it did in the step before."""
    guess = before.step.before_from_after if before.step is not None else Pose.identity()
    return estimated_step(before.view, after, first_guess=guess, names=(before.name, name))


def _of_files(source: DepthSource, world_from_rectified: Pose) -> Pose:
    """Return the pose of the camera that took the files from that of its rectified view."""
    return world_from_rectified @ source.rectified_from_files
