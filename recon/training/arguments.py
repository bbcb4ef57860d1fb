"""Settings from a command line with the standard library alone, spelled as `reconstruct train`."""

from __future__ import annotations

import argparse
import inspect
import re
import sys
from collections.abc import Sequence
from dataclasses import fields
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

from recon.training.recipe import Recipe
from recon.training.settings import FeatureTraining, RegulariserTraining, Training

__all__ = ["TRAININGS", "parsed"]

TRAININGS: dict[str, type[Training]] = {
    "features": FeatureTraining,
    "regulariser": RegulariserTraining,
}
"""What can be trained, by the first word of a command line; the first if there is none."""


def parsed(arguments: Sequence[str] | None, description: str | None) -> tuple[Training, str]:
    """Return the settings and the device that a command line asks for.

    Args:
        arguments: words; those of the program if None.
        description: what the program does, for --help.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    name = words.pop(0) if words and words[0] in TRAININGS else next(iter(TRAININGS))
    kind = TRAININGS[name]
    parser = argparse.ArgumentParser(
        description=description, epilog=f"first word: {' or '.join(TRAININGS)}; this is {name}"
    )
    parser.add_argument("--device", default="cpu", help="where to compute")
    _add_options(parser, kind, "")
    found: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in vars(parser.parse_args(words)).items()
    }
    device: str = found.pop("device")
    own = {name: value for name, value in found.items() if "." not in name}
    nested = {name.split(".")[1]: value for name, value in found.items() if "." in name}
    return kind(**own, recipe=Recipe(**nested)), device


def _add_options(parser: argparse.ArgumentParser, kind: type[Any], prefix: str) -> None:
    """Add one option a setting, explained in the words of its docstring."""
    hints = get_type_hints(kind)
    explained = _explained(kind)
    for field in fields(kind):
        if hints[field.name] is Recipe:
            _add_options(parser, Recipe, f"{field.name}.")
            continue
        switched_off = "no-" if field.default is True else ""
        parser.add_argument(
            f"--{prefix}{switched_off}{field.name.replace('_', '-')}",
            dest=prefix + field.name,
            default=field.default,
            help=" ".join(explained[field.name].split()).replace("%", "%%") + _usual(field.default),
            **_reading(hints[field.name]),
        )


def _explained(kind: type[Any]) -> dict[str, str]:
    """Return what the docstrings of a dataclass and of those it extends say of each setting."""
    found: dict[str, str] = {}
    for each in reversed(kind.__mro__):
        found |= re.findall(
            r"^ {4}(\w+): ((?:.|\n {8})+)", inspect.cleandoc(each.__doc__ or ""), re.M
        )
    return found


def _reading(hint: object) -> dict[str, Any]:
    """Return how a setting of this type is read."""
    kinds = [kind for kind in get_args(hint) if kind not in (NoneType, Ellipsis)]
    if hint is bool:
        return {"action": "store_false"}
    if get_origin(hint) is Literal:
        return {"choices": kinds}
    if get_origin(hint) is tuple:
        return {"type": kinds[0], "nargs": "+" if Ellipsis in get_args(hint) else len(kinds)}
    return {"type": kinds[0] if kinds else hint}


def _usual(value: object) -> str:
    """Return what is added to an explanation: the value if nobody says."""
    if value is None or isinstance(value, bool):
        return ""
    spelled = " ".join(map(str, value)) if isinstance(value, tuple) else value
    return f" (default: {spelled})"
