"""From files to a pair that can be reconstructed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from calib.formats import CalibrationRecord, LengthUnit, read_calibration
from calib.pair import Image, RectifiedPair, StereoPair
from calib.rectify import Rectifier
from calib.uncalibrated import EstimatedRig, estimate_uncalibrated_rig, focal_px_of
from recon.files import read_image_pair, read_side_by_side
from recon.files.exif import focal_length_35mm

__all__ = ["PairOnDisk", "RangeRequest", "read_pair", "read_uncalibrated_pair"]

LEAST_CONTRAST = 1.0
LEAST_FOCAL, MOST_FOCAL = 0.1, 50.0
"""Of the width of the picture: views of 157 and of 1 degree."""


@dataclass(frozen=True, eq=False)
class PairOnDisk:
    """A pair that was read, and what was learned on the way.

    Attributes:
        pair: raw or rectified.
        disparities: the range that the calibration suggests; None if it says nothing.
        inputs: the files it was read from, and how they were taken.
        notes: what a person should know, in sentences.
        metric: whether lengths are metres; if not, the baseline is 1.
    """

    pair: StereoPair | RectifiedPair
    disparities: range | None
    inputs: dict[str, str]
    notes: tuple[str, ...]
    metric: bool = True


def read_pair(
    left: str | Path,
    right: str | Path | None,
    calibration: str | Path,
    *,
    rectified: bool | None = None,
    scale: float = 1.0,
    unit: LengthUnit | None = None,
) -> PairOnDisk:
    """Read two photographs and their calibration.

    Args:
        left: picture of the left camera.
        right: picture of the right camera; None if `left` shows both side by side.
        calibration: file in any format of `calib.formats`.
        rectified: whether the rows of the pictures agree already. None takes raw where the
            calibration has raw cameras for this size, and says so in the notes.
        scale: the rectified pair is resized by this, its geometry with it.
        unit: of lengths, for calibrations that do not say.

    Raises:
        FileNotFoundError: if a file is missing.
        ValueError: if a file is not what it should be; the message names it.
    """
    images = _read_images(left, right, scale)
    height, width = images[0].shape[:2]
    record = read_calibration(calibration, image_size=(width, height), unit=unit)
    pair, notes = _with_calibration(images, record, rectified)
    inputs = {
        "left": str(left),
        "right": str(right if right is not None else left),
        "calibration": str(calibration),
        "calibration format": record.format,
        "taken as": "raw" if isinstance(pair, StereoPair) else "rectified",
        "scale": str(scale),
    }
    disparities = record.disparities
    if scale != 1.0:
        pair = _resized(pair, scale)
        disparities = _scaled(disparities, pair.left.shape[1] / width)
    return PairOnDisk(pair, disparities, inputs, notes)


def read_uncalibrated_pair(
    left: str | Path,
    right: str | Path | None,
    *,
    scale: float = 1.0,
    focal_px: float | None = None,
) -> PairOnDisk:
    """Read two photographs of one camera and estimate from them how it was moved.

    Lengths are in baselines, the distance between the two places; nothing is metric.

    Args:
        left: picture from the left.
        right: picture from the right; None if `left` shows both side by side.
        scale: the rectified pair is resized by this, its geometry with it.
        focal_px: of the pictures as they are; None takes the EXIF note, the matches or a guess.

    Raises:
        FileNotFoundError: if a file is missing.
        ValueError: if a file is not what it should be, or the pictures do not tell the geometry.
    """
    images = _read_images(left, right, scale)
    height, width = images[0].shape[:2]
    if focal_px is not None and not LEAST_FOCAL < focal_px / width < MOST_FOCAL:
        raise ValueError(
            f"a focal length of {focal_px:g} px does not fit pictures {width} px wide; it lies "
            f"between {LEAST_FOCAL * width:.0f} and {MOST_FOCAL * width:.0f} px: is it in mm?"
        )
    # Of two views in one picture the note, if any, is for a sensor of another shape.
    focal_35mm = focal_length_35mm(left) if right is not None and focal_px is None else None
    noted_px = focal_px_of(focal_35mm, (width, height)) if focal_35mm else None
    found = estimate_uncalibrated_rig(*images, focal_px=focal_px or noted_px)
    pair: StereoPair | RectifiedPair = StereoPair(*images, found.calibration)
    focal = f"{found.calibration.left.K[0, 0]:.0f} px, {_focal_source(found, focal_35mm)}"
    inputs = {
        "left": str(left),
        "right": str(right if right is not None else left),
        "calibration": f"none: estimated from {found.count} matches",
        "focal length": focal,
        "taken as": "raw",
        "scale": str(scale),
    }
    notes = (
        f"the cameras were estimated from {found.count} matches, which lie {found.residual_px:.2f} "
        f"px from their epipolar lines in the median; focal length {focal}",
    )
    if scale != 1.0:
        pair = _resized(pair, scale)
    return PairOnDisk(pair, None, inputs, notes, metric=False)


def _focal_source(found: EstimatedRig, focal_35mm: float | None) -> str:
    """Return where the focal length of an estimate comes from, in words."""
    if found.focal_from == "given" and focal_35mm is None:
        return "as given"
    if found.focal_from == "given":
        return f"from the EXIF note of a {focal_35mm} mm lens (35 mm equivalent)"
    if found.focal_from == "matches":
        return "from the matches"
    return (
        "a guess, a 35 mm lens (35 mm equivalent): if it is wrong, depth is stretched against "
        "width; say it with --focal-px"
    )


def _read_images(left: str | Path, right: str | Path | None, scale: float) -> tuple[Image, Image]:
    """Read both views, which must show something."""
    if not 0 < scale <= 4:
        raise ValueError(f"scale must lie between 0 and 4, got {scale}")
    images = read_image_pair(left, right) if right is not None else read_side_by_side(left)
    for image, path in zip(images, (left, right or left), strict=True):
        if image.std() < LEAST_CONTRAST:
            raise ValueError(
                f"{path} shows one colour only (standard deviation {image.std():.2f} of 255); "
                "was a lens covered, or the exposure far off?"
            )
    return images


def _with_calibration(
    images: tuple[Image, Image], record: CalibrationRecord, rectified: bool | None
) -> tuple[StereoPair | RectifiedPair, tuple[str, ...]]:
    """Put images and calibration together, as raw or as rectified."""
    notes = record.notes
    if rectified is None:
        rectified = record.raw is None
        if record.raw is not None and record.rectified is not None:
            notes = (
                *notes,
                "the calibration holds raw and rectified cameras of this size: the images are "
                "taken as raw; say --rectified if their rows agree already",
            )
    if rectified and record.rectified is not None:
        return RectifiedPair(*images, record.rectified), notes
    if not rectified and record.raw is not None:
        return StereoPair(*images, record.raw), notes
    if rectified:
        raise ValueError(
            f"{record.source} describes raw images of this size only, but the images were said to "
            "be rectified; leave out --rectified, or give the calibration of the rectified ones"
        )
    raise ValueError(
        f"{record.source} describes rectified images of this size only: there is nothing to "
        "rectify; leave out --raw if you said it, or give the calibration of the raw images"
    )


def _resized(pair: StereoPair | RectifiedPair, scale: float) -> RectifiedPair:
    """Rectify if need be, and resize both images and the geometry in the same step."""
    if isinstance(pair, StereoPair):
        pair = Rectifier(pair.calibration)(pair)
    height, width = pair.left.shape[:2]
    return pair.resized((max(1, round(width * scale)), max(1, round(height * scale))))


def _scaled(disparities: range | None, factor: float) -> range | None:
    """Return a range that covers the same points at another size."""
    if disparities is None:
        return None
    first = math.floor(disparities[0] * factor)
    last = math.ceil(disparities[-1] * factor)
    return range(first, last + 1)


@dataclass(frozen=True)
class RangeRequest:
    """The disparities that a person asked for, in pixels of the pictures as given.

    Attributes:
        low: the smallest; None leaves it to the calibration.
        high: the largest; None likewise.
        scale: of the pair that is matched.
    """

    low: int | None = None
    high: int | None = None
    scale: float = 1.0

    def applied_to(self, suggested: range | None) -> range | None:
        """Return the range to search, at the size that is matched; None if it must be estimated.

        Args:
            suggested: by the calibration, at the size that is matched.

        Raises:
            ValueError: if only one end is known, or the range is empty.
        """
        if self.low is None and self.high is None:
            return suggested
        if suggested is None and (self.low is None or self.high is None):
            raise ValueError(
                "give --min-disparity and --max-disparity both: the calibration suggests no range"
            )
        first = suggested.start if self.low is None else math.floor(self.low * self.scale)  # type: ignore[union-attr]
        last = suggested.stop - 1 if self.high is None else math.ceil(self.high * self.scale)  # type: ignore[union-attr]
        if last <= first:
            raise ValueError(
                f"disparity range is empty: from {first} to {last} px at the size that is "
                "matched; the maximum must lie above the minimum"
            )
        return range(first, last + 1)

    def origin(self, suggested: range | None) -> str:
        """Return where the range comes from, in words."""
        if self.low is not None or self.high is not None:
            return "the command line"
        return "an estimate from the images" if suggested is None else "the calibration"
