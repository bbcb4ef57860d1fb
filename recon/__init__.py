"""From a rectified pair of photographs to metric surfaces."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from recon.pairs import read_pair
    from recon.pipeline import Reconstruction, reconstruct
    from recon.rectification import check_rectification, rectify_and_check
    from recon.settings import Preset, load_preset

__all__ = [
    "Preset",
    "Reconstruction",
    "check_rectification",
    "load_preset",
    "read_pair",
    "reconstruct",
    "rectify_and_check",
]

HOMES = {
    "Preset": "recon.settings",
    "Reconstruction": "recon.pipeline",
    "check_rectification": "recon.rectification",
    "load_preset": "recon.settings",
    "read_pair": "recon.pairs",
    "reconstruct": "recon.pipeline",
    "rectify_and_check": "recon.rectification",
}


def __getattr__(name: str) -> object:
    """Import what is asked for only then: the command line answers --help without torch."""
    if name not in HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(HOMES[name]), name)
