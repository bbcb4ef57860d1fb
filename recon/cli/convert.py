"""`reconstruct convert`: a calibration in another format."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from recon.cli.terminal import Unit, console

__all__ = ["convert"]

Target = Annotated[Path, arg(aliases=["-o"])]
Format = Literal["json", "opencv", "middlebury", "kitti", "ros", "kalibr", "colmap"]


def convert(
    calibration: Positional[Path],
    /,
    *,
    out: Target,
    format: Format | None = None,
    image_size: tuple[int, int] | None = None,
    unit: Unit | None = None,
) -> None:
    """Write a calibration in another format.

    Args:
        calibration: file in any format that `reconstruct pair` reads.
        out: file to write; formats of two files take the name of the left one or of the folder.
        format: where the ending says too little, as .yaml does; by the ending if not given.
        image_size: width and height of the images, for files that do not say.
        unit: of lengths, for files that do not say.
    """
    from calib.formats import read_calibration, write_calibration

    record = read_calibration(calibration, image_size=image_size, unit=unit)
    for note in record.notes:
        console.print(f"note: {note}", soft_wrap=True)
    write_calibration(out, record, format=format)
    parts = [
        name
        for name, part in (("raw", record.raw), ("rectified", record.rectified))
        if part is not None
    ]
    console.print(f"{record.format}, {' and '.join(parts)}, was written to {out}", soft_wrap=True)
