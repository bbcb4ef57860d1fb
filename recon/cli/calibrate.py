"""`reconstruct calibrate`: from photographs of a board to a rig, with a report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from tyro.conf import Positional, arg

from recon.cli.terminal import console

if TYPE_CHECKING:
    from recon.calibration import Calibrated

__all__ = ["calibrate"]

RigFile = Annotated[Path, arg(aliases=["-o"])]
Board = Annotated[str, arg(metavar="KIND:COLUMNSxROWS:LENGTH")]


def calibrate(  # noqa: PLR0913  every one is an option of the command
    left: Positional[str],
    right: Positional[str | None] = None,
    /,
    *,
    board: Board,
    out: RigFile,
    model: Literal["pinhole", "rational", "fisheye"] = "pinhole",
    side_by_side: bool = False,
    recording: Literal["save", "none"] = "save",
) -> None:
    """Calibrate a rig from photographs of a board, and say how good the calibration is.

    Args:
        left: folder or quoted pattern of the left photographs, such as 'left/*.png'; those of one
            moment have the same name or number on both sides.
        right: of the right photographs; left out with --side-by-side.
        board: chessboard:9x6:25mm (inner corners), circles:7x6:20mm, staggered-circles:4x11:20mm
            or charuco:31x16:49.33mm:38.46mm:DICT_4X4_1000 (squares, their side, the markers').
        out: the calibration, such as rig.json or rig.yml; reports are written beside it.
        model: of both lenses; rational for wide angles, fisheye for more than about 120 degrees.
        side_by_side: each photograph shows both views.
        recording: write a Rerun recording of cameras, boards and corners, or not.
    """
    if side_by_side == (right is not None):
        raise ValueError(
            "give the right photographs too, or --side-by-side if each photograph shows both views"
        )
    from calib.formats import check_writable
    from recon.calibration import calibrate as run
    from recon.calibration import write_calibrated
    from recon.calibration.detection import LookedAt

    check_writable(out)
    columns = TextColumn("looking for the board"), BarColumn(), MofNCompleteColumn()
    with Progress(*columns, console=console, disable=not console.is_terminal) as bars:
        task = bars.add_task("")

        def observe(_stage: str, result: object) -> None:
            if isinstance(result, LookedAt):
                bars.update(task, completed=result.done, total=result.total)

        calibrated = run(left, right, board, model=model, observe=observe)
    write_calibrated(out, calibrated, recording=recording == "save")
    _say(calibrated, out)


def _say(calibrated: Calibrated, out: Path) -> None:
    """Print what was found, and how good it is."""
    estimate, quality = calibrated.estimate, calibrated.quality
    for path in calibrated.alone:
        console.print(f"note: {path} has no partner and was not looked at", soft_wrap=True)
    for view in estimate.left_out:
        console.print(f"left out {view.name}: {view.reason}", soft_wrap=True)
    rig, sure = estimate.calibration, quality.uncertainty
    mean, most = quality.vertical_px
    for line in (
        f"{len(estimate.names)} views; corners lie {quality.rms_px:.3f} px from their projections",
        f"rows differ by {mean:.3f} px in the mean, by less than {most:.3f} px for 95 %",
        f"baseline {rig.baseline_m * 1000:.2f} mm, uncertain by {sure.baseline_m * 1000:.2f} mm; "
        f"focal length {rig.left.K[0, 0]:.1f} px, by {max(sure.focal):.2%}",
        f"grade {quality.grade}",
        *(f"  {finding.what}: {finding.advice}" for finding in quality.findings),
        f"{out} is written, and {out.stem}_report.html beside it",
    ):
        console.print(line, soft_wrap=True)
