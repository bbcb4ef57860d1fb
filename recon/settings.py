"""Presets: TOML files that spell a method, stage by stage.

A section is a stage. Where a stage has several methods, `method` names one of its table and the
other keys are the fields of that dataclass.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import MISSING, asdict, dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, get_type_hints

from pydantic import TypeAdapter, ValidationError

from calib.row_alignment import RowAlignment
from recon.aggregation import AGGREGATIONS
from recon.cloud_filters import CloudFilters
from recon.coarse_to_fine import CoarseToFine
from recon.confidence import Confidence
from recon.disparity_noise import DisparityNoise
from recon.enlargement import Enlargement
from recon.filling import FILLINGS, SurfaceFilling
from recon.matcher import Matcher
from recon.matching_cost import MATCHING_COSTS
from recon.meshing import Meshing
from recon.optimisation import OPTIMISATIONS
from recon.refinement import REFINEMENTS
from recon.triangulation import Triangulation

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

__all__ = [
    "PRESETS",
    "Preset",
    "load_preset",
    "overrides_from",
    "parse_override",
    "preset_names",
    "spelled_out",
]

PRESETS = Path(__file__).parent / "presets"

STAGES: dict[str, Mapping[str, type]] = {
    "matching_cost": MATCHING_COSTS,
    "aggregation": AGGREGATIONS,
    "optimisation": OPTIMISATIONS,
    "filling": FILLINGS,
    "refinements": REFINEMENTS,
}
"""Stages with a choice of methods; `refinements` is a list of them."""

OPTIONS: dict[str, type] = {
    "filling": SurfaceFilling,
    "confidence": Confidence,
    "coarse_to_fine": CoarseToFine,
    "row_alignment": RowAlignment,
    "enlargement": Enlargement,
}
"""Stages that can be left out by `false`, and put in by `true`: with what is built then."""

AFTER_MATCHING = ("disparity_noise", "triangulation", "cloud", "meshing")
"""Sections that are not of the matcher."""

HANDED_ON = ("points", "noise")
"""Fields that a section has from another one: `[triangulation]` and `[disparity_noise]`."""

Table = dict[str, Any]


@dataclass(frozen=True)
class Preset:
    """Everything between a rectified pair and its surfaces.

    Attributes:
        matcher: from the pair to disparities.
        triangulation: from disparities to points.
        cloud: which of the points stay, by their neighbours.
        meshing: from disparities to triangles.
        description: one line for people.
    """

    matcher: Matcher
    triangulation: Triangulation = field(default_factory=Triangulation)
    meshing: Meshing = field(default_factory=Meshing)
    cloud: CloudFilters = field(default_factory=CloudFilters)
    description: str = ""


def preset_names() -> list[str]:
    """Return the names of the presets that come with the package."""
    return sorted(path.stem for path in PRESETS.glob("*.toml"))


def load_preset(name: str | Path = "paper", overrides: Mapping[str, Any] | None = None) -> Preset:
    """Return a preset, with some settings replaced.

    Args:
        name: of a shipped preset, or the path of a TOML file like one.
        overrides: nested tables as in the file; a stage with another `method` is replaced whole.

    Raises:
        FileNotFoundError: if `name` is a path without a file.
        ValueError: if there is no such preset, stage, method or setting; the message names those
            that there are.
    """
    return _preset(_merged(_table(_find(name)), overrides or {}))


def _find(name: str | Path) -> Path:
    """Return the file of a preset."""
    shipped = PRESETS / f"{name}.toml"
    if shipped.exists():
        return shipped
    if Path(name).is_file():
        return Path(name)
    raise ValueError(
        f"unknown preset {str(name)!r}; there are {', '.join(preset_names())}, "
        "or give the path of a TOML file"
    )


def parse_override(text: str) -> Table:
    """Turn `stage.setting=value` into a nested table; the value is written as in TOML.

    Raises:
        ValueError: if the text is not of that form.
    """
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise ValueError(f"expected SETTING=VALUE such as aggregation.radius_px=7, got {text!r}")
    try:
        parsed = tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        parsed = value.strip()  # a bare word: method=census
    for part in reversed(key.strip().split(".")):
        parsed = {part: parsed}
    return dict(parsed)


def overrides_from(file: Path | None, texts: Sequence[str]) -> Table:
    """Return the settings of a TOML file with `stage.setting=value` texts laid over them."""
    overrides = _table(file) if file is not None else {}
    for text in texts:
        overrides = _merged(overrides, parse_override(text))
    return overrides


def _table(path: Path) -> Table:
    """Read a TOML file."""
    if path.is_dir():
        raise ValueError(f"{path} is a folder; give a TOML file with settings")
    if not path.exists():
        raise FileNotFoundError(f"there is no settings file {path}")
    try:
        table: Table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not a TOML file: {error}") from error
    return table


def _merged(base: Table, changes: Mapping[str, Any]) -> Table:
    """Return `base` with `changes` laid over it; another method starts from its own defaults."""
    result = deepcopy(base)
    for key, value in changes.items():
        old, new = result.get(key), value
        if key in STAGES and key != "refinements":
            old, new = _as_table(old), _as_table(new)
        if isinstance(new, Mapping) and isinstance(old, list):
            result[key] = _merged_list(key, old, new)
        elif isinstance(new, Mapping) and isinstance(old, dict):
            other = {"method"} <= new.keys() & old.keys() and new["method"] != old["method"]
            result[key] = dict(new) if other else _merged(old, new)
        else:
            result[key] = new
    return result


def _as_table(value: Any) -> Any:  # noqa: ANN401
    """Return the table that a bare name of a method stands for; anything else as it is."""
    return {"method": value} if isinstance(value, str) else value


def _merged_list(key: str, old: list[Table], changes: Mapping[str, Any]) -> list[Table]:
    """Return the list with entries replaced that are named by number, as in refinements.0."""
    result = [_as_table(entry) for entry in old]
    for number, change in changes.items():
        if number not in map(str, range(len(old))):
            held = ", ".join(f"{key}.{place}" for place in range(len(old))) or "nothing"
            raise ValueError(f"unknown entry {key}.{number}; the list holds {held}")
        place = int(number)
        result[place] = _merged({"entry": result[place]}, {"entry": change})["entry"]
    return result


def _preset(table: Table) -> Preset:
    """Build a preset from its table."""
    table = dict(table)
    description = str(table.pop("description", ""))
    triangulation = _build(Triangulation, table.pop("triangulation", {}), "triangulation")
    meshing = _build(Meshing, table.pop("meshing", {}), "meshing")
    cloud = _build(CloudFilters, table.pop("cloud", {}), "cloud")
    noise = _noise(table.pop("disparity_noise", False))
    known = [entry.name for entry in fields(Matcher)]
    for name in table:
        if name not in known:
            others = ", ".join([*known, *AFTER_MATCHING, "description"])
            raise ValueError(f"unknown stage or setting {name!r}; a preset has {others}")
    matcher = _build(Matcher, {name: _stage(name, value) for name, value in table.items()}, "")
    if matcher.confidence is not None:  # otherwise it is a margin, of which the noise says nothing
        triangulation = replace(triangulation, noise=noise)
    meshing = replace(meshing, points=triangulation)
    return Preset(matcher, triangulation, meshing, cloud, description)


def _noise(table: Any) -> DisparityNoise | None:  # noqa: ANN401  whatever the file holds
    """Build what confidences say of errors; None if the file says false, or nothing."""
    return _build(DisparityNoise, table, "disparity_noise") if table is not False else None


def _stage(name: str, value: Any) -> Any:  # noqa: ANN401  whatever the file holds
    """Build one entry of the matcher from what the file says."""
    if name == "refinements":
        if not isinstance(value, list | tuple):
            raise ValueError(f"refinements must be a list such as ['median'], got {value!r}")
        return tuple(_method(name, entry) for entry in value)
    if name in OPTIONS and isinstance(value, bool):
        return _build(OPTIONS[name], {}, name) if value else None
    named = isinstance(value, str) or (isinstance(value, Mapping) and "method" in value)
    if name in STAGES and (named or name not in OPTIONS):
        return _method(name, value)
    if name in OPTIONS:
        return _build(OPTIONS[name], value, name)
    return value


def _method(stage: str, table: Any) -> Any:  # noqa: ANN401
    """Build the method that a table names."""
    methods = STAGES[stage]
    table = dict(table) if isinstance(table, Mapping) else {"method": table}
    if "method" not in table:
        raise ValueError(f"{stage} lacks its method; there are {', '.join(methods)}")
    name = table.pop("method")
    if not isinstance(name, str) or name not in methods:
        raise ValueError(f"unknown method {name!r} for {stage}; there are {', '.join(methods)}")
    return _build(methods[name], table, f"{stage} {name}")


def _build(kind: type, table: Any, where: str) -> Any:  # noqa: ANN401
    """Build a dataclass from a table, with every mistake named."""
    if not isinstance(table, Mapping):
        raise ValueError(  # noqa: TRY004  a mistake in a file, not in the program
            f"{where} must be a table of settings, got {table!r}"
        )
    known = [entry.name for entry in fields(kind) if entry.name not in HANDED_ON]
    for name in table:
        if name not in known:
            raise ValueError(
                f"unknown setting {name!r} in {where}; it has {', '.join(known) or 'no settings'}"
            )
    needed = [f.name for f in fields(kind) if f.default is f.default_factory is MISSING]
    missing = [name for name in needed if name not in table]
    if missing:
        raise ValueError(f"{where or 'the preset'} lacks {', '.join(missing)}")
    values = {}
    for name, value in table.items():
        try:
            values[name] = _checked(kind, name, value)
        except ValidationError as error:
            problem = error.errors()[0]["msg"]
            raise ValueError(f"{where} {name}: {problem}, got {value!r}".lstrip()) from error
    try:
        return kind(**values)
    except ValueError as error:
        raise ValueError(f"{where}: {error}" if where else str(error)) from error


def _checked(kind: type, name: str, value: Any) -> Any:  # noqa: ANN401
    """Return the value as the type of the field, or raise ValidationError."""
    if is_dataclass(value) or name in STAGES or value is None:
        return value
    value = tuple(value) if isinstance(value, list) else value  # TOML has no tuples
    return TypeAdapter(get_type_hints(kind)[name]).validate_python(value, strict=True)


def spelled_out(preset: Preset) -> Table:
    """Return a preset as the tables of a TOML file, with every setting that is not None.

    `load_preset` makes the same preset of a file that holds them.
    """
    table: Table = {"description": preset.description}
    for entry in fields(Matcher):
        value = getattr(preset.matcher, entry.name)
        if isinstance(value, tuple):
            table[entry.name] = [_spelled_method(entry.name, item) for item in value]
        elif entry.name in OPTIONS and value is None:
            table[entry.name] = False
        elif entry.name in STAGES:
            table[entry.name] = _spelled_method(entry.name, value)
        elif entry.name in OPTIONS:
            table[entry.name] = _spelled(value)
        else:
            table[entry.name] = value
    noise = preset.triangulation.noise
    table["disparity_noise"] = _spelled(noise) if noise is not None else False
    table["triangulation"] = _spelled(preset.triangulation)
    table["cloud"] = _spelled(preset.cloud)
    table["meshing"] = _spelled(preset.meshing)
    return table


def _spelled(value: Any) -> Table:  # noqa: ANN401
    """Return the settings of a dataclass as TOML knows them: lists for tuples, and no None."""
    settings = {name: setting for name, setting in asdict(value).items() if name not in HANDED_ON}
    return {
        name: list(setting) if isinstance(setting, tuple) else setting
        for name, setting in settings.items()
        if setting is not None
    }


def _spelled_method(stage: str, method: Any) -> Table:  # noqa: ANN401
    """Return one method as a table."""
    name = next(name for name, kind in STAGES[stage].items() if kind is type(method))
    return {"method": name, **_spelled(method)}
