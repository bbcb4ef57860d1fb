"""The shape of a feature network, and what follows from the shape alone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

__all__ = ["VARIANTS", "Architecture", "architecture_named"]

STEP_REACH_PX = 2
STEPS = (2 * STEP_REACH_PX + 1) ** 2 - 1
TAPS = 9  # of a convolution of 3 x 3
MOST_BRANCHES = 5
"""Matching strip by strip begins strips at multiples of 16 rows: further halving would show."""


@dataclass(frozen=True)
class Architecture:
    """The shape of a feature network.

    It sees further by more convolutions, by pooled branches (cheap, but on a coarser grid) or by
    dilated convolutions (at full size, at full price).

    Attributes:
        channels: maps of each branch, full size first, each next one halved; one entry means no
            pooling.
        depth: convolutions of each branch.
        features: length of a pixel's vector.
        direct: whether the steps to the neighbours are themselves a part of the vector, so that
            what the convolutions find is added to a soft census transform.
        direct_share: share of those steps in the square of the vector's length; 0 leaves it to the
            training.
        faint_step: difference of grey in [0, 1] at which a step counts half; a few times the noise
            of the sensor.
        dilations: how many pixels apart the taps of each convolution at full size are, one entry
            a convolution; empty means that all touch.

    Raises:
        ValueError: if there is no such network.
    """

    channels: tuple[int, ...] = (64,)
    depth: int = 4
    features: int = 64
    direct: bool = False
    direct_share: float = 0.0
    faint_step: float = 0.015
    dilations: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not 1 <= len(self.channels) <= MOST_BRANCHES:
            raise ValueError(
                f"channels must have from 1 to {MOST_BRANCHES} branches, got {len(self.channels)}"
            )
        if min(*self.channels, *self.dilations, self.depth, self.features) < 1:
            raise ValueError(f"channels, depth, features, dilations must be positive: {self}")
        if self.learned < 1:
            raise ValueError(
                f"features must be more than the {STEPS} steps of a direct network, "
                f"got {self.features}"
            )
        if not 0 <= self.direct_share < 1 or (self.direct_share and not self.direct):
            raise ValueError(
                "direct_share must be in [0, 1), and 0 unless direct, "
                f"got {self.direct_share} with direct {self.direct}"
            )
        if not self.faint_step > 0:
            raise ValueError(f"faint_step must be positive, got {self.faint_step}")
        if self.dilations and len(self.dilations) != self.depth:
            raise ValueError(
                f"dilations must be one a convolution: depth is {self.depth} but there are "
                f"{len(self.dilations)}"
            )

    @property
    def learned(self) -> int:
        """Entries of a pixel's vector that the last convolution makes."""
        return self.features - STEPS if self.direct else self.features

    @property
    def spacings(self) -> tuple[tuple[int, ...], ...]:
        """How far apart the taps of each convolution of each branch are, in its own pixels."""
        touching = (1,) * self.depth
        return (self.dilations or touching, *(touching for _ in self.channels[1:]))

    @property
    def stride_px(self) -> int:
        """A crop sees the same pooling grid as the image if its first row is a multiple of this."""
        return 1 << (len(self.channels) - 1)

    @property
    def margin_px(self) -> int:
        """Rows or columns beyond a pixel that its vector depends on, and no fewer.

        Under pooling pixels differ in how far they see; this is the furthest. The grid is its own
        mirror image, so it is enough to look down.
        """
        rows, levels = range(self.stride_px), range(len(self.channels))
        return max(self._last_seen(row, level) - row for row in rows for level in levels)

    def _last_seen(self, row: int, level: int) -> int:
        """Return the last row on which the vector of `row` depends by a branch.

        Bilinear enlarging by s reads the two rows around (y + 0.5) / s - 0.5; row k of a halved
        branch is the mean of the rows 2 k - 1 to 2 k + 2.
        """
        scale = 1 << level
        last = math.ceil((row + 1 + 0.5) / scale - 0.5)  # the last convolution adds a row
        for below in range(level, 0, -1):
            last = 2 * (last + sum(self.spacings[below])) + 2
        return last + sum(self.spacings[0]) + STEP_REACH_PX

    @property
    def products_per_pixel(self) -> float:
        """Multiplications by a weight, each with its addition, for one pixel of one image."""
        total, incoming = 0.0, STEPS
        for level, channels in enumerate(self.channels):
            weights = TAPS * channels * (incoming + (self.depth - 1) * channels)
            mixing = channels * self.features
            total += (weights + mixing) / 4**level  # pixels of a halved branch are fewer by 4
            incoming = channels
        return total + TAPS * self.features * self.learned

    @property
    def gflop_per_megapixel_pair(self) -> float:
        """10^9 operations for two images of 10^6 pixels: 2 a product, in all convolutions."""
        return 2 * 2 * self.products_per_pixel * 1e6 / 1e9


VARIANTS: Mapping[str, Architecture] = MappingProxyType(
    {
        "fast": Architecture(direct=True, faint_step=0.004),
        "wide": Architecture((64, 64, 96, 96), direct=True, faint_step=0.004),
    }
)
"""The networks that are trained to ship."""


def architecture_named(name: str) -> Architecture:
    """Return a variant.

    Raises:
        ValueError: if there is none of that name.
    """
    if name not in VARIANTS:
        raise ValueError(f"unknown variant {name!r}; there are {', '.join(VARIANTS)}")
    return VARIANTS[name]
