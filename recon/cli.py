"""The command line: `reconstruct --help`."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NoReturn

import tyro
from rich.console import Console
from rich.table import Table
from tyro.conf import Positional, UseAppendAction, arg

if TYPE_CHECKING:
    from recon.pairs import PairOnDisk, RangeRequest
    from recon.settings import Preset
    from recon.viewer import RerunObserver

__all__ = ["main"]

console = Console(highlight=False, markup=False)  # brackets in file names are not markup
errors = Console(stderr=True, highlight=False, markup=False)

Device = Literal["auto", "cpu", "cuda"]
Recording = Literal["save", "serve", "spawn", "none"]
Out = Annotated[Path, arg(aliases=["-o"])]
Overrides = Annotated[UseAppendAction[tuple[str, ...]], arg(name="set", metavar="SETTING=VALUE")]
QUIET = 1.0 / 3


def pair(  # noqa: PLR0913  every one is an option of the command
    left: Positional[Path],
    right: Positional[Path | None] = None,
    /,
    *,
    calib: Path,
    out: Out,
    preset: str = "paper",
    rectified: bool = False,
    raw: bool = False,
    min_disparity: int | None = None,
    max_disparity: int | None = None,
    scale: float = 1.0,
    device: Device = "auto",
    recording: Recording = "save",
    settings: Path | None = None,
    override: Overrides = (),
) -> None:
    """Reconstruct one pair of photographs.

    Args:
        left: picture of the left camera.
        right: picture of the right camera; left out if the first shows both side by side.
        calib: calibration: Middlebury, KITTI, K.txt, OpenCV YAML or XML, or our JSON.
        out: folder for the results.
        preset: name of a preset (see `reconstruct presets`) or path of a TOML file.
        rectified: the rows of the pictures agree already.
        raw: the pictures are to be undistorted and rectified.
        min_disparity: smallest x_left - x_right to search, pixels of the given pictures.
        max_disparity: largest one; both are estimated where neither you nor the calibration says.
        scale: resize the pair first; 0.5 is four times faster or more, and coarser.
        device: where to compute.
        recording: write a Rerun recording, show it in a browser or a window too, or neither.
        settings: TOML file with settings that replace those of the preset.
        override: one setting such as aggregation.radius_px=7 or matching_cost.method=census;
            may be given again and again.
    """
    from recon.pairs import RangeRequest

    if rectified and raw:
        raise ValueError("say --rectified or --raw, not both")
    stated = True if rectified else False if raw else None
    _run(
        lambda: _read(left, right, calib, stated, scale),
        out,
        _preset(preset, settings, override),
        RangeRequest(min_disparity, max_disparity, scale),
        (_device(device), recording),
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


def presets() -> None:
    """List the presets and what each does."""
    from recon.settings import load_preset, preset_names

    table = Table("preset", "what it does", "cost", box=None, pad_edge=False)
    for name in preset_names():
        one = load_preset(name)
        table.add_row(name, one.description, type(one.matcher.matching_cost).__name__)
    console.print(table)


def view(folder: Positional[Path]) -> None:
    """Open the recording of a reconstruction in Rerun's viewer.

    Args:
        folder: the -o of an earlier reconstruction, or an .rrd file.
    """
    from recon.viewer import open_recording

    recording = folder / "recording.rrd" if folder.is_dir() else folder
    if not recording.is_file():
        raise ValueError(f"there is no recording {recording}; was it made with --recording none?")
    open_recording(recording)


COMMANDS: dict[str, Callable[..., Any]] = {
    "pair": pair,
    "demo": demo,
    "presets": presets,
    "view": view,
}


def main(arguments: list[str] | None = None) -> None:
    """Run the command; mistakes of the user end it with one message and status 2."""
    try:
        tyro.extras.subcommand_cli_from_dict(
            COMMANDS,
            prog="reconstruct",
            description="From a pair of photographs to a metric point cloud and a textured mesh.",
            args=arguments,
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


def _device(name: Device) -> str:
    """Return the torch device that a name stands for."""
    import torch

    if name == "cuda" and not torch.cuda.is_available():
        raise ValueError("--device cuda: this machine has no CUDA device that torch can use")
    return "cuda" if name != "cpu" and torch.cuda.is_available() else "cpu"


def _preset(name: str, settings: Path | None, overrides: tuple[str, ...]) -> Preset:
    """Return the preset with the file's settings laid over it, then the command line's."""
    from recon.settings import load_preset, overrides_from

    return load_preset(name, overrides_from(settings, overrides))


def _read(
    left: Path, right: Path | None, calib: Path, rectified: bool | None, scale: float
) -> PairOnDisk:
    from recon.pairs import read_pair

    return read_pair(left, right, calib, rectified=rectified, scale=scale)


class _Progress:
    """An observer that names each stage as it ends."""

    def __init__(self) -> None:
        self._since = time.perf_counter()
        self._status = console.status("starting") if console.is_terminal else None

    def __enter__(self) -> _Progress:
        if self._status is not None:
            self._status.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._status is not None:
            self._status.stop()

    def __call__(self, stage: str, result: object) -> None:  # noqa: ARG002  an observer
        now = time.perf_counter()
        if now - self._since > QUIET or not console.is_terminal:
            console.print(f"  {stage:<32} {now - self._since:6.2f} s")
        if self._status is not None:
            self._status.update(f"after {stage}")
        self._since = now


def _recorder(recording: Recording, folder: Path) -> contextlib.AbstractContextManager[Any]:
    """Return the observer that draws, or one that does not."""
    from recon.observer import ignore

    if recording == "none":
        return contextlib.nullcontext(ignore)
    from recon.viewer import RerunObserver

    shows: dict[str, Any] = {"save": "nothing", "serve": "browser", "spawn": "window"}
    return RerunObserver(save=folder / "recording.rrd", show=shows[recording])


def _run(
    read: Callable[[], PairOnDisk],
    out: Path,
    preset: Preset,
    limits: RangeRequest,
    where: tuple[str, Recording],
) -> None:
    """Read, reconstruct, write: all or nothing."""
    from recon.files import write_json
    from recon.observer import all_of
    from recon.output import all_or_nothing, write_results
    from recon.pipeline import reconstruct
    from recon.report import run_report
    from recon.timing import Stopwatch, compilation_watched

    device, recording = where
    with (
        all_or_nothing(out) as folder,
        _Progress() as progress,
        _recorder(recording, folder) as recorder,
        compilation_watched() as compiled_for,
    ):
        watch = Stopwatch(all_of(progress, recorder))
        source = read()
        for note in source.notes:
            console.print(f"note: {note}", soft_wrap=True)
        disparities = limits.applied_to(source.disparities)
        watch("input/files", source.inputs)
        result = reconstruct(
            source.pair, preset, disparities=disparities, device=device, observe=watch
        )
        write_results(folder, result)
        watch("write", sorted(path.name for path in folder.iterdir()))
        report = {
            **run_report(result, preset, device=device, seconds=watch.seconds),
            "seconds of first compilation": round(compiled_for(), 4),
            "disparity range from": limits.origin(source.disparities),
            "inputs": source.inputs,
        }
        watch("run", report)
        write_json(folder / "run.json", report)
    _say_what_was_made(report, out)
    if recording == "serve":
        _keep_serving(recorder)


def _say_what_was_made(report: dict[str, Any], out: Path) -> None:
    """Print whether the units can be right, the size of the result and where it lies."""
    console.print(report["metric sanity"], soft_wrap=True)
    if (compiled := report["seconds of first compilation"]) > QUIET:
        console.print(f"{compiled:.1f} s of this went into compiling, once; later runs are faster")
    console.print(
        f"{report['points']:,} points and {report['triangles']:,} triangles; results lie in {out}",
        soft_wrap=True,
    )


def _keep_serving(recorder: RerunObserver) -> None:
    """Show the recording until Ctrl-C; the files are written by now."""
    console.print(f"showing at {recorder.url}; press Ctrl-C to end", soft_wrap=True)
    recorder.wait()


if __name__ == "__main__":
    main()
