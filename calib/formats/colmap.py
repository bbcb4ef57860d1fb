"""COLMAP's rigs: `cameras.txt` with `rigs.txt`, and `rig_config.json`.

Source: colmap/colmap, documentation "Output Format" and "Rig Support", and
src/colmap/scene/rig.cc (the keys of `rig_config.json`).
"""

from __future__ import annotations

import json
import re
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calib.camera import Camera
from calib.formats.colmap_values import camera_from, parameters_of, quaternion_of, rotation_from
from calib.formats.protocol import METRES, SAY_THE_UNIT, CalibrationFile, Reader, Writer, as_numbers
from calib.formats.record import CalibrationRecord
from calib.formats.rigs import ALREADY_RECTIFIED, as_rig, left_first, rectified_already
from calib.formats.section import Section
from calib.pose import Pose

__all__ = ["COLMAP_READER", "COLMAP_WRITER"]

NAME = "colmap"
CAMERAS, RIGS = "cameras.txt", "rigs.txt"
CAMERA_LINE = re.compile(r"^\s*\d+\s+[A-Z][A-Z_]+\s+\d+\s+\d+\s+[-+\d.]", re.MULTILINE)
RIG_LINE = re.compile(r"^\s*\d+\s+\d+\s+(CAMERA|IMU)\s+\d+", re.MULTILINE)
HEADS = ("# Camera list with one line", "# Rig calib list with one line")
CAMERA_WORDS = 3
POSE_NUMBERS = 7
UNKNOWN_SCALE = (
    "COLMAP's unit of length is arbitrary and was taken as metres, so mind that the results have "
    f"no scale; if the model was scaled, {SAY_THE_UNIT}"
)


@dataclass(frozen=True)
class _Two:
    """The first two cameras of a rig.

    Attributes:
        names: what the file calls them.
        cameras: the reference and the other one.
        pose: of the second from the first, in COLMAP's unit.
        notes: what was left out.
    """

    names: tuple[str, str]
    cameras: tuple[Camera, Camera]
    pose: Pose
    notes: tuple[str, ...]


def _recognises(file: CalibrationFile) -> bool:
    if _is_json(file):
        return "image_prefix" in file.text and '"cameras"' in file.text
    marked = any(file.text.lstrip().startswith(head) for head in HEADS)
    return (
        marked
        or CAMERA_LINE.search(file.text) is not None
        or RIG_LINE.search(file.text) is not None
        or _is_binary(file.path)
    )


def _is_json(file: CalibrationFile) -> bool:
    return file.text.lstrip().startswith("[")


def _is_binary(path: Path) -> bool:
    return path.name in ("cameras.bin", "rigs.bin")


def _read(file: CalibrationFile) -> CalibrationRecord:
    if _is_binary(file.path):
        raise ValueError(
            "binary COLMAP models are not read; "
            "write text with colmap model_converter --output_type TXT"
        )
    two = _of_config(file) if _is_json(file) else _of_model(file)
    pose = Pose(two.pose.R, two.pose.t * METRES[file.unit or "m"])
    rig, notes = left_first(*two.cameras, pose, two.names)
    notes = two.notes + notes + (() if file.unit else (UNKNOWN_SCALE,))
    geometry = rectified_already(rig)
    if geometry is None:
        return CalibrationRecord(rig, None, file.path, NAME, notes=notes)
    notes = (*notes, ALREADY_RECTIFIED)
    return CalibrationRecord(None, geometry, file.path, NAME, notes=notes)


# cameras.txt and rigs.txt


def _of_model(file: CalibrationFile) -> _Two:
    cameras_text, rigs_text = _both_texts(file)
    cameras = _cameras(cameras_text)
    rigs = [line.split() for line in _rows(rigs_text)]
    for words in rigs:
        sensors = _sensors(deque(words))
        found = [sensor for sensor in sensors if sensor[0] == "CAMERA"]
        if len(found) > 1:
            return _two_of(found, cameras, f"rig {words[0]}", len(rigs))
    raise ValueError(
        f"{RIGS} holds no rig of two cameras; was the model made without colmap rig_configurator?"
    )


def _both_texts(file: CalibrationFile) -> tuple[str, str]:
    """Return what cameras.txt and rigs.txt hold, of which the file is one."""
    is_rigs = RIG_LINE.search(file.text) is not None or file.text.lstrip().startswith(HEADS[1])
    other = file.path.with_name(CAMERAS if is_rigs else RIGS)
    if not other.is_file():
        raise ValueError(
            f"expected {other.name} beside {file.path.name}: {CAMERAS} holds the lenses and {RIGS} "
            "(COLMAP 3.12 and newer) where the cameras stand"
        )
    text = other.read_text(encoding="utf-8", errors="replace")
    return (text, file.text) if is_rigs else (file.text, text)


def _rows(text: str) -> list[str]:
    lines = [line.strip() for line in text.splitlines()]
    return [line for line in lines if line and not line.startswith("#")]


def _cameras(text: str) -> dict[str, Camera]:
    """Return the cameras of cameras.txt by their numbers."""
    cameras = {}
    for line in _rows(text):
        number, *words = line.split()
        if len(words) < CAMERA_WORDS:
            raise ValueError(
                f"camera {number} of {CAMERAS} must have a model, width, height and parameters, "
                f"got {line!r}; is the file cut off?"
            )
        model, *rest = words
        name = f"camera {number} of {CAMERAS}"
        width, height, *parameters = as_numbers(" ".join(rest), len(rest), name).tolist()
        try:
            cameras[number] = camera_from(model, (int(width), int(height)), parameters)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from error
    return cameras


def _sensors(words: deque[str]) -> list[tuple[str, str, Pose | None]]:
    """Return the type, the number and the pose from the rig of every sensor of a rig."""
    rig, count = _next(words, "rig"), _next(words, "number of sensors")
    if not count.isdigit():
        raise ValueError(f"rig {rig} of {RIGS} must have a number of sensors, got {count!r}")
    if int(count) == 0:
        return []
    sensors: list[tuple[str, str, Pose | None]] = [
        (_next(words, "type of the reference"), _next(words, "reference"), Pose.identity())
    ]
    for _ in range(int(count) - 1):
        kind, number = _next(words, "type of a sensor"), _next(words, "sensor")
        pose = None
        if _next(words, "HAS_POSE") == "1":
            text = " ".join(_next(words, "pose") for _ in range(POSE_NUMBERS))
            numbers = as_numbers(text, POSE_NUMBERS, f"pose of sensor {number} in rig {rig}")
            pose = Pose(rotation_from(numbers[:4]), numbers[4:])
        sensors.append((kind, number, pose))
    return sensors


def _next(words: deque[str], name: str) -> str:
    if not words:
        raise ValueError(f"a line of {RIGS} ends before its {name}; is the file cut off?")
    return words.popleft()


def _two_of(
    found: list[tuple[str, str, Pose | None]], cameras: dict[str, Camera], rig: str, rigs: int
) -> _Two:
    (_, first, from_rig), (_, second, second_from_rig), *others = found
    if from_rig is None or second_from_rig is None:
        raise ValueError(
            f"{RIGS} has no pose of camera {second} in {rig}; was it left unknown in the "
            "configuration and no image of it registered?"
        )
    missing = [number for number in (first, second) if number not in cameras]
    if missing:
        raise ValueError(
            f"{rig} has camera {missing[0]}, but {CAMERAS} holds "
            f"{', '.join(cameras) or 'none'}; are both files of one model?"
        )
    notes = []
    if others:
        left_out = ", ".join(number for _, number, _ in others)
        notes.append(f"cameras {first} and {second} of {rig} were taken, not {left_out}")
    if rigs > 1:
        notes.append(f"{rig} was taken, the first with two cameras of {rigs} rigs")
    return _Two(
        names=(f"camera {first}", f"camera {second}"),
        cameras=(cameras[first], cameras[second]),
        pose=second_from_rig @ from_rig.inverse(),
        notes=tuple(notes),
    )


# rig_config.json


def _of_config(file: CalibrationFile) -> _Two:
    try:
        rigs = json.loads(file.text)
    except json.JSONDecodeError as error:
        raise ValueError(f"not valid JSON ({error}); is the file cut off?") from error
    for index, rig in enumerate(rigs):
        entries = rig.get("cameras", []) if isinstance(rig, dict) else []
        sections = [Section(entry, f"[{index}].cameras[{n}].") for n, entry in enumerate(entries)]
        if len(sections) > 1:
            return _two_of_config(sections, file)
    raise ValueError("the configuration holds no rig of two cameras")


def _two_of_config(sections: list[Section], file: CalibrationFile) -> _Two:
    references = [section for section in sections if section.entries.get("ref_sensor") is True]
    if len(references) != 1:
        raise ValueError(
            f'one camera of a rig must have "ref_sensor": true, got {len(references)} of them; '
            "is it a configuration of COLMAP before 3.12?"
        )
    first = references[0]
    second, *others = (section for section in sections if section is not first)
    rotation = rotation_from(second.array("cam_from_rig_rotation", (4,)))
    pose = Pose(rotation, second.array("cam_from_rig_translation", (3,)))
    names = first.text("image_prefix"), second.text("image_prefix")
    notes: tuple[str, ...] = ()
    if others:
        left_out = ", ".join(other.text("image_prefix") for other in others)
        notes = (f"cameras {names[0]} and {names[1]} were taken, not {left_out}",)
    cameras = _config_camera(first, file), _config_camera(second, file)
    return _Two(names, cameras, pose, notes)


def _config_camera(section: Section, file: CalibrationFile) -> Camera:
    if "camera_model_name" not in section or "camera_params" not in section:
        raise ValueError(
            f"{section.place}camera_model_name and camera_params are missing, so the lens is "
            f"unknown; give {RIGS} of the model that COLMAP made instead"
        )
    numbers = section.array("camera_params", (-1,)).tolist()
    return camera_from(section.text("camera_model_name"), file.size_or_given(None), numbers)


# Writing


def _render(record: CalibrationRecord, path: Path) -> dict[Path, str]:
    rig = as_rig(record)
    cameras = rig.left, rig.right
    pose = [*quaternion_of(rig.right_from_left.R).tolist(), *rig.right_from_left.t.tolist()]
    if path.suffix.lower() == ".json":
        return {path: _config_text(cameras, pose)}
    if path.name not in (CAMERAS, RIGS):
        raise ValueError(f"COLMAP calls its files {CAMERAS} and {RIGS}, got {path.name}")
    lines = []
    for number, camera in enumerate(cameras, start=1):
        model, numbers = parameters_of(camera)
        width, height = camera.size
        lines.append(f"{number} {model} {width} {height} {' '.join(map(repr, numbers))}\n")
    return {
        path.with_name(CAMERAS): "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n" + "".join(lines),
        path.with_name(RIGS): (
            "# RIG_ID, NUM_SENSORS, REF_SENSOR_TYPE, REF_SENSOR_ID, SENSORS[] as (SENSOR_TYPE, "
            "SENSOR_ID, HAS_POSE, [QW, QX, QY, QZ, TX, TY, TZ])\n"
            f"1 2 CAMERA 1 CAMERA 2 1 {' '.join(map(repr, pose))}\n"
        ),
    }


def _config_text(cameras: tuple[Camera, Camera], pose: list[float]) -> str:
    entries: list[dict[str, Any]] = [
        {"image_prefix": "left/", "ref_sensor": True},
        {
            "image_prefix": "right/",
            "cam_from_rig_rotation": pose[:4],
            "cam_from_rig_translation": pose[4:],
        },
    ]
    for entry, camera in zip(entries, cameras, strict=True):
        entry["camera_model_name"], entry["camera_params"] = parameters_of(camera)
    return json.dumps([{"cameras": entries}], indent=2) + "\n"


COLMAP_READER = Reader(
    looks_like="COLMAP: cameras.txt with rigs.txt beside it, or rig_config.json",
    recognises=_recognises,
    read=_read,
)
COLMAP_WRITER = Writer(suffixes=(".txt", ".json"), render=_render)
