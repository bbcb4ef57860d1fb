"""Many pairs, or depth maps, of one scene from a camera that moves: one mesh, one cloud."""

from recon.sequence.frames import FrameOnDisk, find_depth_frames, find_pairs
from recon.sequence.posing import poses_of_frames
from recon.sequence.run import FusedFrame, FusedSequence, SequenceSettings, fuse_sequence
from recon.sequence.sources import DepthSource, RgbdSource, StereoSource

__all__ = [
    "DepthSource",
    "FrameOnDisk",
    "FusedFrame",
    "FusedSequence",
    "RgbdSource",
    "SequenceSettings",
    "StereoSource",
    "find_depth_frames",
    "find_pairs",
    "fuse_sequence",
    "poses_of_frames",
]
