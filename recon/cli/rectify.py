"""`reconstruct rectify`: raw photographs to ones whose rows agree."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tyro.conf import Positional

from recon.cli.terminal import Out, Unit, console, warn

if TYPE_CHECKING:
    from recon.rectification import CheckedPair

__all__ = ["rectify", "said"]


def rectify(  # noqa: PLR0913  every one is an option of the command
    left: Positional[Path],
    right: Positional[Path | None] = None,
    /,
    *,
    calib: Path,
    out: Out,
    unit: Unit | None = None,
    alpha: float | Literal["keep"] = 0.0,
    scale: float = 1.0,
    size: tuple[int, int] | None = None,
    common_centre: bool = True,
    refine_rectification: bool = False,
) -> None:
    """Undistort and rectify one pair of photographs.

    Writes left.png, right.png and rig.json, which `reconstruct pair` takes.

    Args:
        left: picture of the left camera.
        right: picture of the right camera; left out if the first shows both side by side.
        calib: calibration of the raw cameras.
        out: folder for the results.
        unit: of the lengths in the calibration, where it does not say.
        alpha: which part of the raw pictures to show: 0 only what both fill, 1 every raw pixel with
            black around, keep the middle at the focal length of the raw pictures.
        scale: size of the rectified pictures over that of the raw ones.
        size: WIDTH HEIGHT of the rectified pictures, for other proportions; not with --scale.
        common_centre: give both views one principal point, so that infinity has disparity 0.
            Without it, cameras that look towards each other keep more of what they see.
        refine_rectification: turn the cameras a little so that the rows of the views agree better,
            if they do so significantly.
    """
    from calib.rectify import Rectifier
    from calib.rig import StereoCalibration
    from recon.output import RECTIFIED_OUTPUTS, all_or_nothing, write_rectified
    from recon.pairs import read_pair
    from recon.rectification import check_rows, rectify_and_check, view_in_words

    def rectifier(calibration: StereoCalibration) -> Rectifier:
        shown = None if alpha == "keep" else alpha
        return Rectifier(calibration, shown, scale, size, common_centre)

    _spare(out, (left, right, calib))
    with all_or_nothing(out, RECTIFIED_OUTPUTS) as folder:
        source = read_pair(left, right, calib, rectified=False, unit=unit)
        for note in source.notes:
            console.print(f"note: {note}", soft_wrap=True)
        console.print(f"raw pictures: {check_rows(source.pair).note}", soft_wrap=True)
        checked = said(
            rectify_and_check(source.pair, refine=refine_rectification, rectifier=rectifier),
            ignore=True,
        )
        write_rectified(folder, checked.pair)
    for words in view_in_words(checked, rectifier):
        console.print(words, soft_wrap=True)
    console.print(f"the rectified pair lies in {out}", soft_wrap=True)


def said(checked: CheckedPair, *, ignore: bool) -> CheckedPair:
    """Say what was found about the rows of a pair and what was done, and return the pair.

    Args:
        checked: a pair.
        ignore: whether to go on if matching is meaningless.

    Raises:
        ValueError: if matching is meaningless, unless that is to be ignored.
    """
    from recon.rectification import in_words

    if checked.correction is not None:
        console.print(in_words(checked.correction), soft_wrap=True)
    if checked.check.error is not None:
        if not ignore:
            raise ValueError(f"{checked.check.error}; --ignore-rectification goes on regardless")
        warn(checked.check.error)
    for warning in checked.check.warnings:
        warn(warning)
    console.print(checked.check.note, soft_wrap=True)
    return checked


def _spare(out: Path, read: tuple[Path | None, ...]) -> None:
    """Raise ValueError if a file that is read would be overwritten."""
    from recon.output import RECTIFIED_OUTPUTS

    written = {(out / name).resolve() for name in RECTIFIED_OUTPUTS}
    for path in read:
        if path is not None and path.resolve() in written:
            raise ValueError(f"{path} would be overwritten; choose another folder with -o")
