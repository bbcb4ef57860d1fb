"""What reading a calibration file gives."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from calib.camera import Camera
from calib.rig import RectifiedGeometry, StereoCalibration

__all__ = ["CalibrationRecord"]


@dataclass(frozen=True, eq=False)
class CalibrationRecord:
    """All that a file says of a rig, for its raw images, its rectified ones, or both.

    Attributes:
        raw: the two cameras, for photographs that are still to be rectified; None if the file
            does not hold them.
        rectified: the geometry of photographs that are rectified already; None likewise.
        disparities: the range to search, where the file hints at one, in pixels.
        source: the file.
        format: its format, a key of `READERS`.
        notes: what had to be assumed or was left out, in sentences for a person.

    Raises:
        ValueError: if both `raw` and `rectified` are None.
    """

    raw: StereoCalibration | None
    rectified: RectifiedGeometry | None
    source: Path
    format: str
    disparities: range | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.raw is None and self.rectified is None:
            raise ValueError("a calibration must hold raw cameras or a rectified geometry, or both")

    def for_images(self, size: tuple[int, int]) -> CalibrationRecord:
        """Return the record without what is for images of another size.

        A KITTI file holds both the raw and the (smaller) rectified images: the size tells which
        of them the images are.

        Args:
            size: (width, height) of the images.

        Raises:
            ValueError: if nothing is left.
        """
        raw = self.raw if self.raw and self.raw.left.size == size else None
        rectified = self.rectified if self.rectified and self.rectified.size == size else None
        if raw is None and rectified is None:
            sizes = {part.size for part in (self._raw_camera, self.rectified) if part}
            stated = " or ".join(_words(stated) for stated in sorted(sizes))
            raise ValueError(
                f"the calibration is for {stated} images but the images are {_words(size)} "
                "(width x height); were they resized or cropped, or is it of another rig?"
            )
        left_out = [
            f"the {name} part is for {_words(part.size)} images and was left out"
            for name, part, kept in (
                ("raw", self._raw_camera, raw),
                ("rectified", self.rectified, rectified),
            )
            if part and not kept
        ]
        return replace(self, raw=raw, rectified=rectified, notes=(*self.notes, *left_out))

    @property
    def _raw_camera(self) -> Camera | None:
        return self.raw.left if self.raw else None


def _words(size: tuple[int, int]) -> str:
    return f"{size[0]} x {size[1]}"
