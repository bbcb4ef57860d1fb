"""Which photographs belong together, told by their names."""

from __future__ import annotations

import glob
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Paired", "PhotographPair", "pair_by_name", "photographs"]

ENDINGS = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pgm")
SIDE_WORDS = re.compile(r"(?<![a-z])(left|right|l|r|cam[01]|camera[01])(?![a-z])", re.IGNORECASE)
DIGITS = "0123456789"


@dataclass(frozen=True)
class PhotographPair:
    """Two photographs of one moment; `right` is None where one file shows both side by side."""

    name: str
    left: Path
    right: Path | None


@dataclass(frozen=True)
class Paired:
    """Pairs, and the files without a partner."""

    pairs: tuple[PhotographPair, ...]
    alone: tuple[Path, ...]


def photographs(pattern: str) -> list[Path]:
    """Return the pictures that a pattern such as `left/*.png` stands for, or those in a folder.

    Raises:
        FileNotFoundError: if there are none.
    """
    place = Path(pattern)
    if place.is_dir():
        found = [path for path in place.iterdir() if path.suffix.lower() in ENDINGS]
    else:
        found = [Path(path) for path in glob.glob(pattern, recursive=True)]  # noqa: PTH207  absolute patterns
    found = sorted(path for path in found if path.is_file())
    if not found:
        raise FileNotFoundError(
            f"no picture matches {pattern}; give a folder, or a pattern in quotes such as "
            "'left/*.png'"
        )
    return found


def pair_by_name(left: Sequence[Path], right: Sequence[Path]) -> Paired:
    """Put the photographs together whose names differ by the side only.

    Of each list the beginning and the end that all names share is dropped, and so are words such as
    left, right, cam0 and cam1; what remains must be equal.

    Args:
        left: of the left camera.
        right: of the right camera.

    Raises:
        ValueError: if no names agree, or one list holds a name twice.
    """
    ours, theirs = _keyed(left), _keyed(right)
    common = [key for key in ours if key in theirs]
    if not common:
        raise ValueError(
            f"no names agree: the left photographs are {_some(left)}, the right ones "
            f"{_some(right)}; photographs of one moment must have the same name or number"
        )
    same = set(left) & set(right)
    if same:
        raise ValueError(
            f"{min(same)} is a left and a right photograph; do both patterns match one folder?"
        )
    alone = [ours[key] for key in ours if key not in theirs]
    alone += [theirs[key] for key in theirs if key not in ours]
    pairs = [PhotographPair(ours[key].name, ours[key], theirs[key]) for key in common]
    return Paired(tuple(pairs), tuple(alone))


def _keyed(paths: Sequence[Path]) -> dict[str, Path]:
    """Return each path by what tells its name from the others."""
    stems = [SIDE_WORDS.sub("", path.stem) for path in paths]
    begin = _common(stems)
    end = _common([stem[len(begin) :][::-1] for stem in stems])
    keyed: dict[str, Path] = {}
    for path, stem in zip(paths, stems, strict=True):
        key = stem[len(begin) : len(stem) - len(end)] if len(paths) > 1 else stem
        if key in keyed:
            raise ValueError(f"{keyed[key]} and {path} have the same number; keep one of them")
        keyed[key] = path
    return keyed


def _common(stems: Sequence[str]) -> str:
    """Return the beginning that all stems share, up to their numbers."""
    first, last = min(stems), max(stems)
    length = next(
        (place for place, (a, b) in enumerate(zip(first, last, strict=False)) if a != b),
        min(len(first), len(last)),
    )
    return first[:length].rstrip(DIGITS)


def _some(paths: Sequence[Path]) -> str:
    names = [path.name for path in paths[:3]]
    return ", ".join(names) + (", ..." if len(paths) > len(names) else "")
