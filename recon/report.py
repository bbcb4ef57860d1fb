"""What a run says of itself: settings, versions, times, counts, and one line on the units."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib import metadata
from typing import Any

import numpy as np
import torch

from calib.rig import RectifiedGeometry
from recon.pipeline import Reconstruction
from recon.settings import Preset, spelled_out
from recon.types import Array, PixelStatus, Removal

__all__ = [
    "UNITS",
    "UNITS_WITHOUT_CALIBRATION",
    "removals_of",
    "run_report",
    "sanity_line",
    "status_counts",
    "versions",
]

PACKAGES = (
    "stereo-recon",
    "numpy",
    "torch",
    "numba",
    "opencv-python-headless",
    "open3d",
    "trimesh",
    "rerun-sdk",
)
UNITS = "metres"
UNITS_WITHOUT_CALIBRATION = (
    "NOT METRIC: all lengths are in baselines, the unknown distance between the cameras, also "
    "where a name says metres; depth.png is in thousandths of it"
)


def run_report(
    result: Reconstruction,
    preset: Preset,
    *,
    device: str,
    seconds: Mapping[str, float],
    metric: bool = True,
) -> dict[str, Any]:
    """Return all that is needed to understand a result, or to make it again.

    Args:
        result: of `reconstruct`.
        preset: that it was made with.
        device: where the matcher computed.
        seconds: of each stage.
        metric: whether lengths are metres; otherwise the baseline is 1.
    """
    geometry = result.pair.geometry
    sigma_px = preset.triangulation.disparity_sigma(result.disparity)
    low, sigma_median, high = _outer_twentieths(sigma_px)
    return {
        "units": UNITS if metric else UNITS_WITHOUT_CALIBRATION,
        "metric sanity": sanity_line(geometry, result.depth, sigma_median, metric=metric),
        "sigma of disparities px": {"5 %": low, "median": sigma_median, "95 %": high},
        "disparities": {"from": result.disparities[0], "to": result.disparities[-1]},
        "pixels per status": status_counts(result.disparity.status),
        "points": len(result.cloud),
        "removed from the cloud": removals_of(result.removals),
        "triangles": len(result.mesh.faces),
        "seconds": {stage: round(value, 4) for stage, value in seconds.items()},
        "device": torch.cuda.get_device_name() if device == "cuda" else device,
        "geometry": asdict(geometry),
        "settings": spelled_out(preset),
        "versions": versions(),
    }


def _outer_twentieths(values: Array) -> tuple[float, float, float]:
    """Return what 5, 50 and 95 % of the values, NaN left out, are below; zeros of none."""
    known = values[np.isfinite(values)]
    if not len(known):
        return 0.0, 0.0, 0.0
    low, median, high = (round(float(value), 4) for value in np.percentile(known, [5, 50, 95]))
    return low, median, high


def removals_of(removals: Sequence[Removal]) -> list[dict[str, Any]]:
    """Return what each filter took away, with its share of what there was before, in percent."""
    return [
        {"filter": r.filter, "removed": r.removed, "of": r.of, "percent": round(r.percent, 3)}
        for r in removals
    ]


def status_counts(status: Array) -> dict[str, int]:
    """Return how many pixels are in each state, by its name in lower case."""
    return {state.name.lower(): int((status == state).sum()) for state in PixelStatus}


def versions() -> dict[str, str]:
    """Return the versions of everything that can change a result."""
    found = {"python": platform.python_version(), "machine": platform.machine()}
    for package in PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


def sanity_line(
    geometry: RectifiedGeometry, depth: Array, disparity_sigma_px: float, *, metric: bool = True
) -> str:
    """Return one line by which a person sees whether the units can be right.

    Args:
        geometry: of the pair.
        depth: (H, W) metres, NaN where there is none.
        disparity_sigma_px: standard deviation of a disparity, that of the median pixel.
        metric: whether lengths are metres; otherwise the baseline is 1.
    """
    unit = "m" if metric else "baselines"
    start = (
        f"{'' if metric else 'NOT METRIC: '}f {geometry.focal_px:.1f} px, "
        f"baseline {geometry.baseline_m:.4f} {'m' if metric else '(the unit of all lengths)'}, "
        f"disparity at infinity {geometry.disparity_at_infinity:.2f} px"
    )
    if np.isnan(depth).all():
        return f"{start}; no depth"
    near, median, far = np.nanpercentile(depth, [1, 50, 99])
    sigma = median**2 / (geometry.focal_px * geometry.baseline_m) * disparity_sigma_px
    expected = f"{sigma * 1000:.1f} mm" if metric else f"{sigma:.3f} {unit}"
    return (
        f"{start}; depth {near:.2f} to {far:.2f} {unit} (1 to 99 %), median {median:.2f} {unit}; "
        f"expected sigma_z there {expected} ({disparity_sigma_px:.3g} px)"
    )
