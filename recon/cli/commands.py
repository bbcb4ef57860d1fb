"""Every command by its name, and what happens when one fails."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, NoReturn

import tyro

from recon.cli.calibrate import calibrate
from recon.cli.compare import compare
from recon.cli.convert import convert
from recon.cli.evaluate import evaluate
from recon.cli.look import presets, view
from recon.cli.pair import demo, pair
from recon.cli.rectify import rectify
from recon.cli.sequence import sequence
from recon.cli.terminal import errors
from recon.cli.train import train, train_regulariser

__all__ = ["COMMANDS", "main"]


COMMANDS: dict[str, Callable[..., Any]] = {
    "pair": pair,
    "demo": demo,
    "calibrate": calibrate,
    "compare": compare,
    "convert": convert,
    "evaluate": evaluate,
    "presets": presets,
    "rectify": rectify,
    "sequence": sequence,
    "train": train,
    "view": view,
}


SECOND: dict[str, Callable[..., Any]] = {"train-regulariser": train_regulariser}
TWO_WORDS = {"train regulariser": "train-regulariser", "train features": "train"}
"""What is said in two words, and the command that it is."""


def main(arguments: list[str] | None = None) -> None:
    """Run the command; mistakes of the user end it with one message and status 2."""
    words = sys.argv[1:] if arguments is None else arguments
    if said := TWO_WORDS.get(" ".join(words[:2])):
        words = [said, *words[2:]]
    try:
        tyro.extras.subcommand_cli_from_dict(
            COMMANDS | SECOND,
            prog="reconstruct",
            description="From a pair of photographs to a metric point cloud and a textured mesh.",
            args=words,
            config=(
                tyro.conf.FlagCreatePairsOff,
                tyro.conf.DisallowNone,
                tyro.conf.PositionalMetavarFromFieldName,
            ),
        )
    except (ValueError, OSError, ImportError, MemoryError) as error:
        _end_with(str(error) or type(error).__name__)
    except RuntimeError as error:
        if "memory" not in str(error):  # torch has no class of its own for it on every device
            raise
        _end_with(f"{error}; try --scale 0.5, or a smaller range of disparities")
    except KeyboardInterrupt:
        errors.print("stopped; nothing was written")
        sys.exit(130)


def _end_with(message: str) -> NoReturn:
    """Say what was wrong and end the program."""
    errors.print("error:", style="bold red", end=" ")
    errors.print(message, soft_wrap=True)
    sys.exit(2)
