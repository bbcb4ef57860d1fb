"""Lenses of every kind that calib knows, and rotations for rigs."""

import cv2
import numpy as np

LENSES = {
    "ideal": ("pinhole", []),
    "four": ("pinhole", [-0.28, 0.09, 1e-3, -5e-4]),
    "five": ("pinhole", [-0.31, 0.14, -8e-4, 6e-4, -0.02]),
    "rational": ("pinhole", [2.1, 0.4, 1e-4, 2e-4, 0.01, 2.4, 0.9, 0.05]),
    "thin_prism": ("pinhole", [-0.2, 0.05, 1e-3, 2e-4, 0.0, 0.01, 0, 0, 1e-3, -1e-4, -2e-3, 3e-4]),
    "tilted": (
        "pinhole",
        [-0.2, 0.05, 1e-3, 2e-4, 0, 0.01, 0, 0, 1e-3, -1e-4, -2e-3, 3e-4, 0.02, -0.03],
    ),
    "fisheye": ("fisheye", [0.03, -0.012, 0.004, -0.001]),
}


def rotation(*turn: float) -> np.ndarray:
    """Return the rotation about the vector `turn` by its length in radians."""
    return cv2.Rodrigues(np.array(turn, dtype=float).reshape(3, 1))[0]
