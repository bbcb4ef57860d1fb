"""How numbers are written: the same everywhere, and a dash where there is none."""

from __future__ import annotations

import math

__all__ = ["MISSING", "as_printed", "finite", "fixed", "two_digits"]

MISSING = "–"


def finite(value: object) -> float | None:
    """Return a number, None for anything that is not one or not finite."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def fixed(value: object, decimals: int = 2) -> str:
    """Write a number with a fixed number of decimals; thousands are set apart."""
    number = finite(value)
    return MISSING if number is None else f"{number:,.{decimals}f}"


def two_digits(value: object) -> str:
    """Write a number with two decimals, or more if the first two would not be its own."""
    number = finite(value)
    if not number:
        return fixed(value)
    magnitude = math.floor(math.log10(abs(float(f"{number:.1e}"))))
    return f"{number:,.{max(2, 1 - magnitude)}f}"


def as_printed(value: object) -> str:
    """Write a published figure with no more decimals than it was given."""
    number = finite(value)
    return MISSING if number is None else f"{number:g}"
