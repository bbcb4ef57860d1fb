"""The arithmetic in which networks compute: half precision where the machine is faster in it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Literal

import torch

__all__ = ["Precision", "check_precision", "in_precision"]

Precision = Literal["auto", "float32", "bfloat16"]
PRECISIONS: tuple[Precision, ...] = ("auto", "float32", "bfloat16")
FAST_BFLOAT16 = ("avx512_bf16", "amx_bf16", "avx10_2", "bf16")
"""What multiplies bfloat16 faster in a processor, as `torch.cpu.get_capabilities` calls it."""


@lru_cache(maxsize=4)
def _has_bfloat16(device: torch.device) -> bool:
    """Whether bfloat16 is faster than float32 there, as far as torch says."""
    if device.type != "cpu":
        supports = getattr(torch.get_device_module(device), "is_bf16_supported", None)
        return supports is not None and bool(supports(including_emulation=False))
    known: Mapping[str, object] = getattr(torch.cpu, "get_capabilities", dict)()  # since 2.10
    return any(known.get(name, False) for name in FAST_BFLOAT16)


def in_precision(precision: Precision, device: torch.device) -> torch.autocast:
    """Return a context in which convolutions and matrix products have a precision.

    Args:
        precision: auto takes bfloat16 where the device multiplies it faster. Results then differ
            a little from machine to machine; float32 is slower and differs less.
        device: where to compute.
    """
    half = precision == "bfloat16" or (precision == "auto" and _has_bfloat16(device))
    return torch.autocast(device.type, torch.bfloat16, enabled=half)


def check_precision(precision: str) -> None:
    """Raise unless there is such a precision.

    Raises:
        ValueError: if there is not.
    """
    if precision not in PRECISIONS:
        raise ValueError(f"precision must be one of {', '.join(PRECISIONS)}, got {precision!r}")
