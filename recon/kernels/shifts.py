"""Compare every pixel of one array with the pixels at several shifts along the row of another.

All functions share one indexing: result[y, x, k] compares reference[y, x] with
other[y, x - shifts[k]], and is +inf where that column does not exist.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from recon.kernels.compiled import Array, array_of, compiled, on_cpu, prange

__all__ = ["cosine_distances", "diagonals", "hamming_distances", "outside", "pixel_differences"]

BLOCK_COLUMNS = 64
"""B columns cost B + D - 1 products each: wider wastes more, narrower multiplies less densely."""


def outside(width: int, shifts: range, device: torch.device) -> Tensor:
    """Return which columns have no partner.

    Args:
        width: W of both arrays.
        shifts: the D shifts.
        device: where the answer should be.

    Returns:
        (W, D) bool, True where x - shifts[k] is not in [0, W).
    """
    columns = torch.arange(width, device=device)[:, None]
    partner = columns - torch.arange(shifts.start, shifts.stop, device=device)  # (W, D)
    return (partner < 0) | (partner >= width)


def _mark_outside(result: Tensor, shifts: range) -> Tensor:
    """Write +inf into `result` (H, W, D), in place, where there is no partner."""
    width = result.shape[1]
    missing = outside(width, shifts, result.device)
    for part in (slice(0, max(0, shifts[-1])), slice(max(0, width + min(0, shifts[0])), width)):
        result[:, part].masked_fill_(missing[part], float("inf"))
    return result


def diagonals(volume: Tensor, shifts: range) -> Tensor:
    """Return the comparisons of a volume by the columns of the other array.

    result[y, x, k] = volume[y, x + shifts[k], k]; +inf where that column does not exist.

    Args:
        volume: (H, W, D), indexed by the columns of the reference.
        shifts: D consecutive shifts in columns.
    """
    height, width, count = volume.shape
    if on_cpu(volume):
        result = volume.new_zeros(volume.shape)
        _diagonals(array_of(volume), shifts[0], array_of(result))
        return result
    before, after = max(0, -shifts[0]), max(0, shifts[-1])
    padded = torch.nn.functional.pad(volume, (0, 0, before, after), value=float("inf"))
    row, column = padded.stride(0), padded.stride(1)
    start = (before + shifts[0]) * column
    return padded.as_strided((height, width, count), (row, column, column + 1), start).contiguous()


@compiled(parallel=True)
def _diagonals(volume: Array, first: int, result: Array) -> None:
    """Fill `result` (H, W, D)."""
    height, width, count = volume.shape
    for y in prange(height):
        for x in range(width):
            for k in range(count):
                column = x + first + k
                inside = 0 <= column < width
                result[y, x, k] = volume[y, column, k] if inside else np.inf


def cosine_distances(reference: Tensor, other: Tensor, shifts: range) -> Tensor:
    """Return one minus the scalar product of vectors, at every shift.

    A block of columns of the reference is multiplied with all columns of the other array that it
    can meet, row by row; the diagonals of that product are the shifts. So nearly all the work is
    in matrix products.

    Args:
        reference: (C, H, W) float32, of length 1 at most along C.
        other: (C, H, W), likewise.
        shifts: D consecutive shifts in columns.

    Returns:
        (H, W, D) float32 in [0, 2]; +inf outside.
    """
    _, height, width = reference.shape
    count, last = len(shifts), shifts[-1]
    before, after = max(0, last), max(0, -shifts[0])
    rows = reference.permute(1, 2, 0).contiguous()  # (H, W, C); free for channels_last
    partners = torch.nn.functional.pad(other.permute(1, 2, 0), (0, 0, before, after))
    result = reference.new_zeros((height, width, count))
    for start in range(0, width, BLOCK_COLUMNS):
        block = min(BLOCK_COLUMNS, width - start)
        lowest = before + start - last  # padded column u is x = u - before
        window = partners[:, lowest : lowest + block + count - 1]
        products = torch.bmm(rows[:, start : start + block], window.mT)  # (H, B, B + D - 1)
        row, column = products.stride(0), products.stride(1)
        band = products.as_strided((height, block, count), (row, column + 1, 1))
        torch.sub(1.0, band.flip(2), out=result[:, start : start + block])
    result.clamp_(min=0.0)  # rounding must not make a distance negative
    return _mark_outside(result, shifts)


def pixel_differences(
    reference: Tensor, other: Tensor, shifts: range, *, squared: bool = False
) -> Tensor:
    """Return the mean over the channels of |r - o|, or of (r - o)^2, at every shift.

    Args:
        reference: (C, H, W) float32.
        other: (C, H, W), likewise.
        shifts: D consecutive shifts in columns.
        squared: square the differences instead of taking their size.

    Returns:
        (H, W, D) float32; +inf outside.
    """
    channels, height, width = reference.shape
    result = reference.new_full((height, width, len(shifts)), float("inf"))
    if on_cpu(reference):
        mirrored = array_of(other.flip(2))
        _pixel_differences(array_of(reference), mirrored, shifts[0], squared, array_of(result))
        return result
    for index, shift in enumerate(shifts):
        start, stop = max(0, shift), min(width, width + shift)
        if start < stop:
            step = reference[:, :, start:stop] - other[:, :, start - shift : stop - shift]
            size = step.square() if squared else step.abs()
            result[:, start:stop, index] = size.sum(0) / channels
    return result


@compiled(parallel=True)
def _pixel_differences(
    reference: Array, mirrored: Array, first: int, squared: bool, result: Array
) -> None:
    """Fill `result` (H, W, D); `mirrored` is the other array with its columns reversed."""
    channels, height, width = reference.shape
    count = result.shape[2]
    for y in prange(height):
        for x in range(width):
            base = width - 1 - x + first  # mirrored column of the first shift
            start, stop = max(0, -base), min(count, width - base)
            if start >= stop:
                continue
            line = result[y, x, start:stop]
            line[:] = np.float32(0.0)
            for c in range(channels):
                value = reference[c, y, x]
                partners = mirrored[c, y, base + start : base + stop]
                for k in range(stop - start):
                    step = value - partners[k]
                    line[k] += step * step if squared else abs(step)
            for k in range(stop - start):
                line[k] /= np.float32(channels)


def hamming_distances(reference: Tensor, other: Tensor, cells: Tensor, shifts: range) -> Tensor:
    """Return the share of bits in which two words differ, at every shift.

    Only bits that are set in the `cells` of both pixels count.

    Args:
        reference: (H, W) int64, 63 bits at most.
        other: (H, W), likewise.
        cells: (H, W) int64, which bits mean something; the same for both arrays.
        shifts: D consecutive shifts in columns.

    Returns:
        (H, W, D) float32 in [0, 1]; +inf outside, 1 where no bit can be compared.
    """
    height, width = reference.shape
    result = reference.new_full((height, width, len(shifts)), float("inf"), dtype=torch.float32)
    if on_cpu(reference):
        _hamming_distances(
            array_of(reference),
            array_of(other.flip(1)),
            array_of(cells),
            array_of(cells.flip(1)),
            shifts[0],
            array_of(result),
        )
        return result
    for index, shift in enumerate(shifts):
        start, stop = max(0, shift), min(width, width + shift)
        if start < stop:
            here, there = slice(start, stop), slice(start - shift, stop - shift)
            both = cells[:, here] & cells[:, there]
            differ = _count_bits((reference[:, here] ^ other[:, there]) & both)
            result[:, here, index] = torch.where(
                both == 0, 1.0, differ / _count_bits(both).clamp(min=1)
            )
    return result


def _count_bits(words: Tensor) -> Tensor:
    """Return how many bits of every non-negative int64 are set.

    Source: Warren, Hacker's Delight, 2nd ed. 2013, section 5-1.
    """
    words = words - ((words >> 1) & 0x5555555555555555)
    words = (words & 0x3333333333333333) + ((words >> 2) & 0x3333333333333333)
    words = (words + (words >> 4)) & 0x0F0F0F0F0F0F0F0F
    words = words + (words >> 8)
    words = words + (words >> 16)
    return (words + (words >> 32)) & 0x7F


@compiled()
def _count_bits_of(word: np.uint64) -> np.uint64:
    """Return how many bits are set; LLVM turns this into one instruction where there is one."""
    word = word - ((word >> np.uint64(1)) & np.uint64(0x5555555555555555))
    word = (word & np.uint64(0x3333333333333333)) + (
        (word >> np.uint64(2)) & np.uint64(0x3333333333333333)
    )
    word = (word + (word >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    count: np.uint64 = (word * np.uint64(0x0101010101010101)) >> np.uint64(56)
    return count


@compiled(parallel=True)
def _hamming_distances(
    reference: Array,
    mirrored: Array,
    cells: Array,
    mirrored_cells: Array,
    first: int,
    result: Array,
) -> None:
    """Fill `result` (H, W, D); the mirrored arrays have their columns reversed."""
    height, width = reference.shape
    count = result.shape[2]
    for y in prange(height):
        for x in range(width):
            base = width - 1 - x + first  # mirrored column of the first shift
            start, stop = max(0, -base), min(count, width - base)
            if start >= stop:
                continue
            line = result[y, x, start:stop]
            partners = mirrored[y, base + start : base + stop]
            partner_cells = mirrored_cells[y, base + start : base + stop]
            word, word_cells = reference[y, x], cells[y, x]
            for k in range(stop - start):
                both = word_cells & partner_cells[k]
                shared = np.float32(_count_bits_of(np.uint64(both)))
                differ = np.float32(_count_bits_of(np.uint64((word ^ partners[k]) & both)))
                line[k] = differ / shared if shared > 0 else np.float32(1.0)
