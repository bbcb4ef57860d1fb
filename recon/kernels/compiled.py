"""How loops over pixels become machine code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NoReturn, TypeVar, cast

import numpy.typing as npt
from torch import Tensor

try:
    import numba
    from numba import prange
except ImportError:  # a machine with an accelerator may have torch alone, and needs no loops
    numba, prange = None, range  # type: ignore[assignment,misc]

__all__ = ["Array", "array_of", "compiled", "on_cpu", "prange"]

Array = npt.NDArray[Any]
Function = TypeVar("Function", bound=Callable[..., object])

if numba is not None:
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
        if numba is None:
            return cast("Function", _not_without_numba)
        decorate = numba.njit(cache=True, nogil=True, parallel=parallel, fastmath=flags)
        return cast("Function", decorate(function))

    return compile_function


def _not_without_numba(*_: object) -> NoReturn:
    """Stand for a loop on a machine that cannot compile it."""
    raise ImportError("this needs numba on a CPU (pip install numba); on a CUDA device it does not")


def on_cpu(tensor: Tensor) -> bool:
    """Return whether compiled loops can read `tensor`."""
    return tensor.device.type == "cpu"


def array_of(tensor: Tensor) -> Array:
    """Return `tensor` as a contiguous array; it shares the memory of a contiguous CPU tensor."""
    return tensor.detach().cpu().contiguous().numpy()
