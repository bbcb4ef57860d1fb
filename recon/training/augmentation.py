"""What two real cameras do differently to one scene."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from recon.training.misalignment import Pairs, displaced, zoomed
from recon.training.photometry import (
    blurred,
    compressed,
    saturated,
    sensed,
    toned,
    uneven,
    vignetted,
)

__all__ = ["Augmentation", "Pairs"]

REFERENCE_WIDTH = 416
BEST_QUALITY = 98
LEAST_BLUR_PX = 0.2  # next to none


@dataclass(frozen=True)
class _Dice:
    """Random tensors on the device of the pictures."""

    generator: torch.Generator

    def uniform(self, low: float, high: float, *size: int) -> Tensor:
        """Return numbers in [low, high)."""
        device = self.generator.device
        return low + (high - low) * torch.rand(size, generator=self.generator, device=device)

    def normal(self, size: torch.Size) -> Tensor:
        """Return numbers of mean 0 and standard deviation 1."""
        return torch.randn(size, generator=self.generator, device=self.generator.device)

    def sometimes(self, share: float, count: int) -> Tensor:
        """Return (N, 1, 1, 1): 1 in `share` of the cases, else 0."""
        return (self.uniform(0, 1, count, 1, 1, 1) < share).float()


def _dice_on(device: torch.device, generator: torch.Generator) -> _Dice:
    """Return dice on a device, which follow from the generator wherever that is."""
    if generator.device == device:
        return _Dice(generator)
    seed = int(torch.randint(2**62, (), generator=generator, device=generator.device))
    return _Dice(torch.Generator(device).manual_seed(seed))


@dataclass(frozen=True)
class Augmentation:
    """Changes that two cameras make, drawn anew for each pair and for each of its views.

    Lengths in pixels are those at a width of 416 and grow with the width; those of blur do not.

    Attributes:
        photometric: change light, tone, sharpness and noise.
        geometric: move rows and colours by fractions of a pixel, and zoom.
        occluders: cover a part of one view.
        mildness: how rare strong differences of the two cameras are: all that sets the views of a
            pair apart is weakened by u^mildness, u uniform in [0, 1]; 0 weakens none. Benchmarks
            and good rigs are far from the worst case; a network that only sees that case learns to
            blur.
        shared: strength of changes that both views share (exposure, gamma, tint, saturation).
        apart: strength of changes that one view has alone.
        contrast: how far the contrast of both views may rise, as a logarithm.
        darkest: how far the exposure of both views may fall, as a logarithm.
        vignetting: largest share of light that the corners lose.
        uneven_light: largest logarithm of the smooth field that lights one view otherwise.
        relit: share of the pairs that have such a field.
        most_noise: largest standard deviation of the noise at white, in [0, 1] units.
        most_blur_px: largest standard deviation of the blur that both views share, and of what
            one of them has besides.
        most_defocus_px: the same of a view that is out of focus.
        defocused: share of the views that are.
        worst_quality: lowest JPEG quality.
        compressed: share of the pairs that were stored as JPEG.
        most_rows_px: largest vertical error of rectification: of a shift, of a turn and of a
            stretch, the latter two at the border.
        most_colours_px: largest displacement of red and blue from green, in half the pairs.
        most_zoom: largest enlargement.
        occluder: largest half extent of an occluder, as a share of the width.
        covered: share of the pairs that have one.

    Raises:
        ValueError: if a setting is out of range.
    """

    photometric: bool = True
    geometric: bool = True
    occluders: bool = True
    mildness: float = 2.0
    shared: float = 0.35
    apart: float = 0.16
    contrast: float = 1.0
    darkest: float = 0.6
    vignetting: float = 0.35
    uneven_light: float = 0.2
    relit: float = 0.5
    most_noise: float = 0.01
    most_blur_px: float = 0.7
    most_defocus_px: float = 1.6
    defocused: float = 0.15
    worst_quality: float = 50.0
    compressed: float = 0.3
    most_rows_px: float = 0.6
    most_colours_px: float = 0.3
    most_zoom: float = 1.25
    occluder: float = 0.1
    covered: float = 0.5

    def __post_init__(self) -> None:
        if not 0 < self.worst_quality <= BEST_QUALITY:
            raise ValueError(
                f"worst_quality must be above 0 and at most {BEST_QUALITY}, "
                f"got {self.worst_quality}"
            )
        if self.mildness < 0:
            raise ValueError(f"mildness must not be negative, got {self.mildness}")
        if self.most_zoom < 1:
            raise ValueError(f"most_zoom must be at least 1, got {self.most_zoom}")
        if self.most_blur_px < LEAST_BLUR_PX:
            raise ValueError(
                f"most_blur_px must be at least {LEAST_BLUR_PX}, got {self.most_blur_px}"
            )

    def __call__(
        self, left: Tensor, right: Tensor, generator: torch.Generator
    ) -> tuple[Tensor, Tensor]:
        """Return the changed pair; what its truth says stays true.

        Args:
            left: (N, 3, H, W) in [0, 1].
            right: (N, 3, H, W), the same.
            generator: source of randomness, on any device.
        """
        dice = _dice_on(left.device, generator)
        severity = dice.uniform(0, 1, len(left), 1, 1, 1) ** self.mildness
        views = left, right
        if self.geometric:
            views = self._misaligned(*views, severity, dice)
        if self.photometric:
            views = self._photographed(*views, severity, dice)
        return views

    def whole(self, pairs: Pairs, generator: torch.Generator) -> Pairs:
        """Return changed pairs with their changed truth: zoom and occluders besides the rest.

        Args:
            pairs: N pairs.
            generator: source of randomness, on any device.
        """
        dice = _dice_on(pairs.left.device, generator)
        if self.geometric:
            pairs = self._enlarged(pairs, dice)
        if self.occluders:
            pairs = self._covered(pairs, dice)
        left, right = self(pairs.left, pairs.right, dice.generator)
        return pairs._replace(left=left, right=right)

    def _enlarged(self, pairs: Pairs, dice: _Dice) -> Pairs:
        """Zoom in, a little more in one direction than in the other."""
        count = len(pairs.left)
        both = self.most_zoom ** dice.uniform(0, 1, count, 1)
        stretch = self.most_zoom ** dice.uniform(-0.3, 0.3, count, 1)
        scale = torch.cat((both * stretch, both / stretch), 1).clamp(1, self.most_zoom)
        return zoomed(pairs, scale, dice.uniform(0, 1, count, 2))

    def _covered(self, pairs: Pairs, dice: _Dice) -> Pairs:
        """Cover an ellipse in one view by what is elsewhere in the batch."""
        count, height, width = pairs.disparity.shape
        y = torch.arange(height, device=dice.generator.device)[:, None]
        x = torch.arange(width, device=dice.generator.device)
        middle = dice.uniform(0, 1, 2, count, 1, 1)
        reach = width * self.occluder * dice.uniform(0.15, 1, 2, count, 1, 1)
        choice = dice.uniform(0, 1, count, 1, 1)
        left_one = choice < self.covered / 2
        right_one = ~left_one & (choice < self.covered)

        def within(column: Tensor) -> Tensor:
            across = (column - middle[0] * width) / reach[0]
            return across**2 + ((y - middle[1] * height) / reach[1]) ** 2 <= 1

        in_left, in_right = within(x) & left_one, within(x) & right_one
        hidden = in_left | (within(x - pairs.disparity) & right_one)
        down, across = dice.uniform(0.2, 0.8, 2).tolist()
        other = pairs.left.roll((1, int(down * height), int(across * width)), (0, 2, 3))
        return Pairs(
            torch.where(in_left[:, None], other, pairs.left),
            torch.where(in_right[:, None], other, pairs.right),
            pairs.disparity,
            pairs.visible & ~hidden,
        )

    def _misaligned(
        self, left: Tensor, right: Tensor, severity: Tensor, dice: _Dice
    ) -> tuple[Tensor, Tensor]:
        """Move the rows of the right view, and the colours of both as their lenses do."""
        count = len(left)
        scale = left.shape[-1] / REFERENCE_WIDTH * severity[:, :, 0, 0]
        rows = scale * self.most_rows_px * dice.uniform(-1, 1, count, 3)
        colours = scale * self.most_colours_px * dice.uniform(-1, 1, 2, count, 2)
        colours *= (dice.uniform(0, 1, 1, count, 1) < 0.5).float()
        still = torch.zeros_like(rows)
        return displaced(left, still, colours[0]), displaced(right, rows, colours[1])

    def _tone(self, count: int, strength: float, dice: _Dice) -> Tensor:
        """Draw logarithms of gain for each channel and of gamma, (N, 4, 1, 1)."""
        gain = dice.uniform(-strength, strength, count, 1, 1, 1)
        tint = dice.uniform(-strength / 2, strength / 2, count, 3, 1, 1)
        gamma = dice.uniform(-strength, strength, count, 1, 1, 1)
        return torch.cat((gain + tint, gamma), 1)

    def _stretched(self, left: Tensor, right: Tensor, dice: _Dice) -> tuple[Tensor, Tensor]:
        """Raise the contrast of both views about one grey."""
        factor = torch.exp(self.contrast * dice.uniform(0, 1, len(left), 1, 1, 1))
        grey = left.mean((1, 2, 3), keepdim=True)
        left, right = ((grey + factor * (view - grey)).clamp(0, 1) for view in (left, right))
        return left, right

    def _photographed(
        self, left: Tensor, right: Tensor, severity: Tensor, dice: _Dice
    ) -> tuple[Tensor, Tensor]:
        """Light, expose, blur and store both views, partly alike."""
        count = len(left)
        shared = self._tone(count, self.shared, dice)
        shared[:, :3] -= self.darkest * dice.uniform(0, 1, count, 1, 1, 1) ** 2
        colourful = 1 + dice.uniform(-self.shared, self.shared, count, 1, 1, 1)
        left, right = self._stretched(left, right, dice)
        field = dice.uniform(-1, 1, count, 1, 3, 4) * dice.uniform(0, 1, count, 1, 1, 1)
        relit = severity * dice.sometimes(self.relit, count)
        right = uneven(right, self.uneven_light * relit * field)
        loss = dice.uniform(0, BEST_QUALITY - self.worst_quality, count)
        quality = BEST_QUALITY - severity[:, 0, 0, 0] * loss
        stored = dice.sometimes(self.compressed, count)
        sharp = dice.uniform(LEAST_BLUR_PX, self.most_blur_px, count, 1, 1, 1)
        views = []
        for view in (left, right):
            tone = shared + severity * self._tone(count, self.apart, dice)
            seen = self._taken(saturated(view, colourful), tone, sharp, severity, dice)
            views.append(torch.where(stored > 0, compressed(seen, quality), seen))
        return views[0], views[1]

    def _taken(
        self, view: Tensor, tone: Tensor, sharp: Tensor, severity: Tensor, dice: _Dice
    ) -> Tensor:
        """Return what one camera makes of what it sees: blur, vignetting, tone and noise."""
        count = len(view)
        own = self.most_blur_px * severity * dice.uniform(0, 1, count, 1, 1, 1)
        defocus = self.most_defocus_px * severity * dice.uniform(0, 1, count, 1, 1, 1)
        defocus = defocus * dice.sometimes(self.defocused, count)
        seen = blurred(view, (sharp**2 + own**2 + defocus**2).sqrt())
        seen = vignetted(seen, self.vignetting * dice.uniform(0, 1, count, 1, 1, 1) ** 2)
        strength = self.most_noise * severity * dice.uniform(0, 1, count, 1, 1, 1)
        return sensed(toned(seen, tone), dice.normal(view.shape), strength)
