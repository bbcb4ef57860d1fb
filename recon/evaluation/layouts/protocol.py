"""What a data set layout offers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from recon.evaluation.scene import Scene, SceneFiles

__all__ = ["Layout"]


@dataclass(frozen=True)
class Layout:
    """One way in which folders hold pairs with truth.

    Attributes:
        name: its key in `LAYOUTS`.
        looks_like: how a person recognises it, for error messages.
        find: the scenes that a folder (an absolute path) is or itself holds, not those of its
            subfolders; [] if it is of another layout. Scenes whose truth is missing are found
            too. Raises ValueError if a whole tree of scenes has no truth.
        read: the scene at such a place. Raises FileNotFoundError or ValueError that names the
            file.
    """

    name: str
    looks_like: str
    find: Callable[[Path], list[SceneFiles]]
    read: Callable[[SceneFiles], Scene]
