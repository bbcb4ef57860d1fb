"""How much memory a step took at most, of the whole process."""

from __future__ import annotations

import ctypes
import resource
import sys
from contextlib import suppress
from pathlib import Path

__all__ = ["forget_peak", "peak_mb"]

RESET_PEAK = "5"
"""What Linux takes as the order to forget the peak of resident memory (man 5 proc)."""


def forget_peak() -> None:
    """Let the next peak count from now; without effect where the system has no such order."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)  # else memory that an earlier step freed still counts
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text(RESET_PEAK, encoding="ascii")


def peak_mb() -> float:
    """Return the highest resident memory of this process since `forget_peak`, in 10^6 bytes.

    Python, torch and the libraries count, about 400 MB before anything is matched. Where the
    system cannot forget a peak it is the highest since the process began.
    """
    with suppress(OSError, StopIteration):
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
        kib = next(line for line in lines if line.startswith("VmHWM:")).split()[1]
        return int(kib) * 1024 / 1e6
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6
