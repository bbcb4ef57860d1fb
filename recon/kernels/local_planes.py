"""A plane around every pixel, through the values that belong to its surface."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from recon.kernels.compiled import Array, array_of, compiled, prange
from recon.kernels.planes import plane_slopes

__all__ = ["Belonging", "local_planes", "planes_at"]

FIRST_RADIUS, FIRST_EDGE, FIRST_NOISE = 4, 1.0, 0.5
"""Of the planes to begin with, see `plane_slopes`."""
UNSURE = 0.125
"""Value a pixel by which values may differ more from a first plane: its slope is not sure."""
LEAST_WEIGHT = 1.0
"""Of all values of a plane together; the pixel's own weighs up to 1."""
RIDGE = 0.002
"""Added to the second moments, of (radius)^2: across a line of values the slope stays."""


class Belonging(NamedTuple):
    """Which values around a pixel count, each weight falling to 0 there.

    Attributes:
        radius: of the window in pixels.
        step: every so many pixels along both axes, from the middle, is looked at.
        colour: sum of the differences of three channels.
        tolerance: distance from the plane of the round before, in the unit of the values.
    """

    radius: int
    step: int
    colour: float
    tolerance: float


def local_planes(
    values: Tensor, weights: Tensor, guide: Tensor, belonging: Belonging, *, rounds: int
) -> Tensor:
    """Return the value at every pixel of the plane that fits the values around it best.

    The plane minimises sum_q w_q (v_q - a - b . (q - p))^2, moving least squares of first order;
    w_q = W_q (1 - |I_p - I_q| / colour) (1 - e^2 / tolerance^2) (1 - |q - p|^2 / 2 (radius + 1)^2),
    where none is negative, with W the weights, I the guide and e the distance of v_q from the
    plane of the round before. In the first round that has the slope of the nearest values that are
    connected, and the tolerance grows with |q - p|.

    Source: Levin, The Approximation Power of Moving Least-Squares, Mathematics of Computation
    67(224) 1998; reweighted by residuals and colours as in a bilateral filter.

    Args:
        values: (H, W) float32; NaN is missing.
        weights: (H, W) float32 in [0, 1].
        guide: (H, W, 3) float32.
        belonging: which values count.
        rounds: of fitting and weighing anew, at least 1.

    Returns:
        (H, W) float32 on the device of `values`; `values` itself where too few belong.
    """
    start, trust, colours = array_of(values), array_of(weights), array_of(guide)
    slopes = plane_slopes(start, radii=(FIRST_RADIUS,), edge=FIRST_EDGE, noise=FIRST_NOISE)
    planes = np.concatenate((start[..., None], slopes), -1)
    there = ~np.isnan(start)
    for number in range(rounds):
        fitted, unsure = planes.copy(), 0.0 if number else UNSURE
        _fit(start, trust, colours, planes, *belonging, unsure, there, LEAST_WEIGHT, fitted)
        planes = fitted
    return torch.from_numpy(np.ascontiguousarray(planes[..., 0])).to(values.device)


def planes_at(
    wanted: Tensor,
    values: Tensor,
    weights: Tensor,
    guide: Tensor,
    belonging: Belonging,
    *,
    least: float,
) -> Tensor:
    """Return the planes through some values: one round of `local_planes`, begun level.

    Args:
        wanted: (H, W) bool, where `values` are not missing.
        values: (H, W) float32; NaN is missing.
        weights: (H, W) float32 in [0, 1].
        guide: (H, W, 3) float32.
        belonging: which values count.
        least: weight of all values of a plane together; with less it is level, at the value itself.

    Returns:
        (H, W, 3) float32 on the device of `values`: value, change along the row and along the
        column; level where not wanted, NaN where missing.
    """
    start, trust, colours = array_of(values), array_of(weights), array_of(guide)
    level = np.where(np.isnan(start), start, np.float32(0))
    planes = np.stack((start, level, level), -1)
    fitted = planes.copy()
    _fit(start, trust, colours, planes, *belonging, 0.0, array_of(wanted), least, fitted)
    return torch.from_numpy(fitted).to(values.device)


@compiled(parallel=True)
def _fit(  # noqa: PLR0913  compiled
    values: Array, weights: Array, guide: Array, planes: Array, radius: int, step: int,
    colour: float, tolerance: float, unsure: float, wanted: Array, least: float, fitted: Array,
) -> None:  # fmt: skip
    """Fill `fitted` (H, W, 3) with value and slopes; `planes` are those of the round before."""
    height, width = values.shape
    for y in prange(height):
        rows = slice(y - min(radius, y) // step * step, min(height, y + radius + 1), step)
        for x in range(width):
            if not wanted[y, x]:
                continue
            columns = slice(x - min(radius, x) // step * step, min(width, x + radius + 1), step)
            moments = _moments(
                values[rows, columns], weights[rows, columns], guide[rows, columns],
                y - rows.start, x - columns.start, step, radius, guide[y, x], planes[y, x],
                colour, tolerance, unsure,
            )  # fmt: skip
            if moments[0] >= least:
                level, across, down = _solution(moments, RIDGE * radius * radius)
                fitted[y, x, 0] = planes[y, x, 0] + level
                fitted[y, x, 1] = planes[y, x, 1] + across
                fitted[y, x, 2] = planes[y, x, 2] + down


@compiled()
def _moments(  # noqa: PLR0913  compiled
    values: Array, weights: Array, guide: Array, y: int, x: int, step: int, radius: int,
    own: Array, plane: Array, colour: float, tolerance: float, unsure: float,
) -> tuple[float, ...]:  # fmt: skip
    """Return the weighted sums of 1, x, y, xx, xy, yy, v, xv, yv over samples `step` apart.

    The first sample is `y` rows and `x` columns before the pixel, whose colour is `own`; v is how
    far a value lies above `plane`.
    """
    far = 2.0 * (radius + 1) ** 2
    n, mx, my, mxx, mxy, myy, mv, mxv, myv = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for row in range(values.shape[0]):
        dy = float(row * step - y)
        for column in range(values.shape[1]):
            dx = float(column * step - x)
            distance = dx * dx + dy * dy
            v = values[row, column] - (plane[0] + plane[1] * dx + plane[2] * dy)
            most = tolerance + unsure * np.sqrt(distance)
            if not abs(v) < most:  # nor if it is missing
                continue
            alike = 1.0 - _difference(own, guide[row, column]) / colour
            if alike <= 0.0:
                continue
            near = (1.0 - (v / most) ** 2) * (1.0 - distance / far)
            weight = weights[row, column] * alike * near
            n, mx, my = n + weight, mx + weight * dx, my + weight * dy
            mxx, mxy, myy = mxx + weight * dx * dx, mxy + weight * dx * dy, myy + weight * dy * dy
            mv, mxv, myv = mv + weight * v, mxv + weight * dx * v, myv + weight * dy * v
    return n, mx, my, mxx, mxy, myy, mv, mxv, myv


@compiled()
def _difference(one: Array, other: Array) -> float:
    """Return the sum of the differences of three channels."""
    return float(abs(one[0] - other[0]) + abs(one[1] - other[1]) + abs(one[2] - other[2]))


@compiled()
def _solution(moments: tuple[float, ...], ridge: float) -> tuple[float, float, float]:
    """Return the value and the slopes that solve the normal equations, by the adjugate matrix."""
    n, mx, my, mxx, mxy, myy, mv, mxv, myv = moments
    mxx, myy = mxx + ridge * n, myy + ridge * n
    a, b, c = mxx * myy - mxy * mxy, my * mxy - mx * myy, mx * mxy - my * mxx
    d, e, f = n * myy - my * my, mx * my - n * mxy, n * mxx - mx * mx
    scale = 1.0 / (n * a + mx * b + my * c)
    return (
        (a * mv + b * mxv + c * myv) * scale,
        (b * mv + d * mxv + e * myv) * scale,
        (c * mv + e * mxv + f * myv) * scale,
    )
