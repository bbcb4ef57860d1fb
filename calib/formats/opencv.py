"""OpenCV's FileStorage: YAML or XML, in one file or as `intrinsics` and `extrinsics`."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from calib.camera import Camera, CameraModel
from calib.formats.opencv_values import (
    SIDES,
    Values,
    find,
    find_size,
    image_size,
    load_values,
    plain,
    sided,
)
from calib.formats.protocol import METRES, Array, CalibrationFile, Reader, Writer
from calib.formats.record import CalibrationRecord
from calib.formats.rigs import projections
from calib.pose import Pose, nearest_rotation
from calib.rig import RectifiedGeometry, StereoCalibration

__all__ = ["OPENCV_READER", "OPENCV_WRITER"]

NAME = "opencv"
# Names in use, as `plain` spells them; the side stands before or after.
MATRICES = ("m", "k", "cameramatrix", "mtx", "intrinsics", "intrinsicmatrix")
LENSES = ("d", "distcoeffs", "distcoeff", "distortioncoefficients", "distortion", "dist")
PROJECTIONS = ("p", "projection", "projectionmatrix")
ROTATIONS = ("r", "rotation", "rotationmatrix", "rstereo")
TRANSLATIONS = ("t", "translation", "translationvector", "trans", "tstereo")
UNITS = ("unit", "units", "unitoflength")
MODELS: dict[str, CameraModel] = {
    "pinhole": "pinhole",
    "opencv": "pinhole",
    "radtan": "pinhole",
    "plumbbob": "pinhole",
    "rationalpolynomial": "pinhole",
    "fisheye": "fisheye",
    "equidistant": "fisheye",
    "kannalabrandt": "fisheye",
}
OTHER_HALF = {"intrinsic": "extrinsic", "extrinsic": "intrinsic"}
AMBIGUOUS_COEFFICIENTS = 4


def _recognises(file: CalibrationFile) -> bool:
    marks = ("%YAML", "<opencv_storage", "!!opencv-matrix", '"opencv-matrix"')
    return any(mark in file.text for mark in marks)


def _read(file: CalibrationFile) -> CalibrationRecord:
    values = _with_other_half(file.path, load_values(file.text))
    t = find(values, TRANSLATIONS, count=3)
    P_left, P_right = (find(values, sided(PROJECTIONS, side), count=12) for side in SIDES)
    if t is None and (P_left is None or P_right is None):
        raise ValueError(
            "there is neither a translation T between the cameras nor projections P1 and P2; "
            + _what_is_there(file.path, values)
        )
    metres, notes = _metres_per_unit(file, values, t, P_right)
    size = file.size_or_given(image_size(values))
    raw = rectified = None
    if t is not None:
        raw, raw_notes = _raw(file.path, values, t.reshape(3) * metres, size)
        notes += raw_notes
    if P_left is not None and P_right is not None:
        scale = np.array([1, 1, 1, metres])
        left, right = P_left.reshape(3, 4) * scale, P_right.reshape(3, 4) * scale
        rectified_size = find_size(values, ("newimagesize",)) or size
        rectified = RectifiedGeometry.from_projections(left, right, rectified_size)
    return CalibrationRecord(raw, rectified, file.path, NAME, notes=notes)


def _with_other_half(path: Path, values: Values) -> Values:
    """Return the entries of a file and of its other half, where it is one of two."""
    other = _other_half(path)
    if other is None or not other.is_file():
        return values
    return {**load_values(other.read_text(encoding="utf-8", errors="replace")), **values}


def _other_half(path: Path) -> Path | None:
    for half, other in OTHER_HALF.items():
        if half in path.name:
            return path.with_name(path.name.replace(half, other))
    return None


def _what_is_there(path: Path, values: Values) -> str:
    other = _other_half(path)
    hint = f"; expected the other half {other.name} beside it" if other else ""
    return f"got {', '.join(values) or 'nothing'}{hint}"


def _metres_per_unit(
    file: CalibrationFile, values: Values, t: Array | None, P_right: Array | None
) -> tuple[float, tuple[str, ...]]:
    """Return the factor to metres: as the caller says, else the file, else by the baseline."""
    stated = next((values[name] for name in UNITS if name in values), None)
    if file.unit is None and stated is not None:
        for unit, metres in METRES.items():
            if stated == unit:
                return metres, ()
        raise ValueError(f"unit must be m, cm or mm, got {stated!r}")
    if t is not None:
        return file.metres_per_unit(float(np.linalg.norm(t)))
    assert P_right is not None  # `_read` looked
    P = P_right.reshape(3, 4)
    return file.metres_per_unit(float(np.linalg.norm(P[:2, 3]) / P[0, 0]))


def _raw(
    path: Path, values: Values, t: Array, size: tuple[int, int]
) -> tuple[StereoCalibration, tuple[str, ...]]:
    R = find(values, ROTATIONS, count=9)
    turn = find(values, ROTATIONS, count=3)
    if R is None and turn is None:
        raise ValueError("there is a translation T between the cameras but no rotation R")
    if R is None and turn is not None:
        R = np.asarray(cv2.Rodrigues(turn.reshape(3, 1))[0], dtype=np.float64)
    assert R is not None  # one of the two is there
    model = _model(values)
    left, left_notes = _camera(path, values, "left", size, model)
    right, right_notes = _camera(path, values, "right", size, model)
    pose = Pose(nearest_rotation(R.reshape(3, 3)), t)
    notes = tuple(dict.fromkeys(left_notes + right_notes))
    return StereoCalibration(left, right, pose), notes


def _model(values: Values) -> CameraModel | None:
    """Return the lens model that the file states, None if it does not."""
    stated = next((values[key] for key in ("model", "cameramodel") if key in values), None)
    if isinstance(stated, str):
        if plain(stated) not in MODELS:
            raise ValueError(f"camera model must be pinhole or fisheye, got {stated!r}")
        return MODELS[plain(stated)]
    flag = find(values, ("fisheye", "isfisheye"), count=1)
    if flag is None:
        return None
    return "fisheye" if flag.item() else "pinhole"


def _camera(
    path: Path, values: Values, side: str, size: tuple[int, int], model: CameraModel | None
) -> tuple[Camera, tuple[str, ...]]:
    K = find(values, sided(MATRICES, side), count=9)
    if K is None:
        raise ValueError(
            f"there is no camera matrix of the {side} camera (M1 or M2, K1, cameraMatrix1, ...); "
            + _what_is_there(path, values)
        )
    lens = find(values, sided(LENSES, side))
    notes: tuple[str, ...] = ()
    if lens is None:
        notes = ("the file holds no lens distortion: none was assumed",)
    elif lens.size == AMBIGUOUS_COEFFICIENTS and model is None:
        notes = (
            "four lens coefficients were read as k1 k2 p1 p2 of a pinhole; "
            "add 'model: fisheye' to the file if they are of a fisheye",
        )
    distortion = np.zeros(0) if lens is None else lens.ravel()
    return Camera(size, K.reshape(3, 3), distortion, model or "pinhole"), notes


def _render(record: CalibrationRecord, path: Path) -> dict[Path, str]:
    kind = ".xml" if path.suffix.lower() == ".xml" else ".yml"
    storage = cv2.FileStorage(kind, cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("unit", "m")
    if record.raw is not None:
        _write_raw(storage, record.raw)
    if record.rectified is not None:
        _write_rectified(storage, record.rectified, alone=record.raw is None)
    return {path: str(storage.releaseAndGetString())}


def _write_raw(storage: cv2.FileStorage, rig: StereoCalibration) -> None:
    if rig.left.model != rig.right.model:
        raise ValueError("OpenCV files hold two cameras of one model; write .json instead")
    _write_size(storage, "imageSize", rig.left.size)
    storage.write("model", rig.left.model)
    for number, camera in (("1", rig.left), ("2", rig.right)):
        # OpenCV writes no empty matrix: five zeros mean the same.
        lens = camera.distortion if camera.distortion.size else np.zeros(5)
        storage.write(f"M{number}", camera.K)
        storage.write(f"D{number}", lens[None])
    storage.write("R", rig.right_from_left.R)
    storage.write("T", rig.right_from_left.t[:, None])


def _write_rectified(storage: cv2.FileStorage, geometry: RectifiedGeometry, *, alone: bool) -> None:
    _write_size(storage, "imageSize" if alone else "newImageSize", geometry.size)
    for name, P in zip(("P1", "P2"), projections(geometry), strict=True):
        storage.write(name, P)


def _write_size(storage: cv2.FileStorage, name: str, size: tuple[int, int]) -> None:
    storage.startWriteStruct(name, cv2.FileNode_SEQ | cv2.FileNode_FLOW)
    for pixels in size:
        storage.write("", pixels)
    storage.endWriteStruct()


OPENCV_READER = Reader(
    looks_like="OpenCV YAML or XML: matrices M1, D1, M2, D2, R, T, or P1 and P2",
    recognises=_recognises,
    read=_read,
)
OPENCV_WRITER = Writer(suffixes=(".yml", ".yaml", ".xml"), render=_render)
