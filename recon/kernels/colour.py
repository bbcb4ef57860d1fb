"""Colours as numbers."""

from __future__ import annotations

from torch import Tensor

__all__ = ["luminance"]


def luminance(image: Tensor) -> Tensor:
    """Return the brightness Y = 0.299 R + 0.587 G + 0.114 B.

    Source: ITU-R BT.601-7, section 2.5.1.

    Args:
        image: (..., 3) RGB.

    Returns:
        (...), in the unit of `image`.
    """
    return image @ image.new_tensor([0.299, 0.587, 0.114])
