"""What is known of trained weights: the header of their file, and a page for people."""

from __future__ import annotations

import platform
import subprocess
from importlib import metadata
from pathlib import Path
from typing import Any

import torch

from recon.training.progress import Scores
from recon.training.run import Run
from recon.training.settings import Training

__all__ = ["about", "card", "commit"]

PACKAGES = ("stereo-recon", "torch", "numpy")
HERE = Path(__file__).parent
UNKNOWN = "unknown"


def commit() -> str:
    """Return the commit that this code is of, `-dirty` if it was changed; "unknown" outside git."""
    try:
        if not _git("ls-files", "."):  # another project's repository lies around us
            return UNKNOWN
        return _git("describe", "--always", "--dirty") or UNKNOWN
    except (OSError, subprocess.SubprocessError):
        return UNKNOWN


def _git(*words: str) -> str:
    done = subprocess.run(
        ["git", "-C", str(HERE), *words], capture_output=True, text=True, check=True, timeout=10
    )
    return done.stdout.strip()


def _versions() -> str:
    found = [f"python {platform.python_version()}"]
    for package in PACKAGES:
        try:
            found.append(f"{package} {metadata.version(package)}")
        except metadata.PackageNotFoundError:
            found.append(f"{package} not installed")
    return ", ".join(found)


def _device(device: torch.device) -> str:
    """Return what computed: the name of an accelerator, or how many threads."""
    if device.type == "cpu":
        return f"CPU, {torch.get_num_threads()} threads"
    return str(torch.get_device_module(device).get_device_name(device))


def about(run: Run[Any], scores: Scores) -> dict[str, str]:
    """Return the header of the weights' file: every setting, and where they come from."""
    return {
        "command": run.settings.command(),
        "commit": commit(),
        "versions": _versions(),
        "device": _device(run.device),
        "seconds": f"{run.seconds:.0f}",
        **{name: str(value) for name, value in run.identity().items()},
        "generated pairs, within 1 px": f"{scores.plain:.4f}",
        "generated pairs with augmentation, within 1 px": f"{scores.augmented:.4f}",
    }


def card(run: Run[Any], scores: Scores) -> str:
    """Return the page that lies beside the weights, in Markdown."""
    settings = run.settings
    known = about(run, scores)
    rows = {
        "architecture": run.shape_in_words(),
        "command": f"`{known['command']}`; every setting is also in the header of the file",
        "commit": known["commit"],
        "versions": known["versions"],
        "data": _data(settings),
        "steps": (
            f"{settings.steps:,} of {settings.batch} crops of {settings.crop_rows} rows; "
            f"{run.seconds / 60:.0f} minutes on {known['device']}"
        ),
        "score": (
            f"within 1 px of the truth, on the visible pixels of the {settings.validation_pairs} "
            f"validation pairs, {run.judged}: {scores.plain:.1%}; with augmentation "
            f"{scores.augmented:.1%}"
        ),
        "licence": "Apache-2.0, like the code",
    }
    lines = [f"| {name} | {value} |" for name, value in rows.items()]
    title = f"# `{settings.name}`: weights of the {run.purpose}"
    return "\n".join([title, "", "| | |", "| --- | --- |", *lines, ""])


def _data(settings: Training) -> str:
    """Return one sentence on the pairs."""
    kept = settings.validation_pairs
    if settings.source == "fresh":
        drawn = settings.steps * settings.batch // settings.uses + settings.window
        count = f"{drawn:,} pairs, each in {settings.uses} batches in the mean, and {kept} more"
    else:
        count = (
            f"{settings.pairs:,} pairs, seeds 0 to {settings.pairs - 1}, of which the last {kept}"
        )
    width, height = settings.size
    return (
        f"{count} only for validation, of {width} x {height} from `recon.training.scenes`, "
        f"recipe {settings.decisive()['recipe']}. "
        "No photograph and no data set was used"
    )
