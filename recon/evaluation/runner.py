"""One method on one scene, and all methods on all scenes."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import cv2
import numba
import numpy as np
import torch

from calib.pair import RectifiedPair
from recon.evaluation.layouts import read_scene
from recon.evaluation.memory import forget_peak, peak_mb
from recon.evaluation.methods import Method
from recon.evaluation.metrics import coverage_curve, error_histogram, reliability_curve
from recon.evaluation.protocols import PROTOCOLS, label, protocol_for, score, signed_errors
from recon.evaluation.regions import regions, repeated
from recon.evaluation.report import result_pictures, scene_pictures
from recon.evaluation.scene import Scene, SceneFiles
from recon.evaluation.space import cloud_measures, depth_measures
from recon.evaluation.workers import Failure, run_in_processes
from recon.files import atomic, write_json, write_pfm
from recon.report import versions
from recon.types import Array, DisparityMap, PixelStatus

__all__ = ["SPARSE", "Entry", "Task", "evaluate", "evaluate_one", "pictures_folder", "suffixes"]

Entry = dict[str, Any]
"""What came of one method on one scene; the keys are those of `_measured` or "error"."""

SPARSE = " (sparse)"
"""After the name of a method: only the pixels that it measured, none that it filled."""

ENTRY_FILE = "entry.json"
SCENES = "scenes"
RIGHT_PX = 1
"""What a confidence promises, in pixels of the size that was matched."""
WARM_UP_PX = 96
WARM_UP_CANDIDATES = 16


@dataclass(frozen=True)
class Task:
    """One method on one scene.

    Attributes:
        method: what makes the disparities.
        files: the pair and its truth.
        protocols: names in `PROTOCOLS`.
        out: folder that gets a folder METHOD/DATASET/SCENE.
        sparse: score also the measured pixels alone.
        most_candidates: a range in place of that of the data set, from 0; None leaves it.
    """

    method: Method
    files: SceneFiles
    protocols: tuple[str, ...]
    out: Path
    sparse: bool = False
    most_candidates: int | None = None

    def folder(self, suffix: str = "") -> Path:
        """Return where the results of this task lie."""
        return pictures_folder(
            self.out, self.method.name + suffix, self.files.dataset, self.files.name
        )

    def fingerprint(self) -> str:
        """Return a text that differs if anything that is known to matter does."""
        stamps = [
            [str(path), path.stat().st_size, path.stat().st_mtime_ns]
            for path in _inputs(self.files)
        ]
        parts = [
            dict(self.method.settings()),
            self.protocols,
            self.most_candidates,
            stamps,
            _versions(),
        ]
        text = json.dumps(parts, sort_keys=True, default=str)
        return hashlib.sha256(text.encode("utf-8")).hexdigest()


def _inputs(files: SceneFiles) -> list[Path]:
    """Return the files that a scene may be read from.

    Those in its folders, and in folders inside these such as KITTI's image_2 those that share
    its name or a part of it.
    """
    folders = {files.folder, files.truth_folder}
    beside = (path for folder in folders for path in folder.iterdir())
    within = (
        path
        for folder in folders
        for path in folder.glob("*/*")
        if path.stem in files.name or files.name in path.stem
    )
    return sorted(path for path in {*beside, *within} if path.is_file())


@cache
def _versions() -> dict[str, str]:
    return versions()


def pictures_folder(out: Path, method: str | None, dataset: str, scene: str) -> Path:
    """Return the folder of what one method did on one scene; None asks for the scene's own."""
    return out / (SCENES if method is None else _file_name(method)) / dataset / _file_name(scene)


def _file_name(name: str) -> str:
    """Return a name that can be that of a folder."""
    return "".join("_" if letter in '/\\:*?"<>|' else letter for letter in name)


def evaluate(
    tasks: Sequence[Task], *, jobs: int = 1, resume: bool = False
) -> Iterator[list[Entry]]:
    """Run tasks in processes of their own and yield what came of each as it ends.

    Args:
        tasks: tasks of one scene should follow each other: a scene is read once.
        jobs: processes at once; the cores are shared between them, so times of several jobs say
            little.
        resume: take what an earlier run with the same settings and files left, if it succeeded.

    Yields:
        The entries of a task: one, or with `sparse` two.
    """
    open_tasks = []
    for task in tasks:
        earlier = _earlier(task) if resume else None
        if earlier is None:
            open_tasks.append(task)
        else:
            yield earlier
    for task, result in run_in_processes(evaluate_one, open_tasks, jobs=jobs, prepare=_prepare):
        yield [_failed(task, result)] if isinstance(result, Failure) else result


def _earlier(task: Task) -> list[Entry] | None:
    """Return the entries of an earlier run, None if it lacks them or anything has changed."""
    entries = []
    fingerprint = task.fingerprint()
    for suffix in suffixes(sparse=task.sparse):
        try:
            text = (task.folder(suffix) / ENTRY_FILE).read_text(encoding="utf-8")
            entry = json.loads(text)
        except (OSError, ValueError):
            return None
        if entry.pop("fingerprint", None) != fingerprint:
            return None
        entries.append(entry)
    return entries


def _prepare(jobs: int) -> None:
    """Share the cores between the processes."""
    threads = max(1, (os.cpu_count() or 1) // jobs)
    torch.set_num_threads(threads)
    cv2.setNumThreads(threads)
    numba.set_num_threads(min(threads, numba.get_num_threads()))


def _failed(task: Task, failure: Failure) -> Entry:
    """Return the entry of a task without a result."""
    entry = {**_names(task), "error": failure.reason}
    return {**entry, "traceback": failure.details} if failure.details else entry


def _names(task: Task, suffix: str = "") -> Entry:
    return {
        "method": task.method.name + suffix,
        "dataset": task.files.dataset,
        "scene": task.files.name,
    }


def suffixes(*, sparse: bool) -> tuple[str, ...]:
    """Return what stands after the name of a method in each of its rows."""
    return ("", SPARSE) if sparse else ("",)


def evaluate_one(task: Task) -> list[Entry]:
    """Run a method on a scene, score it and leave map, pictures and figures on disk.

    Raises:
        ValueError: if the scene cannot be read or the map cannot be scored.
    """
    scene, masks = _scene_of(task.files, task.most_candidates, task.out)
    if task.method.measured:
        _warm_up(task.method, scene)
    forget_peak()
    started = time.perf_counter()
    disparity = task.method(scene)
    matched = time.perf_counter()
    cost: Entry = {"seconds": None, "peak_mb": None}
    if task.method.measured:
        cost = {"seconds": matched - started, "peak_mb": peak_mb()}

    entries = []
    for suffix in suffixes(sparse=task.sparse):
        scored = time.perf_counter()
        found = _measured_alone(disparity) if suffix else disparity
        entry = {**_names(task, suffix), **_measured(task, scene, masks, found), **cost}
        _write_all(task.folder(suffix), result_pictures(found.values, scene))
        write_pfm(task.folder(suffix) / "disparity.pfm", found.values)
        entry["scoring_seconds"] = time.perf_counter() - scored
        folder = task.folder(suffix)
        write_json(folder / ENTRY_FILE, {**entry, "fingerprint": task.fingerprint()})
        entries.append(entry)
    return entries


@lru_cache(maxsize=1)
def _scene_of(
    files: SceneFiles, most_candidates: int | None, out: Path
) -> tuple[Scene, dict[str, Array]]:
    """Read a scene and leave its pictures, once for all methods that follow each other."""
    scene = read_scene(files)
    _write_all(pictures_folder(out, None, files.dataset, files.name), scene_pictures(scene))
    if most_candidates is not None:
        scene = replace(scene, disparities=range(most_candidates))
    return scene, regions(scene)


_warm: set[str] = set()


def _warm_up(method: Method, scene: Scene) -> None:
    """Let a method load weights and compiled loops before it is timed."""
    if method.name in _warm:
        return
    _warm.add(method.name)
    height, width = (min(extent, WARM_UP_PX) for extent in scene.pair.left.shape[:2])
    pair = scene.pair
    corner = RectifiedPair(
        np.ascontiguousarray(pair.left[:height, :width]),
        np.ascontiguousarray(pair.right[:height, :width]),
        pair.geometry.cropped((0, 0), (width, height)),
    )
    with suppress(ValueError):  # if it cannot match so little it will say so of the whole pair
        method(replace(scene, pair=corner, disparities=range(WARM_UP_CANDIDATES)))


def _measured_alone(disparity: DisparityMap[Array]) -> DisparityMap[Array]:
    """Return the map without what was filled in."""
    kept = disparity.status == int(PixelStatus.MATCHED)
    status = np.where(disparity.valid & ~kept, int(PixelStatus.MISMATCHED), disparity.status)
    return DisparityMap(
        np.where(kept, disparity.values, np.float32(np.nan)),
        status.astype(np.uint8),
        np.where(kept, disparity.confidence, np.float32(0)),
    )


def _measured(
    task: Task, scene: Scene, masks: dict[str, Array], disparity: DisparityMap[Array]
) -> Entry:
    """Return all figures of one map."""
    width, height = scene.pair.geometry.size
    protocols = [protocol_for(name, scene) for name in task.protocols]
    own = protocol_for("official", scene)
    signed = signed_errors(disparity.values, scene, own)
    counted = masks.get("nonocc", masks["all"])
    return {
        "size": [width, height],
        "disparities": [scene.disparities[0], scene.disparities[-1]],
        "protocols": {
            label(protocol, scene): score(disparity.values, scene, protocol, masks)
            for protocol in protocols
        },
        "depth": depth_measures(disparity.values, scene, masks),
        "cloud": cloud_measures(disparity, scene, masks),
        "coverage": coverage_curve(
            np.abs(signed), repeated(disparity.confidence, signed.shape), counted
        )
        if task.method.confident
        else None,
        "reliability": _reliability(scene, disparity, counted) if task.method.confident else None,
        "histogram": error_histogram(signed, counted),
    }


def _reliability(
    scene: Scene, disparity: DisparityMap[Array], counted: Array
) -> dict[str, list[float]]:
    """Return how often each confidence is within 1 px, of the size that was matched."""
    error = np.abs(signed_errors(disparity.values, scene, PROTOCOLS["own-size"]))
    found = counted & ~np.isnan(error)
    close = error * disparity.values.shape[0] <= RIGHT_PX * error.shape[0]
    return reliability_curve(close, repeated(disparity.confidence, error.shape), found)


def _write_all(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files into a folder that is made if need be."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, contents in files.items():
        with atomic(folder / name) as partial:
            partial.write_bytes(contents)
