"""From the entries of an evaluation to means, JSON and CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from recon.evaluation.protocols import OFFICIAL_WEIGHTS
from recon.evaluation.runner import Entry

__all__ = ["csv_of", "failures", "mean_figures", "whole_result"]

Figures = dict[str, Any]

COSTS = ("seconds", "seconds_per_mp", "seconds_per_gdisp", "peak_mb")


def whole_result(
    entries: Sequence[Entry],
    methods: Mapping[str, Figures],
    *,
    protocols: Sequence[str],
    versions: Mapping[str, str],
    command: str,
    problems: Sequence[str] = (),
) -> Figures:
    """Return everything that was found, in the form of results.json.

    Args:
        entries: of `recon.evaluation.runner`.
        methods: name -> what else is known of it ("kind", "settings"); it gives the order.
        protocols: that were asked for; scenes that failed stand under them if none succeeded.
        versions: of everything that can change a result.
        command: that was run.
        problems: what could not be evaluated at all.
    """
    keys = _scene_keys(entries)
    labels = _labels_of_datasets(entries, protocols)
    return {
        "methods": {
            name: {
                "protocol": _by_protocol([e for e in entries if e["method"] == name], keys, labels),
                **known,
            }
            for name, known in methods.items()
        },
        "problems": list(problems),
        "versions": dict(versions),
        "command": command,
    }


def _scene_keys(entries: Iterable[Entry]) -> dict[tuple[str, str], str]:
    """Return the name of every scene, with that of its data set where two share one."""
    pairs = sorted({(entry["dataset"], entry["scene"]) for entry in entries})
    names = [scene for _, scene in pairs]
    return {
        (dataset, scene): scene if names.count(scene) == 1 else f"{dataset}/{scene}"
        for dataset, scene in pairs
    }


def _labels_of_datasets(
    entries: Iterable[Entry], protocols: Sequence[str]
) -> dict[str, tuple[str, ...]]:
    """Return the protocols of every data set, such as official@Q where official was asked for."""
    found: dict[str, set[str]] = {}
    for entry in entries:
        found.setdefault(entry["dataset"], set()).update(entry.get("protocols", {}))
    return {dataset: tuple(sorted(labels or protocols)) for dataset, labels in found.items()}


def _by_protocol(
    entries: Sequence[Entry],
    keys: Mapping[tuple[str, str], str],
    labels: Mapping[str, tuple[str, ...]],
) -> Figures:
    """Return protocol -> means and scenes of one method; failed scenes stand in all of theirs."""
    ordered = sorted(entries, key=lambda entry: (entry["dataset"], entry["scene"]))
    result: Figures = {}
    for label in sorted({label for entry in entries for label in labels[entry["dataset"]]}):
        members = [entry for entry in ordered if label in labels[entry["dataset"]]]
        scenes = {
            keys[entry["dataset"], entry["scene"]]: _of_scene(entry, label) for entry in members
        }
        weights = {
            keys[entry["dataset"], entry["scene"]]: OFFICIAL_WEIGHTS[entry["scene"]]
            for entry in members
            if label.startswith("official") and entry["scene"] in OFFICIAL_WEIGHTS
        }
        result[label] = _one_protocol(scenes, weights)
    return result


def _of_scene(entry: Entry, label: str) -> Figures:
    """Return the figures of one scene under one protocol."""
    if "error" in entry:
        return {"dataset": entry["dataset"], "error": entry["error"]}
    width, height = entry["size"]
    first, last = entry["disparities"]
    megapixels = width * height / 1e6
    hypotheses = megapixels * (last - first + 1) / 1000
    seconds = entry["seconds"]
    return {
        "dataset": entry["dataset"],
        **entry["protocols"][label],
        "seconds": seconds,
        "seconds_per_mp": None if seconds is None else seconds / megapixels,
        "seconds_per_gdisp": None if seconds is None else seconds / hypotheses,
        "peak_mb": entry["peak_mb"],
        "size": entry["size"],
        "disparities": entry["disparities"],
        "depth": entry["depth"],
        "cloud": entry["cloud"],
        "coverage": entry["coverage"],
        "reliability": entry["reliability"],
        "scoring_seconds": entry["scoring_seconds"],
    }


def _one_protocol(scenes: Mapping[str, Figures], weights: Mapping[str, float]) -> Figures:
    """Return the means beside the scenes; a scene without a weight counts once."""
    done = {key: figures for key, figures in scenes.items() if "error" not in figures}
    return {
        "mean": mean_figures(list(done.values()), [weights.get(key, 1.0) for key in done]),
        "plain_mean": mean_figures(list(done.values()), [1.0] * len(done)),
        "scenes_counted": len(done),
        "scenes_failed": len(scenes) - len(done),
        "scenes": dict(scenes),
    }


def mean_figures(scenes: Sequence[Figures], weights: Sequence[float]) -> Figures:
    """Return the weighted mean of every figure; scenes that lack one do not count in it.

    Args:
        scenes: figures of each, nested; lists, texts and what is None are passed over.
        weights: one a scene.

    Returns:
        The same nesting; "pixels" is the sum and "peak_mb" the maximum instead.
    """
    merged: Figures = {}
    for key in dict.fromkeys(key for figures in scenes for key in figures):
        held = [
            (figures[key], weight)
            for figures, weight in zip(scenes, weights, strict=True)
            if figures.get(key) is not None
        ]
        if held and all(isinstance(value, Mapping) for value, _ in held):
            inner = mean_figures([value for value, _ in held], [weight for _, weight in held])
            if inner:
                merged[key] = inner
        elif held and all(isinstance(value, int | float) for value, _ in held):
            merged[key] = _combined(key, held)
    return merged


def _combined(key: str, held: Sequence[tuple[float, float]]) -> float:
    values = [value for value, _ in held]
    if key == "pixels":
        return sum(values)
    if key == "peak_mb":
        return max(values)
    return float(np.average(values, weights=[weight for _, weight in held]))


def failures(entries: Iterable[Entry]) -> list[str]:
    """Return one sentence for every scene that a method failed on."""
    return [
        f"{entry['method']} on {entry['dataset']}/{entry['scene']}: {entry['error']}"
        for entry in entries
        if "error" in entry
    ]


def csv_of(results: Figures) -> str:
    """Return a table with one row for every method, protocol, scene (or mean) and region."""
    rows = []
    for method, of_method in results["methods"].items():
        for protocol, found in of_method["protocol"].items():
            parts = {"(weighted mean)": found["mean"], "(plain mean)": found["plain_mean"]}
            for scene, figures in {**parts, **found["scenes"]}.items():
                rows += [
                    {"method": method, "protocol": protocol, "scene": scene, **row}
                    for row in _rows_of(figures)
                ]
    columns = dict.fromkeys(key for row in rows for key in row)
    text = io.StringIO()
    writer = csv.DictWriter(text, list(columns), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _rows_of(figures: Figures) -> list[Figures]:
    """Return one row for every region, with the costs and the depths of the scene."""
    if "error" in figures:
        return [{"dataset": figures["dataset"], "region": "", "error": figures["error"]}]
    shared = {key: figures.get(key) for key in ("dataset", *COSTS)}
    for part in ("depth", "cloud"):
        shared |= dict(_flat(part, figures.get(part) or {}))
    regions = {
        key: value
        for key, value in figures.items()
        if isinstance(value, Mapping) and key not in ("depth", "cloud", "coverage", "reliability")
    }
    return [{"region": region, **measures, **shared} for region, measures in regions.items()]


def _flat(prefix: str, figures: Mapping[str, Any]) -> Iterable[tuple[str, Any]]:
    """Return nested figures under names such as depth.nonocc.median_relative."""
    for key, value in figures.items():
        if isinstance(value, Mapping):
            yield from _flat(f"{prefix}.{key}", value)
        else:
            yield f"{prefix}.{key}", value
