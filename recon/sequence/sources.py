"""Where the depth of a frame comes from: a matched pair, or a file of depths."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from calib.formats import LengthUnit
from calib.pair import RectifiedPair, StereoPair
from calib.pose import Pose
from calib.rectify import Rectifier
from calib.rig import RectifiedGeometry
from recon.disparity_range import estimate_range
from recon.files import read_depth, read_image
from recon.fusion import KINECT_NOISE, DepthNoise, DepthView, stereo_noise
from recon.matcher import Matcher
from recon.pairs import PairOnDisk, read_pair
from recon.refinement import LocalPlanes
from recon.sequence.frames import FrameOnDisk
from recon.settings import Preset, spelled_out
from recon.triangulation import depth_map
from recon.types import Array

__all__ = ["DepthSource", "RgbdSource", "SeenFrame", "StereoSource", "looked_at_first"]

STEPS_OF_TRUST = 255
KEPT_VERSION = 3
"""Of the depths kept on disk; another one makes them stale."""


@dataclass(frozen=True, eq=False)
class SeenFrame:
    """What is known of a frame before its pose.

    Attributes:
        depth: (H, W) float32 metres, NaN where it is unknown or not trustworthy.
        trust: (H, W) uint8, probability that it is right in steps of 1 / 255.
        image: (H, W, 3) uint8 RGB, on the same pixels.
        noise_times: (H, W) float16, how many times the noise of the source a depth errs.
    """

    depth: Array
    trust: Array
    image: Array
    noise_times: Array


class DepthSource(Protocol):
    """Turns the files of a frame into depths."""

    @property
    def is_slow(self) -> bool:
        """Whether depths take long enough to be kept on disk for a run that is resumed."""
        ...

    def see(self, frame: FrameOnDisk) -> SeenFrame:
        """Return the depths of a frame."""
        ...

    def view(self, seen: SeenFrame, world_from_camera: Pose) -> DepthView:
        """Return what was seen from where the camera that took the files stood."""
        ...

    @property
    def rectified_from_files(self) -> Pose:
        """The turn from the camera that took the files to the one of the views."""
        ...

    def fingerprint(self, frame: FrameOnDisk) -> str:
        """Return a text that is another one for other files or settings."""
        ...

    def settings(self) -> dict[str, Any]:
        """Return what depths depend on beside the files of a frame, for run.json."""
        ...


@dataclass(frozen=True, eq=False)
class StereoSource:
    """Depths from pairs of one rig.

    Attributes:
        calibration: file in any format of `calib.formats`.
        preset: how to match.
        disparities: candidates, pixels at the size that is matched.
        geometry: of every pair that is matched.
        rectifier: of raw pairs; None for rectified ones.
        unit: of the lengths in the calibration, where it does not say.
        device: where to match.
    """

    calibration: Path
    preset: Preset
    disparities: range
    geometry: RectifiedGeometry
    rectifier: Rectifier | None = None
    unit: LengthUnit | None = None
    device: str = "cpu"

    @property
    def is_slow(self) -> bool:
        """See `DepthSource`."""
        return True

    @cached_property
    def matcher(self) -> Matcher:
        """That of the preset without planes: views share what these are off by.

        One view alone is nearer to the truth with them, the mean of many without.
        """
        matcher = self.preset.matcher
        kept = (each for each in matcher.refinements if not isinstance(each, LocalPlanes))
        return replace(matcher, refinements=tuple(kept))

    def see(self, frame: FrameOnDisk) -> SeenFrame:
        """See `DepthSource`; what the preset leaves out of clouds has no depth."""
        pair = _rectified(
            read_pair(
                frame.first,
                frame.second,
                self.calibration,
                rectified=self.rectifier is None,
                unit=self.unit,
            ),
            self.rectifier,
            self.geometry.size,
        )
        disparity = self.matcher(pair, self.disparities, device=self.device)
        kept = self.preset.triangulation.kept_pixels(disparity, pair.geometry)
        depth = np.where(kept, depth_map(disparity, pair.geometry), np.nan)
        trust = np.rint(np.clip(disparity.confidence, 0, 1) * STEPS_OF_TRUST)
        sigma_px = self.preset.triangulation.disparity_sigma(disparity)
        return SeenFrame(
            depth.astype(np.float32),
            trust.astype(np.uint8),
            pair.left,
            sigma_px.astype(np.float16),
        )

    def view(self, seen: SeenFrame, world_from_camera: Pose) -> DepthView:
        """See `DepthSource`; a raw camera is turned to its rectified one."""
        (cx, cy), f = self.geometry.centre_left, self.geometry.focal_px
        return DepthView(
            depth=seen.depth,
            trust=seen.trust.astype(np.float32) / STEPS_OF_TRUST,
            image=seen.image,
            K=np.array([[f, 0, cx], [0, f, cy], [0, 0, 1]]),
            noise=self.noise,
            world_from_camera=world_from_camera @ self.rectified_from_files.inverse(),
            noise_times=seen.noise_times.astype(np.float32),
        )

    @property
    def noise(self) -> DepthNoise:
        """The error of the depths for a standard deviation of one pixel."""
        return stereo_noise(self.geometry)

    @property
    def rectified_from_files(self) -> Pose:
        """See `DepthSource`."""
        if self.rectifier is None:
            return Pose.identity()
        return Pose(self.rectifier.rotations[0], np.zeros(3))

    def fingerprint(self, frame: FrameOnDisk) -> str:
        """See `DepthSource`."""
        return _digest(self._described, frame)

    def settings(self) -> dict[str, Any]:
        """See `DepthSource`."""
        return {
            "calibration": str(self.calibration),
            "taken as": "rectified" if self.rectifier is None else "raw",
            "disparities": {"from": self.disparities[0], "to": self.disparities[-1]},
            "geometry": asdict(self.geometry),
            "settings": spelled_out(self.preset),
        }

    @cached_property
    def _described(self) -> str:
        whole = {**self.settings(), "file": _file_digest(self.calibration), "unit": self.unit}
        return json.dumps(whole, sort_keys=True, default=str)


@dataclass(frozen=True, eq=False)
class RgbdSource:
    """Depths from files of a depth camera, on the pixels of its colours.

    Attributes:
        K: (3, 3) of the camera, pixels.
        per_metre: value of a depth of one metre; 1000 for millimetres.
        noise: the error of the depths.
    """

    K: Array
    per_metre: float = 1000.0
    noise: DepthNoise = KINECT_NOISE

    @classmethod
    def of(cls, intrinsics: tuple[float, float, float, float], unit_m: float) -> RgbdSource:
        """Return the source for a camera that is told by fx, fy, cx, cy in pixels.

        Args:
            intrinsics: (0, 0) is the centre of a pixel.
            unit_m: length of one step of the depths.

        Raises:
            ValueError: if a focal length or the unit is not positive.
        """
        fx, fy, cx, cy = intrinsics
        if not (fx > 0 and fy > 0 and unit_m > 0):
            raise ValueError(
                f"focal lengths and the unit of depth must be positive, got {fx:g} and {fy:g} px, "
                f"{unit_m:g} m"
            )
        return cls(np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), 1 / unit_m)

    @property
    def is_slow(self) -> bool:
        """See `DepthSource`."""
        return False

    def see(self, frame: FrameOnDisk) -> SeenFrame:
        """See `DepthSource`; every depth is trusted."""
        depth = read_depth(frame.second, per_metre=self.per_metre)
        trust = np.where(np.isfinite(depth), STEPS_OF_TRUST, 0).astype(np.uint8)
        once = np.ones(depth.shape, np.float16)
        return SeenFrame(depth, trust, read_image(frame.first), once)

    def view(self, seen: SeenFrame, world_from_camera: Pose) -> DepthView:
        """See `DepthSource`."""
        trust = seen.trust.astype(np.float32) / STEPS_OF_TRUST
        return DepthView(seen.depth, trust, seen.image, self.K, self.noise, world_from_camera)

    @property
    def rectified_from_files(self) -> Pose:
        """See `DepthSource`."""
        return Pose.identity()

    def fingerprint(self, frame: FrameOnDisk) -> str:
        """See `DepthSource`."""
        return _digest(json.dumps(self.settings(), sort_keys=True), frame)

    def settings(self) -> dict[str, Any]:
        """See `DepthSource`."""
        return {
            "taken as": "colours and depths",
            "K px": np.asarray(self.K).tolist(),
            "depth units per metre": self.per_metre,
            "noise": asdict(self.noise),
        }


@dataclass(frozen=True, eq=False)
class FirstLook:
    """What a few pairs say of all of them.

    Attributes:
        source: the first pair as it was read.
        pair: the same rectified, at the size that is matched.
        rectifier: of raw pairs.
        disparities: that the calibration suggests, or that cover what the pairs looked at show.
    """

    source: PairOnDisk
    pair: RectifiedPair
    rectifier: Rectifier | None
    disparities: range


def looked_at_first(
    frames: Sequence[FrameOnDisk],
    calibration: Path,
    *,
    rectified: bool | None = None,
    unit: LengthUnit | None = None,
    scale: float = 1.0,
    disparities: range | None = None,
) -> FirstLook:
    """Read the first pair, and look at two more for the range of disparities if nobody says.

    Args:
        frames: all of them.
        calibration: file in any format of `calib.formats`.
        rectified: whether the rows of the pictures agree already; None leaves it to the file.
        unit: of the lengths in the calibration, where it does not say.
        scale: rectified pairs are resized by this.
        disparities: to search, at the size that is matched; estimated if not given.

    Raises:
        ValueError: if a file is not what it should be, or almost nothing matches.
    """
    first = read_pair(
        frames[0].first, frames[0].second, calibration, rectified=rectified, unit=unit
    )
    raw = first.pair
    rectifier = Rectifier(raw.calibration) if isinstance(raw, StereoPair) else None
    whole = raw.left.shape[1::-1] if rectifier is None else rectifier.geometry.size
    size = max(1, round(whole[0] * scale)), max(1, round(whole[1] * scale))
    pair = _rectified(first, rectifier, size)
    if disparities is None and first.disparities is not None and scale == 1.0:
        disparities = first.disparities
    if disparities is None:
        ranges = [estimate_range(pair)]
        for frame in {
            frames[len(frames) // 2].name: frames[len(frames) // 2],
            "": frames[-1],
        }.values():
            other = read_pair(
                frame.first, frame.second, calibration, rectified=rectifier is None, unit=unit
            )
            ranges.append(estimate_range(_rectified(other, rectifier, size)))
        disparities = range(min(r.start for r in ranges), max(r.stop for r in ranges))
    return FirstLook(first, pair, rectifier, disparities)


def _rectified(
    source: PairOnDisk, rectifier: Rectifier | None, size: tuple[int, int]
) -> RectifiedPair:
    """Return a pair rectified, and resized if need be."""
    pair = source.pair
    if isinstance(pair, StereoPair):
        assert rectifier is not None, "a raw pair among rectified ones"
        pair = rectifier(pair)
    return pair if pair.geometry.size == size else pair.resized(size)


def _digest(described: str, frame: FrameOnDisk) -> str:
    """Return a text that changes with the settings and with the contents of both files."""
    digest = hashlib.sha256(f"{KEPT_VERSION} {described}".encode())
    for path in (frame.first, frame.second):
        digest.update(_file_digest(path).encode())
    return digest.hexdigest()[:32]


def _file_digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
