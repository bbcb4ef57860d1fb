"""What a camera notes of its lens in a photograph."""

from __future__ import annotations

import os

from PIL import Image as Pictures

__all__ = ["focal_length_35mm"]

EXIF_IFD = 0x8769
FOCAL_LENGTH_IN_35MM_FILM = 0xA405


def focal_length_35mm(path: str | os.PathLike[str]) -> float | None:
    """Return the focal length, as its equivalent in 35 mm photography.

    Args:
        path: a photograph.

    Returns:
        Millimetres; None if the camera, or a program that changed the picture, did not note it.
    """
    try:
        with Pictures.open(path) as picture:
            noted = picture.getexif().get_ifd(EXIF_IFD).get(FOCAL_LENGTH_IN_35MM_FILM)
        return float(noted) if noted and float(noted) > 0 else None
    except (OSError, SyntaxError, TypeError, ValueError):  # damaged, or of a kind without EXIF
        return None
