"""What a whole result holds, found in the nesting of results.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from recon.evaluation.report.numbers import finite

__all__ = [
    "Failure",
    "SceneName",
    "failures",
    "figure_of",
    "main_protocol",
    "of_protocol",
    "protocol_labels",
    "region_of",
    "scene_figures",
    "scene_names",
]

Results = Mapping[str, Any]


@dataclass(frozen=True)
class SceneName:
    """Which scene of which data set.

    Attributes:
        key: under which results.json lists it.
        dataset: that it is of, "" if not said.
        name: within the data set.
    """

    key: str
    dataset: str
    name: str


@dataclass(frozen=True)
class Failure:
    """One method without a result on one scene, and why."""

    method: str
    scene: SceneName
    reason: str


def protocol_labels(results: Results) -> tuple[str, ...]:
    """Return the labels of all protocols, those of official rules first."""
    labels = dict.fromkeys(
        label for of_method in results["methods"].values() for label in of_method["protocol"]
    )
    return tuple(sorted(labels, key=lambda label: label.startswith("zs-")))


def of_protocol(results: Results, method: str, label: str) -> Results:
    """Return what a method reached under a protocol, empty if nothing."""
    found: Results = results["methods"][method]["protocol"].get(label, {})
    return found


def scene_names(results: Results, label: str | None = None) -> tuple[SceneName, ...]:
    """Return the scenes in order of their first mention.

    Args:
        results: the whole result.
        label: of the protocol whose scenes are meant; None for all.
    """
    labels = protocol_labels(results) if label is None else (label,)
    names: dict[str, SceneName] = {}
    for each in labels:
        for method in results["methods"]:
            for key, figures in of_protocol(results, method, each).get("scenes", {}).items():
                names.setdefault(key, _scene_name(key, figures))
    return tuple(names.values())


def _scene_name(key: str, figures: Results) -> SceneName:
    """Return the parts of a key, which begins with the data set where two sets share a name."""
    dataset = figures.get("dataset", "")
    return SceneName(key, dataset, key.removeprefix(f"{dataset}/") if dataset else key)


def scene_figures(results: Results, method: str, label: str, key: str) -> Results | None:
    """Return the figures of a scene, None if it was not tried."""
    found: Results | None = of_protocol(results, method, label).get("scenes", {}).get(key)
    return found


def main_protocol(results: Results, key: str) -> str | None:
    """Return the first protocol under which a scene was scored or failed."""
    for label in protocol_labels(results):
        if any(scene_figures(results, method, label, key) for method in results["methods"]):
            return label
    return None


def failures(results: Results) -> tuple[Failure, ...]:
    """Return every failure once, though it stands under every protocol."""
    found: dict[tuple[str, str], Failure] = {}
    for label in protocol_labels(results):
        for scene in scene_names(results, label):
            for method in results["methods"]:
                figures = scene_figures(results, method, label, scene.key)
                if figures and "error" in figures:
                    failure = Failure(method, scene, str(figures["error"]))
                    found.setdefault((method, scene.key), failure)
    return tuple(found.values())


def figure_of(figures: Results | None, path: str, measure: str) -> float | None:
    """Return one figure of a scene or of a mean.

    Args:
        figures: of a scene, or a mean; None holds nothing.
        path: names of what it lies in, such as nonocc or depth.all; "" for the figures themselves.
        measure: its own name.

    Returns:
        None if there is no such number.
    """
    inside: object = figures
    for name in path.split(".") if path else ():
        inside = inside.get(name) if isinstance(inside, Mapping) else None
    return finite(inside.get(measure)) if isinstance(inside, Mapping) else None


def region_of(figures: Results | None) -> str:
    """Return nonocc where that is known, else all."""
    return "nonocc" if figure_of(figures, "nonocc", "pixels") else "all"
