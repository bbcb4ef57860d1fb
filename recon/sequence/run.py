"""The whole path of a sequence: see each frame, place it, average it in; then the surface."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.pose import Pose
from calib.trajectories import Trajectory
from recon.fusion import DepthView, FusedSurface, Fusion, Volume
from recon.observer import Observer, ignore
from recon.sequence.frames import FrameOnDisk
from recon.sequence.kept_frames import KeptFrames
from recon.sequence.odometry import LABEL, Drift, Step, drift_between
from recon.sequence.placing import PlacedFrame, placed_frames, sight_of
from recon.sequence.sources import DepthSource

__all__ = ["FusedFrame", "FusedSequence", "SequenceSettings", "fuse_sequence"]

VOXELS_PER_SIGMA = 2.0
"""With a truncation of 6 voxels, errors of up to three standard deviations are averaged."""
PIXELS_PER_VOXEL = 1.5
VOXELS_ACROSS = 400
"""Memory of a surface as wide as what a view sees goes with the square of it."""
SHORTEST_LOOP = 3


@dataclass(frozen=True)
class SequenceSettings:
    """How a sequence is fused; see `recon.fusion.Fusion`. What is None is chosen from the data.

    Attributes:
        voxel_m: side of a voxel; None takes 1.5 widths of a pixel at the median depth, or if that
            is more, half the standard deviation there of pixels that weigh as much as the mean one
            (finer ones would hold noise), or 1/400 of what a view sees there from side to side
            (finer ones take memory).
        max_depth_m: depths beyond make no surface; None means those whose standard deviation
            exceeds the truncation.
        min_trust: depths less likely to be right are left out.
        min_views: fewest views that must see a surface.
        truncation_voxels: how far around a surface it counts.
    """

    voxel_m: float | None = None
    max_depth_m: float | None = None
    min_trust: float = 0.3
    min_views: int = 2
    truncation_voxels: float = 6.0

    def fusion_for(self, views: Sequence[DepthView], count: int) -> Fusion:
        """Return settings for a sequence of `count` frames from a few of its views.

        Raises:
            ValueError: if the views have no depth, or a setting is out of range.
        """
        voxel = self.voxel_m if self.voxel_m is not None else _fitting_voxel(views, self.min_trust)
        return Fusion(
            voxel_m=voxel,
            truncation_voxels=self.truncation_voxels,
            min_trust=self.min_trust,
            min_views=self.min_views,
            max_depth_m=self.max_depth_m,
        ).for_views(count)


@dataclass(frozen=True, eq=False)
class FusedFrame:
    """What observers are told after each frame.

    Attributes:
        frame: what it shows and where it was taken.
        number: from 0.
        count: of all frames.
        volume: with this frame in it.
    """

    frame: PlacedFrame
    number: int
    count: int
    volume: Volume


@dataclass(frozen=True, eq=False)
class FusedSequence:
    """What a sequence turned into.

    Attributes:
        surface: in the world frame of the poses.
        trajectory: where the camera of the files stood.
        world_from_first: pose of the first view, rectified.
        fusion: the settings, chosen ones included.
        farthest_m: the greatest depth of the first, the middle and the last view that made a
            surface.
        blocks: of voxels in memory at the end.
        steps: how the frames after the first were placed, empty if poses were given.
        drift: what the last frame says of it; None if it does not see what the first saw, or if
            poses were given.
        from_disk: how many frames an earlier run had kept.
    """

    surface: FusedSurface
    trajectory: Trajectory
    world_from_first: Pose
    fusion: Fusion
    farthest_m: float
    blocks: int
    steps: tuple[Step, ...]
    drift: Drift | None
    from_disk: int


def fuse_sequence(
    frames: Sequence[FrameOnDisk],
    source: DepthSource,
    poses: Sequence[Pose] | None,
    settings: SequenceSettings | None = None,
    *,
    kept: KeptFrames | None = None,
    observe: Observer = ignore,
) -> FusedSequence:
    """Fuse the frames of a sequence to one surface.

    A few frames are in memory at a time; what remains of them is the field, which grows with the
    surface and not with their number.

    Args:
        frames: in the order in which the camera moved.
        source: of their depths.
        poses: `world_from_camera` of the camera of the files, one a frame; estimated from frame to
            frame if not given, with the first frame as the world.
        settings: defaults if not given.
        kept: where depths are kept for a run that is resumed; nowhere if not given.
        observe: told the `Fusion`, a `FusedFrame` after each frame, and the `FusedSurface`.

    Raises:
        ValueError: if a frame cannot be read, matched or placed, or no surface is found.
    """
    if poses is not None and len(poses) != len(frames):
        raise ValueError(f"there are {len(poses)} poses for {len(frames)} frames")
    sight = sight_of(source, kept)
    few = sorted({0, len(frames) // 2, len(frames) - 1})
    looks = [source.view(sight(frames[place])[0], Pose.identity()) for place in few]
    fusion = (settings or SequenceSettings()).fusion_for(looks, len(frames))
    farthest_m = max(fusion.farthest_m(view) for view in looks)
    observe("fusion", fusion)

    volume, log = Volume(fusion), []
    first: PlacedFrame | None = None
    for number, frame in enumerate(placed_frames(frames, source, sight, poses)):
        volume.add(frame.view)
        observe(f"frames/{frame.name}", FusedFrame(frame, number, len(frames), volume))
        first = first or frame
        log.append((frame.pose, frame.step, frame.from_disk))
    assert first is not None, "a sequence without frames"
    all_poses, steps, from_disk = zip(*log, strict=True)

    surface = volume.surface()
    if not len(surface.faces):
        raise ValueError(
            f"no surface was found: nowhere do {fusion.min_views} frames agree on depths up to "
            f"{farthest_m:.2f} m; do the poses belong to these frames, and "
            "are they in metres?"
        )
    observe("surface", surface)
    looped = poses is None and len(frames) >= SHORTEST_LOOP
    return FusedSequence(
        surface=surface,
        trajectory=Trajectory(
            all_poses,
            names=tuple(frame.name for frame in frames),
            notes=(LABEL,) if poses is None else (),
        ),
        world_from_first=first.view.world_from_camera,
        fusion=fusion,
        farthest_m=farthest_m,
        blocks=volume.blocks,
        steps=tuple(step for step in steps if step is not None),
        drift=drift_between(first.view, frame.view) if looped else None,
        from_disk=sum(from_disk),
    )


def _fitting_voxel(views: Sequence[DepthView], min_trust: float) -> float:
    """Return the side of a voxel that suits the median depth, metres, of two digits."""
    trusted = [np.isfinite(view.depth) & (view.trust >= min_trust) for view in views]
    depths = np.concatenate([v.depth[seen] for v, seen in zip(views, trusted, strict=True)])
    if not len(depths):
        raise ValueError(
            f"no depth of the first, the middle and the last frame is trusted to {min_trust:.0%}: "
            "is it too dark, or are the views not of the same moment?"
        )
    times = np.concatenate([v.times[seen] for v, seen in zip(views, trusted, strict=True)])
    median, view = float(np.median(depths)), views[0]
    pixel_m = median / min(view.K[0, 0], view.K[1, 1])
    across_m = median / view.K[0, 0] * view.depth.shape[1]
    weights = np.square(times.astype(np.float64)) ** -1
    sigma_m = float(view.noise.sigma_m(np.float64(median))) / math.sqrt(weights.mean())
    return _two_digits(
        max(PIXELS_PER_VOXEL * pixel_m, sigma_m / VOXELS_PER_SIGMA, across_m / VOXELS_ACROSS)
    )


def _two_digits(value: float) -> float:
    """Round up to two digits: a figure that a person can say again."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / unit - 1e-9) * unit:.2g}")
