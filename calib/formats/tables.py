"""The formats that are known, and how to read or write a file of any of them."""

from __future__ import annotations

from pathlib import Path

from calib.formats.colmap import COLMAP_READER, COLMAP_WRITER
from calib.formats.k_txt import K_TXT_READER
from calib.formats.kalibr import KALIBR_READER, KALIBR_WRITER
from calib.formats.kitti import KITTI_READER, KITTI_WRITER
from calib.formats.middlebury import MIDDLEBURY_READER, MIDDLEBURY_WRITER
from calib.formats.opencv import OPENCV_READER, OPENCV_WRITER
from calib.formats.own_json import OWN_JSON_READER, OWN_JSON_WRITER
from calib.formats.protocol import CalibrationFile, LengthUnit, Reader, Writer
from calib.formats.record import CalibrationRecord
from calib.formats.ros import ROS_READER
from calib.formats.ros_writing import ROS_WRITER
from calib.formats.tagged_xml import TAGGED_XML_READER
from calib.rig import RectifiedGeometry, StereoCalibration

__all__ = ["READERS", "WRITERS", "check_writable", "read_calibration", "write_calibration"]

# The first that recognises a file reads it: of two that may, the stricter comes first.
READERS: dict[str, Reader] = {
    "json": OWN_JSON_READER,
    "tagged_xml": TAGGED_XML_READER,
    "kalibr": KALIBR_READER,
    "ros": ROS_READER,
    "opencv": OPENCV_READER,
    "middlebury": MIDDLEBURY_READER,
    "kitti": KITTI_READER,
    "colmap": COLMAP_READER,
    "k_txt": K_TXT_READER,
}
# The first whose endings fit writes a file of which no format is given.
WRITERS: dict[str, Writer] = {
    "json": OWN_JSON_WRITER,
    "opencv": OPENCV_WRITER,
    "middlebury": MIDDLEBURY_WRITER,
    "ros": ROS_WRITER,
    "kalibr": KALIBR_WRITER,
    "kitti": KITTI_WRITER,
    "colmap": COLMAP_WRITER,
}


def read_calibration(
    path: str | Path,
    *,
    image_size: tuple[int, int] | None = None,
    unit: LengthUnit | None = None,
) -> CalibrationRecord:
    """Read a calibration file of any known format, told by what is in it.

    Args:
        path: the file.
        image_size: (width, height) of the images it is to be used with. Formats that do not say
            need it; of a file for several sizes only the part of this size is returned.
        unit: of lengths, for formats that do not say. Without it a baseline up to 10 is taken as
            metres and a longer one as millimetres, and the record's notes say so.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if the format is unknown, the file is damaged, or it is for other images.
    """
    path = Path(path)
    if path.is_dir():
        raise ValueError(f"{path} is a folder; give the calibration file in it")
    if not path.exists():
        raise FileNotFoundError(f"there is no calibration file {path}")
    text = path.read_bytes().decode("utf-8-sig", errors="replace")
    file = CalibrationFile(path, text, image_size, unit)
    try:
        record = _reader(file).read(file)
        return record if image_size is None else record.for_images(image_size)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def write_calibration(
    path: str | Path,
    calibration: CalibrationRecord | StereoCalibration | RectifiedGeometry,
    *,
    format: str | None = None,
) -> None:
    """Write a calibration file, or the two files of a format that has one for each camera.

    They appear whole or not at all: they are written under other names, then renamed.

    Args:
        path: where; for a format of two files either of them, the other goes beside it.
        calibration: what to write.
        format: a key of `WRITERS`. None takes what the ending of the name stands for: .json
            (this project's own, exact), .yml, .yaml or .xml (OpenCV), or .txt (Middlebury,
            rectified geometry only).

    Raises:
        FileNotFoundError: if the folder does not exist.
        ValueError: if the format or the ending is unknown, or the format cannot hold the
            calibration.
    """
    path = Path(path)
    texts = _writer(path, format).render(_as_record(calibration, path), path)
    for place in texts:
        _check_folder(place)
    _write_all(texts)


def check_writable(path: str | Path, *, format: str | None = None) -> None:
    """Raise what `write_calibration` would for this path, before there is a calibration.

    Raises:
        FileNotFoundError: if the folder does not exist.
        ValueError: if the format or the ending is unknown.
    """
    _writer(Path(path), format)
    _check_folder(Path(path))


def _check_folder(path: Path) -> None:
    if not path.parent.is_dir():
        raise FileNotFoundError(f"there is no folder {path.parent} to write {path.name} in")


def _write_all(texts: dict[Path, str]) -> None:
    """Write all files or none."""
    partials = {path: path.with_name(f".{path.name}.partial") for path in texts}
    try:
        for path, partial in partials.items():
            partial.write_text(texts[path], encoding="utf-8")
        _rename_all(partials)
    finally:
        for partial in partials.values():
            partial.unlink(missing_ok=True)


def _rename_all(partials: dict[Path, Path]) -> None:
    """Put all files in their places; if one fails, put the older ones back."""
    older = {path: path.read_bytes() if path.exists() else None for path in partials}
    renamed: list[Path] = []
    try:
        for path, partial in partials.items():
            partial.replace(path)
            renamed.append(path)
    except BaseException:
        for path in renamed:
            content = older[path]
            if content is None:
                path.unlink()
            else:
                path.write_bytes(content)
        raise


def _reader(file: CalibrationFile) -> Reader:
    for reader in READERS.values():
        if reader.recognises(file):
            return reader
    known = "\n".join(f"  {reader.looks_like}" for reader in READERS.values())
    beginning = file.text.strip()[:40]
    raise ValueError(
        f"unknown calibration format, the file begins with {beginning!r}; "
        f"known formats are\n{known}"
    )


def _writer(path: Path, format: str | None) -> Writer:
    if format is not None and format not in WRITERS:
        raise ValueError(f"format must be one of {', '.join(WRITERS)}; got {format!r}")
    writers = list(WRITERS.values()) if format is None else [WRITERS[format]]
    for writer in writers:
        if path.suffix.lower() in writer.suffixes:
            return writer
    endings = ", ".join(dict.fromkeys(suffix for writer in writers for suffix in writer.suffixes))
    kind = "calibration" if format is None else f"{format} calibration"
    raise ValueError(f"{path}: a {kind} file ends in {endings}; got {path.suffix!r}")


def _as_record(
    calibration: CalibrationRecord | StereoCalibration | RectifiedGeometry, path: Path
) -> CalibrationRecord:
    if isinstance(calibration, StereoCalibration):
        return CalibrationRecord(calibration, None, path, "json")
    if isinstance(calibration, RectifiedGeometry):
        return CalibrationRecord(None, calibration, path, "json")
    return calibration
