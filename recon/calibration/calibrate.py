"""Photographs of a board in, a rig and a report on it out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from calib.boards import board_named
from calib.estimation import LensName, Quality, RigEstimate, estimate_rig, judge
from calib.formats import check_writable, write_calibration
from calib.pair import StereoPair
from recon.calibration.detection import Detected, detect, read_photographs
from recon.calibration.photographs import Paired, PhotographPair, pair_by_name, photographs
from recon.calibration.report import plain_report, render_report
from recon.files import write_json
from recon.observer import Observer, ignore
from recon.output import all_or_nothing
from recon.viewer.rig import record_rig

__all__ = ["Calibrated", "calibrate", "write_calibrated"]


@dataclass(frozen=True, eq=False)
class Calibrated:
    """A rig, how good it is, and what it was made from.

    Attributes:
        estimate: the rig.
        quality: how far to trust it.
        detected: what the photographs showed.
        pairs: the photographs.
        alone: those without a partner, which were not looked at.
    """

    estimate: RigEstimate
    quality: Quality
    detected: Detected
    pairs: tuple[PhotographPair, ...]
    alone: tuple[Path, ...]


def calibrate(
    left: str,
    right: str | None,
    board: str,
    *,
    model: LensName = "pinhole",
    observe: Observer = ignore,
) -> Calibrated:
    """Calibrate a rig from photographs of a board.

    Args:
        left: folder or pattern of the left photographs.
        right: of the right ones; None if each left one shows both views side by side.
        board: such as `chessboard:9x6:25mm`, see `calib.boards.board_named`.
        model: of both lenses.
        observe: told ("board", LookedAt) while photographs are looked at.

    Raises:
        FileNotFoundError: if no photograph is found.
        ValueError: if the rig cannot be calibrated; the message says why and what to do.
    """
    wanted = board_named(board)
    paired = _paired(left, right)
    detected = detect(paired.pairs, wanted, observe=observe)
    estimate = estimate_rig(wanted, detected.views, detected.size, model)
    _check_sides(estimate)
    return Calibrated(estimate, judge(estimate), detected, paired.pairs, paired.alone)


def write_calibrated(path: str | Path, calibrated: Calibrated, *, recording: bool = True) -> None:
    """Write the rig, and beside it the report as HTML, JSON and Rerun recording.

    `rig.json` comes with `rig_report.html`, `rig_report.json` and `rig_report.rrd`: all or nothing.

    Args:
        path: of the rig, in any format of `calib.formats.write_calibration`.
        calibrated: of `calibrate`.
        recording: whether to write the recording.

    Raises:
        FileNotFoundError: if the folder does not exist.
        ValueError: if no format has this ending.
    """
    path = Path(path)
    estimate, detected = calibrated.estimate, calibrated.detected
    check_writable(path)
    shown = next(pair for pair in calibrated.pairs if pair.name == estimate.names[0])
    example = StereoPair(*read_photographs(shown), estimate.calibration)
    page = render_report(estimate, calibrated.quality, detected, example)
    reports = [f"{path.stem}_report{ending}" for ending in (".html", ".json", ".rrd")]
    with all_or_nothing(path.parent, (path.name, *reports)) as folder:
        write_calibration(folder / path.name, estimate.calibration)
        html, plain, rrd = (folder / name for name in reports)
        html.write_text(page, encoding="utf-8")
        write_json(plain, plain_report(estimate, calibrated.quality))
        if recording:
            pictures = tuple((left.image, right.image) for left, right in detected.thumbnails)
            record_rig(rrd, estimate, calibrated.quality, detected.views, pictures)


def _paired(left: str, right: str | None) -> Paired:
    if right is not None:
        return pair_by_name(photographs(left), photographs(right))
    return Paired(tuple(PhotographPair(path.name, path, None) for path in photographs(left)), ())


def _check_sides(estimate: RigEstimate) -> None:
    """Raise ValueError if the right camera is not at the right."""
    x, y, _ = estimate.calibration.right_from_left.t
    if abs(y) > abs(x):
        raise ValueError(
            f"the cameras stand one above the other ({abs(y) * 1000:.0f} mm); only rigs side by "
            "side can be matched: turn the photographs of both by 90 degrees"
        )
    if x > 0:
        raise ValueError(
            f"the right camera stands {x * 1000:.0f} mm to the left of the left one; "
            "give the photographs in the other order"
        )
