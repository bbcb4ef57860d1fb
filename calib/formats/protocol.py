"""What a file format offers, and the file it is given."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from calib.formats.record import CalibrationRecord

__all__ = ["SAY_THE_UNIT", "CalibrationFile", "LengthUnit", "Reader", "Writer", "as_numbers"]

Array = npt.NDArray[np.float64]
LengthUnit = Literal["m", "cm", "mm"]

METRES: dict[LengthUnit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001}
SAY_THE_UNIT = "say the unit with --unit m, cm or mm (unit= in Python)"
LONGEST_IN_METRES = 10.0
LONGEST_IN_MILLIMETRES = 10_000.0


@dataclass(frozen=True)
class CalibrationFile:
    """A file to read, and what the caller knows besides.

    Attributes:
        path: where it is.
        text: what it holds.
        image_size: (width, height) of the images, for formats that do not say.
        unit: of its lengths, for formats that do not say.
    """

    path: Path
    text: str
    image_size: tuple[int, int] | None = None
    unit: LengthUnit | None = None

    def __post_init__(self) -> None:
        if self.unit is not None and self.unit not in METRES:
            raise ValueError(f"unit must be {', '.join(METRES)} or None, got {self.unit!r}")

    def size_or_given(self, stated: tuple[int, int] | None) -> tuple[int, int]:
        """Return the size that the file states, else the one that the caller gave.

        Raises:
            ValueError: if neither is known.
        """
        size = stated or self.image_size
        if size is None:
            raise ValueError(
                "the file does not say for which image size it is; "
                "give image_size=(width, height) of the images"
            )
        return size

    def metres_per_unit(self, baseline: float) -> tuple[float, tuple[str, ...]]:
        """Return the factor to metres for a file without units, and the note that says so.

        A baseline up to 10 is taken as metres, up to 10 000 as millimetres.

        Args:
            baseline: distance of the cameras in the unit of the file.

        Raises:
            ValueError: if the baseline is too long for both and the caller gave no unit.
        """
        if self.unit is not None:
            return METRES[self.unit], ()
        if baseline > LONGEST_IN_MILLIMETRES:
            raise ValueError(
                f"the cameras stand {baseline:g} apart in a unit that the file does not say; "
                + SAY_THE_UNIT
            )
        unit: LengthUnit = "m" if baseline <= LONGEST_IN_METRES else "mm"
        return METRES[unit], (
            f"the file does not say its unit of length: a baseline of {baseline:g} was taken as "
            f"{unit}; if it is another, {SAY_THE_UNIT}",
        )

    def metres_as_defined(self, baseline: float, tool: str) -> float:
        """Return the factor to metres for a format that is in metres, unless the caller knows more.

        Calibration tools ask for the size of the target in metres, and people give millimetres.

        Args:
            baseline: distance of the cameras as the file has it.
            tool: whose format it is, for the message.

        Raises:
            ValueError: if the baseline is too long for metres and the caller gave no unit.
        """
        if self.unit is None and baseline > LONGEST_IN_METRES:
            raise ValueError(
                f"the cameras stand {baseline:g} m apart, as {tool} files are in metres; was the "
                f"size of the calibration target given in mm or cm? Then {SAY_THE_UNIT}"
            )
        return METRES[self.unit or "m"]


@dataclass(frozen=True)
class Reader:
    """One format that can be read.

    Attributes:
        looks_like: how a person recognises it, for error messages.
        recognises: whether a file is of this format; true also for damaged ones, so that the
            message is about the damage.
        read: the record of a file; raises ValueError without naming the file.
    """

    looks_like: str
    recognises: Callable[[CalibrationFile], bool]
    read: Callable[[CalibrationFile], CalibrationRecord]


@dataclass(frozen=True)
class Writer:
    """One format that can be written.

    Attributes:
        suffixes: endings that its file names may have.
        render: the text of every file that a record becomes, by where it goes; raises ValueError
            if the format cannot hold the record or the files cannot be called so.
    """

    suffixes: tuple[str, ...]
    render: Callable[[CalibrationRecord, Path], dict[Path, str]]


def as_numbers(text: str, count: int, name: str) -> Array:
    """Return exactly `count` finite numbers.

    Args:
        text: numbers between blanks, commas or semicolons.
        count: how many there must be.
        name: of the value, for messages.

    Raises:
        ValueError: if there are more, fewer, or something else.
    """
    words = text.replace(",", " ").replace(";", " ").split()
    try:
        numbers = np.array([float(word) for word in words])
    except ValueError as error:
        raise ValueError(f"{name} must be {count} numbers, got {text.strip()[:60]!r}") from error
    if len(numbers) != count:
        raise ValueError(
            f"{name} must be {count} numbers, got {len(numbers)}; is the file cut off?"
        )
    if not np.isfinite(numbers).all():
        raise ValueError(f"{name} must be finite, got {text.strip()[:60]!r}")
    return numbers
