"""Colours for disparities and for the states of pixels, the same in files and in the viewer."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from recon.types import Array, PixelStatus

__all__ = [
    "COLOUR_TABLE",
    "MISSING_COLOUR",
    "STATUS_COLOURS",
    "colour_mapped",
    "colour_range",
    "status_colours",
]

Colour = tuple[int, int, int]

MISSING_COLOUR: Colour = (48, 48, 48)
"""Dark grey, which no value has."""

STATUS_COLOURS = MappingProxyType(
    {
        PixelStatus.OUTSIDE: (70, 70, 74),
        PixelStatus.MATCHED: (76, 160, 120),
        PixelStatus.OCCLUDED: (38, 62, 140),
        PixelStatus.MISMATCHED: (190, 50, 52),
        PixelStatus.FILLED_OCCLUSION: (126, 174, 232),
        PixelStatus.FILLED_MISMATCH: (246, 184, 84),
    }
)
"""One colour a state; a filled pixel has the lighter tone of the reason that it was filled."""

FAR_TO_NEAR = (
    (42, 30, 98),
    (46, 88, 184),
    (36, 152, 186),
    (84, 190, 130),
    (222, 212, 92),
    (240, 140, 56),
    (176, 42, 44),
)


def _colour_table() -> Array:
    """Return 256 colours on straight lines between those of FAR_TO_NEAR, (256, 3) uint8."""
    corners = np.linspace(0, 255, len(FAR_TO_NEAR))
    anchors = np.array(FAR_TO_NEAR)  # (anchors, 3)
    table = np.zeros((256, 3), dtype=np.uint8)
    for channel in range(3):
        table[:, channel] = np.rint(np.interp(np.arange(256), corners, anchors[:, channel]))
    return table


COLOUR_TABLE = _colour_table()
COLOUR_TABLE.flags.writeable = False


def colour_range(values: Array) -> tuple[float, float]:
    """Return the range that colours should span: all but the outermost 1 % on either side.

    Args:
        values: any shape; NaN and infinite values are not counted.

    Returns:
        (lowest, highest) with lowest < highest; (0, 1) if no value is finite.
    """
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0, 1.0
    lowest, highest = (float(limit) for limit in np.percentile(finite, (1, 99)))
    if highest - lowest < 1e-6 * max(1.0, abs(highest)):
        return lowest - 0.5, highest + 0.5
    return lowest, highest


def colour_mapped(values: Array, lowest: float, highest: float) -> Array:
    """Give every value a colour, from indigo at `lowest` to red at `highest`.

    Args:
        values: (H, W); values out of range take the colour of the nearer end.
        lowest: value of the first colour.
        highest: value of the last colour.

    Returns:
        (H, W, 3) uint8 RGB; dark grey where a value is not finite.
    """
    present = np.isfinite(values)
    share = (np.where(present, values, lowest) - lowest) / (highest - lowest)
    colours = COLOUR_TABLE[np.rint(np.clip(share, 0, 1) * 255).astype(np.uint8)]
    colours[~present] = MISSING_COLOUR
    return colours


def status_colours(status: Array) -> Array:
    """Give every state its colour.

    Args:
        status: (H, W) uint8, a `PixelStatus`.

    Returns:
        (H, W, 3) uint8 RGB.
    """
    table = np.zeros((256, 3), dtype=np.uint8)
    for state, colour in STATUS_COLOURS.items():
        table[int(state)] = colour
    return table[status]
