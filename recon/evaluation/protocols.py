"""The rules by which a disparity map is compared with the truth: one table, no mixing.

The same map has a different bad2.0 under each protocol, so every table must name its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from recon.evaluation.metrics import measures
from recon.evaluation.regions import repeated, times_smaller
from recon.evaluation.scene import Scene
from recon.types import Array

__all__ = [
    "OFFICIAL_WEIGHTS",
    "PROTOCOLS",
    "REGIONS",
    "Protocol",
    "enlarged",
    "label",
    "protocol_for",
    "score",
    "signed_errors",
]

REGIONS = ("nonocc", "all", "occluded", "edges", "textureless")
"""All that `recon.evaluation.regions` can mark, the most quoted first."""


@dataclass(frozen=True)
class Protocol:
    """What is counted, and in which pixels.

    Attributes:
        name: key in `PROTOCOLS`.
        description: one sentence for the head of a table.
        full_size_px: errors are in pixels of the benchmark's full size; else of the truth's size.
        clip: disparities are brought into the search range before they are compared.
        round_integer_truth: disparities are rounded where the truth was.
        regions: that are reported, those that a scene does not have left out.
        below_px: only true disparities below this are counted, pixels of the truth; None for all.
        weighted: means over scenes take `OFFICIAL_WEIGHTS`.
    """

    name: str
    description: str
    full_size_px: bool = False
    clip: bool = False
    round_integer_truth: bool = False
    regions: tuple[str, ...] = REGIONS
    below_px: float | None = None
    weighted: bool = False


PROTOCOLS: Mapping[str, Protocol] = MappingProxyType(
    {
        protocol.name: protocol
        for protocol in (
            Protocol(
                "official",
                "Middlebury v3: errors in full-size pixels, disparities clipped to the search "
                "range and rounded where the truth is whole, means weighted by scene.",
                full_size_px=True,
                clip=True,
                round_integer_truth=True,
                weighted=True,
            ),
            Protocol(
                "zs-all",
                "Zero-shot tables that count every pixel of known truth, in pixels of the truth's "
                "size, with plain means.",
                regions=("all",),
            ),
            Protocol(
                "zs-noc",
                "Zero-shot tables that count the pixels both cameras see, in pixels of the "
                "truth's size, with plain means.",
                regions=("nonocc",),
            ),
            Protocol(
                "zs-noc192",
                "Zero-shot tables that count the pixels both cameras see at a true disparity below "
                "192, in pixels of the truth's size, with plain means.",
                regions=("nonocc",),
                below_px=192,
            ),
            Protocol(
                "kitti",
                "KITTI: errors in pixels of the photographs, holes counted as wrong, plain means.",
            ),
            Protocol(
                "own-size",
                "No benchmark's rules: errors in pixels of the truth's size, nothing clipped or "
                "rounded, plain means.",
            ),
        )
    }
)
"""Source: official: software and web pages of the benchmark of Scharstein et al., GCPR 2014;
zs-all: the evaluation code of Lipson et al., 3DV 2021 (RAFT-Stereo); zs-noc192: that of Xu et al.,
CVPR 2023 (IGEV); zs-noc: that of Jiang et al., CVPR 2025 (DEFOM-Stereo); kitti: Menze & Geiger,
CVPR 2015, section 5, without its filling of holes."""

OFFICIAL_MEANS: Mapping[str, str] = MappingProxyType(
    {"middlebury-v3": "official", "kitti": "kitti", "": "own-size"}
)
"""Benchmark -> the protocol that "official" stands for."""

OFFICIAL_WEIGHTS: Mapping[str, float] = MappingProxyType(
    {
        "Adirondack": 1.0,
        "ArtL": 1.0,
        "Jadeplant": 1.0,
        "Motorcycle": 1.0,
        "MotorcycleE": 1.0,
        "Piano": 1.0,
        "PianoL": 0.5,
        "Pipes": 1.0,
        "Playroom": 0.5,
        "Playtable": 0.5,
        "PlaytableP": 1.0,
        "Recycle": 1.0,
        "Shelves": 0.5,
        "Teddy": 1.0,
        "Vintage": 0.5,
    }
)
"""Of the training scenes of Middlebury v3 in the benchmark's means."""

SIZES = {1: "", 2: "@H", 4: "@Q"}
"""Letters of the benchmark for truths of half and quarter size."""


def protocol_for(name: str, scene: Scene) -> Protocol:
    """Return the rules that a name stands for on a scene.

    Args:
        name: a key of `PROTOCOLS`; "official" means the rules of the scene's benchmark.
        scene: to be scored.

    Raises:
        ValueError: if there is no such protocol, or no rules for the benchmark.
    """
    if name not in PROTOCOLS:
        raise ValueError(f"unknown protocol {name!r}; there are {', '.join(PROTOCOLS)}")
    if name != "official":
        return PROTOCOLS[name]
    if scene.benchmark not in OFFICIAL_MEANS:
        known = ", ".join(repr(benchmark) for benchmark in OFFICIAL_MEANS)
        raise ValueError(f"no official rules for benchmark {scene.benchmark!r}; there are {known}")
    return PROTOCOLS[OFFICIAL_MEANS[scene.benchmark]]


def label(protocol: Protocol, scene: Scene) -> str:
    """Name a protocol for the head of a table.

    Args:
        protocol: as `protocol_for` gives it.
        scene: that is scored.

    Returns:
        The protocol's name; "official@H" or "official@Q" where the official rules can only be
        approximated because the truth has half or quarter size.
    """
    if not protocol.full_size_px:
        return protocol.name
    smaller = scene.truth.full_px_per_px
    return protocol.name + SIZES.get(smaller, f"@1/{smaller}")


def enlarged(values: Array, shape: tuple[int, int]) -> Array:
    """Bring a disparity map to the size of a truth: nearest neighbour, values times the factor.

    With s the factor, result[y, x] = s values[y div s, x div s].

    Args:
        values: (H, W) pixels.
        shape: (H s, W s) of the truth.

    Raises:
        ValueError: if s is not 1, 2 or 4, or not the same in x and y.
    """
    factor = times_smaller(values.shape, shape, what="disparity map")
    return repeated(values if factor == 1 else values * factor, shape)


def signed_errors(found: Array, scene: Scene, protocol: Protocol) -> Array:
    """Subtract the truth from a disparity map, by the rules of a protocol.

    The map is enlarged, then clipped to [0, n] with n the end of the search range at the size of
    the truth, then rounded (halves up); each only if the protocol asks for it.

    Args:
        found: (H, W) pixels, of the size of the truth or 2 or 4 times smaller; NaN or infinite
            where there is no result.
        scene: that it was computed from.
        protocol: the rules.

    Returns:
        (H, W) float32 of the size of the truth, in the pixels of the protocol, positive where the
        result is too near; NaN where there is no result or the truth is unknown.

    Raises:
        ValueError: if the map cannot be brought to the size of the truth.
    """
    truth = scene.truth
    present = np.where(np.isfinite(found), found, np.nan).astype(np.float32)
    disparity = enlarged(present, truth.disparity.shape)
    if protocol.clip:
        disparity = np.clip(disparity, 0, _search_end_px(scene))
    if protocol.round_integer_truth and truth.integer:
        disparity = _rounded(disparity)
    error = (disparity - truth.disparity) * _px_per_truth_px(scene, protocol)
    return np.asarray(error, dtype=np.float32)


def _search_end_px(scene: Scene) -> int:
    """Return the end of the search range, the benchmark's ndisp, in pixels of the truth.

    The range belongs to the pair, whatever the size of the map: files of results may be smaller.
    """
    image_shape = scene.pair.left.shape[:2]
    factor = times_smaller(image_shape, scene.truth.disparity.shape, what="left image")
    return scene.disparities.stop * factor


def _rounded(disparity: Array) -> Array:
    """Round to whole pixels, halves up, as C's round does above 0; NaN stays."""
    whole = np.floor(disparity)
    return whole + (disparity - whole >= 0.5)


def _px_per_truth_px(scene: Scene, protocol: Protocol) -> int:
    """Return how many pixels of the protocol one pixel of the truth is."""
    return scene.truth.full_px_per_px if protocol.full_size_px else 1


def score(
    found: Array, scene: Scene, protocol: Protocol, masks: Mapping[str, Array]
) -> dict[str, dict[str, float | int | None]]:
    """Measure a disparity map in every region that a protocol reports.

    Args:
        found: (H, W) pixels, of the size of the truth or 2 or 4 times smaller; NaN or infinite
            where there is no result.
        scene: that it was computed from.
        protocol: the rules.
        masks: `regions(scene)`, made once a scene.

    Returns:
        Region -> measures, in the pixels of the protocol; regions without a mask are left out.

    Raises:
        ValueError: if the map cannot be brought to the size of the truth.
    """
    error = np.abs(signed_errors(found, scene, protocol))
    true_disparity = scene.truth.disparity
    truth = true_disparity * _px_per_truth_px(scene, protocol)
    in_range = None if protocol.below_px is None else true_disparity < protocol.below_px
    return {
        region: measures(error, truth, mask if in_range is None else mask & in_range)
        for region in protocol.regions
        if (mask := masks.get(region)) is not None
    }
