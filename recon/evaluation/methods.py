"""What can be evaluated: a preset, an OpenCV matcher, or maps that somebody else made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np

from recon.evaluation.layouts.truths import disparity_from_levels
from recon.evaluation.opencv_matchers import OpenCvMatcher
from recon.evaluation.scene import Scene
from recon.files import read_pfm
from recon.settings import Preset, spelled_out
from recon.types import Array, DisparityMap, PixelStatus

__all__ = ["MapsOnDisk", "MatcherOfOpenCv", "MatcherOfPreset", "Method"]

LEVELS_PER_PX = 256.0
"""A PNG of 16 bits holds disparities times 256, as KITTI stores them; 0 is none."""


class Method(Protocol):
    """Something that gives every scene a disparity map.

    Attributes:
        name: of its row.
        kind: preset, baseline or files.
        measured: it computes here, so its time and memory mean something.
        confident: its confidences say which pixels to trust.
    """

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def kind(self) -> str: ...  # noqa: D102
    @property
    def measured(self) -> bool: ...  # noqa: D102
    @property
    def confident(self) -> bool: ...  # noqa: D102

    def settings(self) -> Mapping[str, Any]:
        """Return everything that can change its result, for the record."""
        ...

    def __call__(self, scene: Scene) -> DisparityMap[Array]:
        """Return the disparities of the left view."""
        ...


@dataclass(frozen=True)
class MatcherOfPreset:
    """A preset of ours.

    Attributes:
        name: of its row.
        preset: its matcher is run.
        device: where.
    """

    name: str
    preset: Preset
    device: str = "cpu"
    kind: str = field(default="preset", init=False)
    measured: bool = field(default=True, init=False)
    confident: bool = field(default=True, init=False)

    def settings(self) -> Mapping[str, Any]:
        """Return the preset as tables, and the device."""
        return {**spelled_out(self.preset), "device": self.device}

    def __call__(self, scene: Scene) -> DisparityMap[Array]:
        """Match the pair."""
        return self.preset.matcher(scene.pair, scene.disparities, device=self.device)


@dataclass(frozen=True)
class MatcherOfOpenCv:
    """A matcher of OpenCV, for comparison.

    Attributes:
        name: of its row.
        matcher: with its settings.
    """

    name: str
    matcher: OpenCvMatcher
    kind: str = field(default="baseline", init=False)
    measured: bool = field(default=True, init=False)
    confident: bool = field(default=False, init=False)

    def settings(self) -> Mapping[str, Any]:
        """Return the fields of the matcher."""
        return {**asdict(self.matcher), "opencv": cv2.__version__}

    def __call__(self, scene: Scene) -> DisparityMap[Array]:
        """Match the pair."""
        return self.matcher(scene.pair, scene.disparities)


@dataclass(frozen=True)
class MapsOnDisk:
    """Disparities that any program wrote, one file a scene.

    Attributes:
        name: of its row.
        folder: that holds SCENE.pfm, SCENE.png (16 bits, pixels times 256), SCENE.npy, or a
            folder SCENE with disparity.pfm or disp0NAME.pfm; all of them may lie in a folder
            with the name of the data set.
    """

    name: str
    folder: Path
    kind: str = field(default="files", init=False)
    measured: bool = field(default=False, init=False)
    confident: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        if not self.folder.is_dir():
            raise ValueError(
                f"{self.folder}, the disparities of {self.name}, is not a folder; give NAME=DIR "
                "with one file a scene, such as DIR/Teddy.pfm"
            )

    def settings(self) -> Mapping[str, Any]:
        """Return where the maps lie, and which they were."""
        maps = sorted(path for path in self.folder.rglob("*") if path.suffix in READERS)
        stamps = {
            str(path.relative_to(self.folder)): [path.stat().st_size, path.stat().st_mtime_ns]
            for path in maps
        }
        return {"folder": str(self.folder), "files": stamps}

    def __call__(self, scene: Scene) -> DisparityMap[Array]:
        """Read the map of a scene.

        Raises:
            FileNotFoundError: if there is none.
            ValueError: if there are several, or it is not a map of disparities.
        """
        path = self._file(scene)
        values = READERS[path.suffix](path).astype(np.float32)
        if values.ndim != 2:
            raise ValueError(f"{path} is {values.shape}; expected a map (rows, columns)")
        present = np.isfinite(values)
        status = np.where(present, PixelStatus.MATCHED, PixelStatus.MISMATCHED).astype(np.uint8)
        return DisparityMap(
            np.where(present, values, np.float32(np.nan)), status, present.astype(np.float32)
        )

    def _file(self, scene: Scene) -> Path:
        """Return the one file that holds the map of a scene."""
        for folder in (self.folder / scene.dataset, self.folder):
            alone = [folder / f"{scene.name}{suffix}" for suffix in READERS]
            inside = [
                folder / scene.name / "disparity.pfm",
                *sorted((folder / scene.name).glob("disp0*.pfm")),
            ]
            for found in (_existing(alone), _existing(inside)):
                if len(found) > 1:
                    names = ", ".join(str(path.relative_to(self.folder)) for path in found)
                    raise ValueError(
                        f"{self.folder} holds {len(found)} maps of {scene.name} ({names}); keep one"
                    )
                if found:
                    return found[0]
        raise FileNotFoundError(
            f"{self.folder} holds no map of {scene.name}; expected {scene.name}.pfm, .png (16 bits)"
            f" or .npy, or {scene.name}/disparity.pfm"
        )


def _existing(paths: list[Path]) -> list[Path]:
    """Return those that are files, and not the truth."""
    return [path for path in paths if path.is_file() and not path.name.startswith("disp0GT")]


def _read_png(path: Path) -> Array:
    """Read disparities times 256 from 16 bits."""
    stored = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if stored is None:
        raise ValueError(f"{path} cannot be read as a PNG; was the copy interrupted?")
    if stored.dtype != np.uint16 or stored.ndim != 2:
        raise ValueError(
            f"{path} is {stored.dtype} with {1 if stored.ndim == 2 else stored.shape[2]} channels; "
            "disparities need 16 bits and one channel (pixels times 256), or a PFM: 8 bits say "
            "nothing of their scale"
        )
    return disparity_from_levels(stored, levels_per_px=LEVELS_PER_PX)


def _read_npy(path: Path) -> Array:
    """Read a map that NumPy saved."""
    values: Array = np.load(path, allow_pickle=False)
    if not np.issubdtype(values.dtype, np.number) or np.iscomplexobj(values):
        raise ValueError(f"{path} holds {values.dtype}; expected numbers")
    return values


READERS = {".pfm": read_pfm, ".png": _read_png, ".npy": _read_npy}
