"""Named values of a file, JSON or YAML, that say where they stand when one is wrong."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from calib.formats.protocol import Array

__all__ = ["Section"]


@dataclass(frozen=True)
class Section:
    """An object of a file.

    Attributes:
        entries: its values by name.
        place: how it is reached from the top, "left." for instance, for messages.
    """

    entries: dict[str, Any]
    place: str = ""

    def __contains__(self, key: str) -> bool:
        return self.entries.get(key) is not None

    def value(self, key: str) -> Any:  # noqa: ANN401  JSON or YAML
        """Return what stands under `key`; raise ValueError if nothing does."""
        if key not in self.entries:
            got = ", ".join(map(str, self.entries)) or "nothing"
            raise ValueError(f"there is no {self.place}{key}; got {got}; is the file cut off?")
        return self.entries[key]

    def text(self, key: str) -> str:
        """Return a word; raise ValueError if something else stands there."""
        value = self.value(key)
        if not isinstance(value, str):
            raise ValueError(f"{self.place}{key} must be a word, got {value!r}")  # noqa: TRY004  a user's mistake
        return value

    def section(self, key: str) -> Section:
        """Return the object under `key`; raise ValueError if something else stands there."""
        value = self.value(key)
        if not isinstance(value, dict):
            raise ValueError(f"{self.place}{key} must be an object {{...}}, got {value!r}")  # noqa: TRY004  a user's mistake
        return Section(value, f"{self.place}{key}.")

    def array(self, key: str, shape: tuple[int, ...]) -> Array:
        """Return finite numbers of a shape, in which -1 stands for any length."""
        value = self.value(key)
        try:
            array = np.array(value, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{self.place}{key} must be numbers, got {value!r}") from error
        if array.ndim != len(shape) or any(
            wanted not in (-1, came) for wanted, came in zip(shape, array.shape, strict=True)
        ):
            raise ValueError(f"{self.place}{key} must have shape {shape}, got {array.shape}")
        if not np.isfinite(array).all():
            raise ValueError(f"{self.place}{key} must be finite, got {value!r}")
        return array

    def number(self, key: str) -> float:
        """Return one number."""
        return float(self.array(key, ()))

    def pair(self, key: str) -> tuple[float, float]:
        """Return two numbers."""
        first, second = self.array(key, (2,)).tolist()
        return first, second

    def size(self, key: str) -> tuple[int, int]:
        """Return two whole numbers, (width, height)."""
        width, height = self.pair(key)
        return int(width), int(height)
