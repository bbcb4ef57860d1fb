"""The entries of an OpenCV FileStorage, found by any of the names in use."""

from __future__ import annotations

import re

import cv2
import numpy as np

from calib.formats.protocol import Array

__all__ = ["SIDES", "Values", "find", "find_size", "image_size", "load_values", "plain", "sided"]

Value = Array | str
Values = dict[str, Value]

SIDES = {"left": ("1", "l", "left"), "right": ("2", "r", "right")}
SIZES = ("imagesize", "size", "imgsize", "calibimagesize")
WIDTHS, HEIGHTS = ("imagewidth", "width"), ("imageheight", "height")


def load_values(text: str) -> Values:
    """Return every top-level entry, by its name in lower case and without underscores."""
    if "!!opencv-matrix" in text and not text.lstrip().startswith("%YAML"):
        text = "%YAML:1.0\n---\n" + text  # the head that people forget, and OpenCV needs
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    except (cv2.error, SystemError) as error:  # OpenCV's constructor fails with SystemError
        raise ValueError("OpenCV cannot read it; is the file cut off or edited by hand?") from error
    values = {}
    for key in storage.root().keys():  # noqa: SIM118  a FileNode, not a dictionary
        value = _value(storage.getNode(key), key)
        if value is not None:
            values[plain(key)] = value
    return values


def _value(node: cv2.FileNode, key: str) -> Value | None:
    """Return a matrix, list, number or text; None for structures of other kinds."""
    if node.isString():
        return node.string()
    if node.isReal() or node.isInt():
        return np.array([node.real()])
    if node.isSeq():
        parts = [_value(node.at(index), key) for index in range(node.size())]
        numbers = [part for part in parts if isinstance(part, np.ndarray)]
        return np.concatenate(numbers) if numbers and len(numbers) == len(parts) else None
    if "data" not in node.keys():  # noqa: SIM118  a FileNode, not a dictionary
        return None
    try:
        return np.asarray(node.mat(), dtype=np.float64)
    except cv2.error as error:
        raise ValueError(
            f"matrix {key} cannot be read: its numbers are not rows x cols; is the file cut off?"
        ) from error


def plain(name: str) -> str:
    """Return a name without capitals, underscores, hyphens and blanks."""
    return re.sub(r"[-_ ]", "", name).lower()


def sided(names: tuple[str, ...], side: str) -> tuple[str, ...]:
    """Return each name with each spelling of the side after and before it."""
    spellings = SIDES[side]
    return tuple(both for name in names for way in spellings for both in (name + way, way + name))


def find(values: Values, names: tuple[str, ...], *, count: int | None = None) -> Array | None:
    """Return the first array of one of the names, with `count` numbers if that is given.

    The count keeps a lens coefficient k1 from being taken for a camera matrix K1.
    """
    for name in names:
        value = values.get(name)
        if isinstance(value, np.ndarray) and (count is None or value.size == count):
            return value
    return None


def find_size(values: Values, names: tuple[str, ...]) -> tuple[int, int] | None:
    """Return the (width, height) under one of the names."""
    found = find(values, names, count=2)
    if found is None:
        return None
    width, height = found.ravel()
    return int(width), int(height)


def image_size(values: Values) -> tuple[int, int] | None:
    """Return the (width, height) of the images, as one entry or as two."""
    width, height = find(values, WIDTHS, count=1), find(values, HEIGHTS, count=1)
    if width is not None and height is not None:
        return int(width.item()), int(height.item())
    return find_size(values, SIZES)
