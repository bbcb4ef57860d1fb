"""Cameras and rotations as COLMAP writes them.

Source: colmap/colmap, documentation "Camera Models" and "Output Format", and
src/colmap/sensor/models.h (order of the parameters, where the pixels are).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.camera import Camera, CameraModel
from calib.formats.protocol import Array

__all__ = ["camera_from", "parameters_of", "quaternion_of", "rotation_from"]

PIXEL_CENTRE = 0.5  # of the top-left pixel; ours is 0
PARAMETERS = {
    "SIMPLE_PINHOLE": "f cx cy",
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_RADIAL": "f cx cy k1",
    "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
    "OPENCV_FISHEYE": "fx fy cx cy k1 k2 k3 k4",
    "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
}
# The coefficients that `Camera` takes, in its order.
COEFFICIENTS = {
    "SIMPLE_RADIAL": "k1 k2 p1 p2",
    "RADIAL": "k1 k2 p1 p2",
    "OPENCV": "k1 k2 p1 p2",
    "OPENCV_FISHEYE": "k1 k2 k3 k4",
    "FULL_OPENCV": "k1 k2 p1 p2 k3 k4 k5 k6",
}
BY_COUNT = {0: "PINHOLE", 4: "OPENCV", 5: "FULL_OPENCV", 8: "FULL_OPENCV"}
LENGTH_TOLERANCE = 1e-3


def camera_from(model: str, size: tuple[int, int], numbers: Sequence[float]) -> Camera:
    """Return a camera.

    Args:
        model: COLMAP's name of it.
        size: (width, height) in pixels.
        numbers: its parameters.

    Raises:
        ValueError: if the model is not known here, or the parameters are too many or too few.
    """
    if model not in PARAMETERS:
        raise ValueError(
            f"camera model {model} cannot be read, only {', '.join(PARAMETERS)}; calibrate with "
            "one of these, or undistort the images with colmap image_undistorter"
        )
    names = PARAMETERS[model].split()
    if len(numbers) != len(names):
        raise ValueError(
            f"a {model} camera has {len(names)} parameters ({PARAMETERS[model]}), "
            f"got {len(numbers)}; is the file cut off?"
        )
    values = dict(zip(names, numbers, strict=True))
    fx, fy = (values.get(name, values.get("f", 0.0)) for name in ("fx", "fy"))
    cx, cy = values["cx"] - PIXEL_CENTRE, values["cy"] - PIXEL_CENTRE
    lens = [values.get(name, 0.0) for name in COEFFICIENTS.get(model, "").split()]
    kind: CameraModel = "fisheye" if model == "OPENCV_FISHEYE" else "pinhole"
    return Camera(size, np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), np.array(lens), kind)


def parameters_of(camera: Camera) -> tuple[str, list[float]]:
    """Return COLMAP's name of a camera's model, and its parameters.

    Raises:
        ValueError: if COLMAP has no such lens.
    """
    lens = camera.distortion
    if camera.model == "pinhole" and lens.size not in BY_COUNT:
        raise ValueError(
            f"COLMAP's FULL_OPENCV has 8 lens coefficients, the camera has {lens.size}; "
            "write .json or OpenCV's .yml instead"
        )
    model = "OPENCV_FISHEYE" if camera.model == "fisheye" else BY_COUNT[lens.size]
    count = len(COEFFICIENTS.get(model, "").split())
    fx, fy, (cx, cy) = camera.K[0, 0], camera.K[1, 1], camera.K[:2, 2] + PIXEL_CENTRE
    return model, [float(x) for x in (fx, fy, cx, cy, *np.pad(lens, (0, count - lens.size)))]


def rotation_from(quaternion: Array) -> Array:
    """Return the (3, 3) rotation of a quaternion (w, x, y, z), in Hamilton's convention.

    With q = (w, v), R = (w^2 - v.v) I + 2 v v^T + 2 w [v]_x.

    Raises:
        ValueError: if its length is not 1.
    """
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1) > LENGTH_TOLERANCE:
        raise ValueError(
            f"a rotation is a quaternion (w, x, y, z) of length 1, got {quaternion.tolist()} "
            f"of length {length:g}"
        )
    w, *v = quaternion / length
    x, y, z = v
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation: Array = (w * w - np.dot(v, v)) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * cross
    return rotation


def quaternion_of(R: Array) -> Array:
    """Return the quaternion (w, x, y, z), w >= 0, of a rotation.

    It is the eigenvector of the greatest eigenvalue of a symmetric matrix made of R, which is
    accurate for every angle.

    Source: Bar-Itzhack, Journal of Guidance, Control and Dynamics 23(6) 2000.
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = R
    symmetric = np.array(
        [
            [xx + yy + zz, zy - yz, xz - zx, yx - xy],
            [zy - yz, xx - yy - zz, xy + yx, xz + zx],
            [xz - zx, xy + yx, yy - xx - zz, yz + zy],
            [yx - xy, xz + zx, yz + zy, zz - xx - yy],
        ]
    )
    quaternion: Array = np.linalg.eigh(symmetric)[1][:, -1]
    return quaternion if quaternion[0] >= 0 else -quaternion
