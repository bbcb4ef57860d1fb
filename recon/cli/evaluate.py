"""`reconstruct evaluate`: how far matchers are from the truth."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from tyro.conf import Positional, UseAppendAction, arg

from recon.cli.means import print_means
from recon.cli.terminal import Device, Out, Overrides, console, device_named, errors, preset_with

if TYPE_CHECKING:
    from recon.evaluation import Entry, Method, SceneFiles, Task

__all__ = ["evaluate"]

Names = Annotated[str, arg(metavar="NAME,...")]
Repeated = UseAppendAction[tuple[str, ...]]


def evaluate(  # noqa: PLR0913  every one is an option of the command
    datasets: Positional[tuple[Path, ...]],
    /,
    *,
    preset: Names = "",
    baseline: Names = "",
    disparities: Annotated[Repeated, arg(metavar="NAME=DIR")] = (),
    variant: Annotated[Repeated, arg(metavar="'NAME=PRESET [SETTING=VALUE ...]'")] = (),
    protocol: Names = "official",
    scenes: Names = "",
    truth: Path | None = None,
    max_disparity: int | None = None,
    sparse: bool = False,
    device: Device = "auto",
    out: Out = Path("out/evaluation"),
    json: Path | None = None,
    html: Path | None = None,
    csv: Path | None = None,
    jobs: int = 1,
    resume: bool = False,
    override: Overrides = (),
) -> None:
    """Compare matchers on pairs with truth.

    Writes results.json, results.csv and report.html into the folder of -o, and every disparity
    map as PFM. A scene that fails is a row that says why; the exit status is 1 then.

    Args:
        datasets: folders of pairs with truth: Middlebury (all years), KITTI 2012 and 2015, ETH3D,
            SceneFlow, generated scenes; one scene, a data set or a folder of data sets.
        preset: presets, with commas between them; paper if nothing else is named either.
        baseline: matchers of OpenCV: opencv-bm, opencv-sgbm, opencv-sgbm-3way, opencv-sgbm-rows.
        disparities: maps of another program, DIR/SCENE.pfm, .png (16 bits, pixels times 256) or
            .npy; may be given again.
        variant: a preset with other settings, as a row of its own; may be given again, as for an
            ablation: --variant 'no filter=paper refinements=[]'; no spaces within a setting.
        protocol: official, zs-all, zs-noc, zs-noc192; see the notes in the report.
        scenes: only these.
        truth: folder with truth of the same scenes at 2 or 4 times the size.
        max_disparity: range in place of that of the data sets, from 0, pixels.
        sparse: also score the pixels that a method measured, without those that it filled.
        device: where presets compute.
        out: folder for the results.
        json: where to write the figures; results.json in the folder of -o if not given.
        html: where to write the report, likewise.
        csv: where to write the table, likewise.
        jobs: processes at once; times mean less with more than one.
        resume: keep what an earlier run with the same settings left in the folder.
        override: one setting for all presets, as in `reconstruct pair`.
    """
    from recon.evaluation import Task, failures, whole_result, write_results
    from recon.report import versions

    if jobs < 1:
        raise ValueError(f"--jobs must be at least 1, got {jobs}")
    if max_disparity is not None and max_disparity < 1:
        raise ValueError(f"--max-disparity must be at least 1 px, got {max_disparity}")
    methods = [
        *_presets(_listed(preset), variant, override, device_named(device)),
        *_baselines(_listed(baseline)),
        *_maps(disparities),
    ]
    methods = methods or _presets(["paper"], (), override, device_named(device))
    _refuse_equal_names(methods)
    protocols = _protocols(_listed(protocol))
    found, problems = _find(datasets, truth, _listed(scenes))
    candidates = None if max_disparity is None else max_disparity + 1
    tasks = [
        Task(method, files, protocols, out, sparse, candidates)
        for files in found
        for method in methods
    ]
    for problem in problems:
        errors.print(f"problem: {problem}", soft_wrap=True)
    entries = _run(tasks, jobs, resume)
    result = whole_result(
        entries,
        _known(methods, sparse),
        protocols=protocols,
        versions=versions(),
        command=shlex.join(["reconstruct", *sys.argv[1:]]),
        problems=problems,
    )
    places = {
        "json": json or out / "results.json",
        "csv": csv or out / "results.csv",
        "html": html or out / "report.html",
    }
    write_results(result, entries, out=out, places=places)
    print_means(result)
    console.print(f"see {', '.join(map(str, places.values()))}", soft_wrap=True)
    failed = failures(entries)
    for reason in failed:
        errors.print(f"failed: {reason}", soft_wrap=True)
    if failed or problems:
        total = len(tasks) + len(problems)
        errors.print(f"{len(failed) + len(problems)} of {total} failed", style="bold red")
        sys.exit(1)


def _listed(text: str) -> list[str]:
    """Return the names between commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def _presets(
    names: Sequence[str], variants: Sequence[str], overrides: tuple[str, ...], device: str
) -> list[Method]:
    """Return presets and variants of presets as methods."""
    from recon.evaluation import MatcherOfPreset

    methods: list[Method] = [
        MatcherOfPreset(Path(name).stem, preset_with(name, None, overrides), device)
        for name in names
    ]
    for text in variants:
        name, equals, spelled = text.partition("=")
        words = spelled.split()  # quotes belong to the values, as in TOML
        if not equals or not name.strip() or not words:
            raise ValueError(
                "expected --variant 'NAME=PRESET SETTING=VALUE ...' such as "
                f"'radius 7=paper aggregation.radius_px=7', got {text!r}"
            )
        preset = preset_with(words[0], None, (*overrides, *words[1:]))
        methods.append(MatcherOfPreset(name.strip(), preset, device))
    return methods


def _baselines(names: Iterable[str]) -> list[Method]:
    """Return matchers of OpenCV as methods."""
    from recon.evaluation import OPENCV_MATCHERS, MatcherOfOpenCv

    unknown = [name for name in names if name not in OPENCV_MATCHERS]
    if unknown:
        raise ValueError(f"unknown baseline {unknown[0]!r}; there are {', '.join(OPENCV_MATCHERS)}")
    return [MatcherOfOpenCv(name, OPENCV_MATCHERS[name]) for name in names]


def _maps(texts: Iterable[str]) -> list[Method]:
    """Return folders of maps as methods."""
    from recon.evaluation import MapsOnDisk

    methods: list[Method] = []
    for text in texts:
        name, equals, folder = text.partition("=")
        if not equals or not name or not folder:
            raise ValueError(f"expected --disparities NAME=DIR, got {text!r}")
        methods.append(MapsOnDisk(name, Path(folder)))
    return methods


def _refuse_equal_names(methods: Sequence[Method]) -> None:
    names = [method.name for method in methods]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"two methods are named {twice[0]!r}; every row needs a name of its own")


def _protocols(names: Sequence[str]) -> tuple[str, ...]:
    from recon.evaluation import PROTOCOLS

    unknown = [name for name in names if name not in PROTOCOLS]
    if unknown or not names:
        raise ValueError(
            f"unknown protocol {', '.join(unknown) or '(none)'}; there are {', '.join(PROTOCOLS)}"
        )
    return tuple(names)


def _find(
    datasets: Sequence[Path], truth: Path | None, names: Sequence[str]
) -> tuple[list[SceneFiles], list[str]]:
    """Return the scenes, and what is wrong with folders that hold none."""
    from recon.evaluation import find_scenes

    found: list[SceneFiles] = []
    problems = []
    for dataset in datasets:
        try:
            found += [files for files in find_scenes(dataset, truth=truth) if files not in found]
        except (ValueError, OSError) as error:
            problems.append(str(error))
    if not found:
        raise ValueError("; ".join(problems) or "name at least one folder of pairs with truth")
    _refuse_equal_scenes(found)
    known = sorted({files.name for files in found})
    missing = [name for name in names if name not in known]
    if missing:
        raise ValueError(f"there is no scene {', '.join(missing)}; there are {', '.join(known)}")
    return [files for files in found if not names or files.name in names], problems


def _refuse_equal_scenes(found: Sequence[SceneFiles]) -> None:
    """Raise ValueError if two scenes would be one row and share a folder of results."""
    folders: dict[tuple[str, str], Path] = {}
    for files in found:
        first = folders.setdefault((files.dataset, files.name), files.folder)
        if first != files.folder:
            raise ValueError(
                f"{first} and {files.folder} would both be called {files.dataset}/{files.name}; "
                "evaluate them one after the other, each with an -o of its own"
            )


def _run(tasks: Sequence[Task], jobs: int, resume: bool) -> list[Entry]:
    """Run all tasks with a bar of progress."""
    from recon.evaluation import evaluate as run

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    entries: list[Entry] = []
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        shown = bar.add_task("evaluating", total=len(tasks))
        try:
            for done in run(tasks, jobs=jobs, resume=resume):
                entries += done
                bar.update(shown, advance=1, description=f"{done[0]['scene']}, {done[0]['method']}")
        except KeyboardInterrupt:
            errors.print("stopped; the same command with --resume goes on from here")
            sys.exit(130)
    return entries


def _known(methods: Sequence[Method], sparse: bool) -> dict[str, dict[str, Any]]:
    """Return what is known of every row beside its figures."""
    from recon.evaluation import suffixes

    return {
        method.name + suffix: {"kind": method.kind, "settings": dict(method.settings())}
        for method in methods
        for suffix in suffixes(sparse=sparse)
    }
