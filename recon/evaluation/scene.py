"""A pair with truth: where it lies, and what it holds."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from calib.pair import RectifiedPair
from recon.types import Array

__all__ = ["Scene", "SceneFiles", "Truth"]


@dataclass(frozen=True)
class SceneFiles:
    """Where a pair with truth lies, not read yet; small enough to hand to another process.

    Attributes:
        layout: a key of `LAYOUTS`.
        dataset: name of the data set, such as middlebury-v3/Q.
        name: of the scene, such as Motorcycle.
        folder: that holds its files.
        truth_folder: that holds its truth; most often the same.
    """

    layout: str
    dataset: str
    name: str
    folder: Path
    truth_folder: Path


@dataclass(frozen=True, eq=False)
class Truth:
    """The true disparity of the left view.

    Attributes:
        disparity: (H, W) float32 pixels of this size; NaN where it is unknown.
        visible: (H, W) bool, where both cameras see the point (non-occluded); None if nobody says.
        integer: the truth was rounded to whole pixels.
        full_px_per_px: 1 if the truth has the full size of its benchmark, or no other size is
            known; 2 at half and 4 at quarter size.
    """

    disparity: Array
    visible: Array | None
    integer: bool = False
    full_px_per_px: int = 1

    def __post_init__(self) -> None:
        if self.disparity.ndim != 2:
            raise ValueError(f"true disparities must be (H, W), got {self.disparity.shape}")
        if self.visible is not None and self.visible.shape != self.disparity.shape:
            raise ValueError(
                f"the mask of visible pixels is {self.visible.shape} but the truth is "
                f"{self.disparity.shape} (rows, columns); are they of the same size?"
            )


@dataclass(frozen=True, eq=False)
class Scene:
    """A pair and its truth.

    Attributes:
        dataset: name of the data set.
        name: of the scene.
        pair: rectified; its geometry stands for nothing if `calibrated` is False.
        calibrated: the geometry is that of the photographs, so depths in metres mean something.
        disparities: the range to search, pixels of `pair`.
        truth: at the size of `pair`, or 2 or 4 times larger.
        benchmark: whose rules the official protocol means: middlebury-v3, kitti, or "" for none.
    """

    dataset: str
    name: str
    pair: RectifiedPair
    calibrated: bool
    disparities: range
    truth: Truth
    benchmark: str = ""
