"""What the command line prints to, and the words that its commands share."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from rich.console import Console
from tyro.conf import UseAppendAction, arg

if TYPE_CHECKING:
    from recon.settings import Preset

__all__ = [
    "QUIET",
    "Device",
    "Out",
    "Overrides",
    "Progress",
    "Unit",
    "console",
    "device_named",
    "errors",
    "preset_with",
    "warn",
]

console = Console(highlight=False, markup=False)  # brackets in file names are not markup
errors = Console(stderr=True, highlight=False, markup=False)

Device = Literal["auto", "cpu", "cuda"]
Unit = Literal["m", "cm", "mm"]
Out = Annotated[Path, arg(aliases=["-o"])]
Overrides = Annotated[UseAppendAction[tuple[str, ...]], arg(name="set", metavar="SETTING=VALUE")]
QUIET = 1.0 / 3


def device_named(name: Device) -> str:
    """Return the torch device that a name stands for."""
    import torch

    if name == "cuda" and not torch.cuda.is_available():
        raise ValueError("--device cuda: this machine has no CUDA device that torch can use")
    return "cuda" if name != "cpu" and torch.cuda.is_available() else "cpu"


def preset_with(name: str, settings: Path | None, overrides: tuple[str, ...]) -> Preset:
    """Return the preset with the file's settings laid over it, then the command line's."""
    from recon.settings import load_preset, overrides_from

    return load_preset(name, overrides_from(settings, overrides))


def warn(message: str) -> None:
    """Say what a person should not overlook."""
    errors.print("warning:", style="bold yellow", end=" ")
    errors.print(message, soft_wrap=True)


class Progress:
    """An observer that names each stage as it ends."""

    def __init__(self) -> None:
        self._since = time.perf_counter()
        self._status = console.status("starting") if console.is_terminal else None

    def __enter__(self) -> Progress:
        if self._status is not None:
            self._status.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._status is not None:
            self._status.stop()

    def __call__(self, stage: str, result: object) -> None:  # noqa: ARG002  an observer
        """Print the stage that ended, and how long it took."""
        now = time.perf_counter()
        if now - self._since > QUIET or not console.is_terminal:
            console.print(f"  {stage:<32} {now - self._since:6.2f} s")
        if self._status is not None:
            self._status.update(f"after {stage}")
        self._since = now
