"""How loops over pixels become machine code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy.typing as npt
from numba import prange
from torch import Tensor

__all__ = ["Array", "array_of", "compiled", "on_cpu", "prange"]

Array = npt.NDArray[Any]
Function = TypeVar("Function", bound=Callable[..., object])

numba.config.THREADING_LAYER_PRIORITY = ["omp", "workqueue", "tbb"]  # type: ignore[attr-defined]
# OpenMP first, as torch does: an old TBB on the machine, which is tried first else, only warns.

SAFE_FASTMATH = {"reassoc", "contract", "nsz", "arcp"}
"""Sums may be reordered and fused; infinities and NaN keep their meaning: they mark the missing."""


def compiled(*, parallel: bool = False, finite: bool = False) -> Callable[[Function], Function]:
    """Return a decorator that compiles a function of NumPy arrays on its first call.

    The machine code is kept on disk, and the interpreter's lock is released while it runs.

    Args:
        parallel: spread its `prange` loops over the threads.
        finite: no number in it is infinite or NaN, so that minima are found faster.
    """
    flags = SAFE_FASTMATH | {"nnan", "ninf"} if finite else SAFE_FASTMATH

    def compile_function(function: Function) -> Function:
        decorate = numba.njit(cache=True, nogil=True, parallel=parallel, fastmath=flags)
        return cast("Function", decorate(function))

    return compile_function


def on_cpu(tensor: Tensor) -> bool:
    """Return whether compiled loops can read `tensor`."""
    return tensor.device.type == "cpu"


def array_of(tensor: Tensor) -> Array:
    """Return `tensor` as a contiguous array; it shares the memory of a contiguous CPU tensor."""
    return tensor.detach().cpu().contiguous().numpy()
