"""`reconstruct pair` and `demo`: one pair, all results."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional, UseAppendAction, arg

from recon.cli.look import keep_serving, say_where
from recon.cli.rectify import said
from recon.cli.terminal import (
    QUIET,
    Device,
    Out,
    Overrides,
    Progress,
    Unit,
    console,
    device_named,
    preset_with,
    warn,
)

if TYPE_CHECKING:
    from calib.pair import RectifiedPair, StereoPair
    from recon.pairs import PairOnDisk, RangeRequest
    from recon.settings import Preset

    Wanted = Callable[[StereoPair | RectifiedPair, range | None, str], Preset]

__all__ = ["demo", "pair"]

CloudFormat = Literal["npz", "las", "laz"]
Recording = Literal["save", "serve", "spawn", "none"]
Probes = Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="X,Y")]


@dataclass(frozen=True)
class Means:
    """What a run works with, beside the pair and the preset.

    Attributes:
        device: where to compute.
        recording: what becomes of the recording.
        probes: pixels whose costs are recorded, beside those that are chosen.
        port: of the page, if the recording is served.
        refine: whether to refine the rectification.
        ignore: whether to go on if the rectification is meaningless.
        clouds: formats to write the cloud in, beside PLY.
    """

    device: str
    recording: Recording
    probes: tuple[tuple[int, int], ...] = ()
    port: int | None = None
    refine: bool = False
    ignore: bool = False
    clouds: tuple[CloudFormat, ...] = ()


def pair(  # noqa: PLR0913  every one is an option of the command
    left: Positional[Path],
    right: Positional[Path | None] = None,
    /,
    *,
    calib: Path | None = None,
    out: Out,
    preset: str = "paper",
    rectified: bool = False,
    raw: bool = False,
    unit: Unit | None = None,
    uncalibrated: bool = False,
    focal_px: float | None = None,
    refine_rectification: bool = False,
    ignore_rectification: bool = False,
    min_disparity: int | None = None,
    max_disparity: int | None = None,
    min_confidence: float | None = None,
    scale: float = 1.0,
    device: Device = "auto",
    recording: Recording = "save",
    probe: Probes = (),
    port: int | None = None,
    cloud_format: tuple[CloudFormat, ...] = (),
    settings: Path | None = None,
    override: Overrides = (),
) -> None:
    """Reconstruct one pair of photographs.

    Args:
        left: picture of the left camera.
        right: picture of the right camera; left out if the first shows both side by side.
        calib: calibration: Middlebury, KITTI, K.txt, OpenCV YAML or XML, ROS camera_info (either
            file), Kalibr camchain, COLMAP cameras.txt or rig_config.json, or our JSON.
        out: folder for the results.
        preset: name of a preset (see `reconstruct presets`), path of a TOML file, or auto: the
            most accurate one that this machine can run within a minute.
        rectified: the rows of the pictures agree already.
        raw: the pictures are to be undistorted and rectified.
        unit: of the lengths in the calibration, where it does not say.
        uncalibrated: estimate the cameras from the pictures, without --calib; shapes come out up
            to scale, not in metres.
        focal_px: focal length in pixels of the given pictures, with --uncalibrated, where you know
            it; otherwise taken from the EXIF note, the matches or a guess.
        refine_rectification: turn the cameras a little so that the rows of the views agree better,
            if they do so significantly.
        ignore_rectification: go on even if the rows of the views are so far from agreeing, or left
            and right so surely swapped, that matching is meaningless.
        min_disparity: smallest x_left - x_right to search, pixels of the given pictures.
        max_disparity: largest one; both are estimated where neither you nor the calibration says.
        min_confidence: leave out of cloud and mesh what is less likely to be right than this, in
            [0, 1]; that of the preset if not given.
        scale: resize the pair first; 0.5 is four times faster or more, and coarser.
        device: where to compute.
        recording: write a Rerun recording, serve it to a browser or show it in a window too, or
            neither.
        probe: column and row of a pixel of the rectified left picture, as 312,208, whose matching
            costs the recording shows beside those of pixels it chooses; may be given again.
        port: of the page with --recording serve; its data take the next one.
        cloud_format: write the cloud in these formats too, beside cloud.ply: npz (NumPy), las or
            laz (surveyors' programs; z is up there).
        settings: TOML file with settings that replace those of the preset.
        override: one setting such as aggregation.radius_px=7 or matching_cost.method=census;
            may be given again and again.
    """
    from recon.pairs import RangeRequest

    if rectified and raw:
        raise ValueError("say --rectified or --raw, not both")
    stated = True if rectified else False if raw else None
    if uncalibrated:
        if any(said is not None for said in (calib, stated, unit)):
            raise ValueError("--uncalibrated goes without --calib, --rectified, --raw and --unit")
    elif calib is None:
        raise ValueError(
            "give the calibration with --calib, or say --uncalibrated to estimate the cameras from "
            "the pictures; the result is then not in metres"
        )
    if focal_px is not None and not uncalibrated:
        raise ValueError("--focal-px is for --uncalibrated; a calibration has its own")
    if probe and recording == "none":
        raise ValueError("--probe is for the recording, but --recording none makes none")
    if port is not None and recording != "serve":
        raise ValueError("--port is of the page that --recording serve shows; say that too")
    _run(
        lambda: _read((left, right), calib, stated, scale, unit, focal_px),
        out,
        _preset_for(preset, settings, (*override, *_at_least(min_confidence))),
        RangeRequest(min_disparity, max_disparity, scale),
        Means(
            device_named(device),
            recording,
            tuple(_pixel(text) for text in probe),
            port,
            refine_rectification,
            ignore_rectification,
            cloud_format,
        ),
    )


def demo(
    *,
    out: Out = Path("out/demo"),
    preset: str = "paper",
    device: Device = "auto",
    recording: Recording = "save",
) -> None:
    """Reconstruct the pair that comes with the program.

    Args:
        out: folder for the results.
        preset: name of a preset or path of a TOML file.
        device: where to compute.
        recording: write a Rerun recording, show it in a browser or a window too, or neither.
    """
    from recon.sample_pairs import sample_folder

    folder = sample_folder() / "workshop"
    pair(
        folder / "left.png",
        folder / "right.png",
        calib=folder / "rig.json",
        out=out,
        preset=preset,
        device=device,
        recording=recording,
    )


def _preset_for(name: str, settings: Path | None, overrides: tuple[str, ...]) -> Wanted:
    """Return what gives the preset for a pair, and says which it is if nobody did.

    Anything but auto is looked up at once, so that a mistake is said before anything is read.
    """
    from recon.choice import AUTO, choose_preset

    if name != AUTO:
        preset = preset_with(name, settings, overrides)
        return lambda *_: preset

    def chosen(pair: StereoPair | RectifiedPair, disparities: range | None, device: str) -> Preset:
        height, width = pair.left.shape[:2]
        choice = choose_preset((width, height), disparities, device=device)
        console.print(f"preset {choice.reason}", soft_wrap=True)
        return preset_with(choice.preset, settings, overrides)

    return chosen


def _at_least(min_confidence: float | None) -> tuple[str, ...]:
    """Return the override that --min-confidence stands for."""
    return () if min_confidence is None else (f"triangulation.min_confidence={min_confidence}",)


def _pixel(text: str) -> tuple[int, int]:
    """Return the column and row that --probe names."""
    column, _, row = text.partition(",")
    try:
        return int(column), int(row)
    except ValueError as error:
        raise ValueError(f"--probe {text}: expected a column and a row such as 312,208") from error


def _read(
    pictures: tuple[Path, Path | None],
    calib: Path | None,
    rectified: bool | None,
    scale: float,
    unit: Unit | None,
    focal_px: float | None,
) -> PairOnDisk:
    from recon.pairs import read_pair, read_uncalibrated_pair

    if calib is None:
        return read_uncalibrated_pair(*pictures, scale=scale, focal_px=focal_px)
    return read_pair(*pictures, calib, rectified=rectified, scale=scale, unit=unit)


def _recorder(means: Means, folder: Path) -> contextlib.AbstractContextManager[Any]:
    """Return the observer that draws, or one that does not."""
    from recon.observer import ignore

    if means.recording == "none":
        return contextlib.nullcontext(ignore)
    from recon.viewer import RerunObserver

    shows: dict[str, Any] = {"save": "nothing", "serve": "browser", "spawn": "window"}
    return RerunObserver(
        save=folder / "recording.rrd",
        show=shows[means.recording],
        probes=means.probes,
        port=means.port,
    )


def _run(
    read: Callable[[], PairOnDisk],
    out: Path,
    preset_for: Wanted,
    limits: RangeRequest,
    means: Means,
) -> None:
    """Read, check, reconstruct, write: all or nothing."""
    from calib.pair import StereoPair
    from recon.files import write_json
    from recon.observer import all_of
    from recon.output import all_or_nothing, write_results
    from recon.pipeline import reconstruct
    from recon.rectification import rectification_report, rectify_and_check
    from recon.report import UNITS_WITHOUT_CALIBRATION, run_report
    from recon.timing import Stopwatch, compilation_watched

    device = means.device
    with (
        all_or_nothing(out) as folder,
        Progress() as progress,
        _recorder(means, folder) as recorder,
        compilation_watched() as compiled_for,
    ):
        if means.recording == "serve":
            say_where(recorder.page)
        watch = Stopwatch(all_of(progress, recorder))
        source = read()
        for note in source.notes:
            console.print(f"note: {note}", soft_wrap=True)
        if not source.metric:
            warn(UNITS_WITHOUT_CALIBRATION)
        disparities = limits.applied_to(source.disparities)
        watch("input/files", source.inputs)
        if isinstance(source.pair, StereoPair):
            watch("input/raw", source.pair)
        checked = rectify_and_check(source.pair, refine=means.refine)
        watch("rectification", rectification_report(said(checked, ignore=means.ignore)))
        preset = preset_for(checked.pair, disparities, device)
        result = reconstruct(
            checked.pair, preset, disparities=disparities, device=device, observe=watch
        )
        write_results(folder, result, clouds=means.clouds)
        watch("write", sorted(path.name for path in folder.iterdir()))
        report = {
            **run_report(
                result, preset, device=device, seconds=watch.seconds, metric=source.metric
            ),
            "rectification": rectification_report(checked),
            "seconds of first compilation": round(compiled_for(), 4),
            "disparity range from": limits.origin(source.disparities),
            "inputs": source.inputs,
        }
        watch("run", report)
        write_json(folder / "run.json", report)
    _say_what_was_made(report, out)
    if means.recording == "serve":
        keep_serving(recorder.page)


def _say_what_was_made(report: dict[str, Any], out: Path) -> None:
    """Print whether the units can be right, the size of the result and where it lies."""
    from recon.report import UNITS

    if report["units"] != UNITS:
        warn(report["units"])
    console.print(report["metric sanity"], soft_wrap=True)
    if (compiled := report["seconds of first compilation"]) > QUIET:
        console.print(f"{compiled:.1f} s of this went into compiling, once; later runs are faster")
    taken = [
        f"{one['filter']} {one['removed']:,} ({one['percent']:.1f} %)"
        for one in report["removed from the cloud"]
        if one["removed"]
    ]
    if taken:
        console.print(f"left out of the cloud: {', '.join(taken)}", soft_wrap=True)
    console.print(
        f"{report['points']:,} points and {report['triangles']:,} triangles; results lie in {out}",
        soft_wrap=True,
    )
