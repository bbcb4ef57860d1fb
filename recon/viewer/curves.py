"""Drawing the costs of probed pixels, when the volumes that held them are long freed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
import rerun as rr

from calib.pair import RectifiedPair
from recon.types import Array, CostVolume, DisparityMap
from recon.viewer.charts import cost_bars, result_bar
from recon.viewer.drawing import WORLD, Drawing
from recon.viewer.probing import Curve, CurveSamples, Probe, choose_probes, lattice
from recon.viewer.thinning import as_numpy

__all__ = ["PROBES", "STAGES_WITH_CURVES", "CurveKeeper"]

PROBES = "/probes"
STAGES_WITH_CURVES = ("matching_cost", "aggregation")
PLACES = {"matching_cost": "1_matching_cost", "aggregation": "2_aggregation"}
RESULT = "3_result"
"""Bars are drawn in the order of their names, later ones in front."""

COLOURS = ((232, 66, 66), (40, 130, 230), (250, 190, 30), (160, 80, 200), (30, 170, 110))


Colour = tuple[int, int, int]
T = TypeVar("T")


class Kept(NamedTuple):
    """Curves of one volume.

    Attributes:
        stage: that made it.
        step: place of the stage on the timeline.
        samples: of the lattice, then of every pixel that was asked for.
    """

    stage: str
    step: int
    samples: list[CurveSamples]


class CurveKeeper:
    """Keep the curves of a lattice of pixels, and of the pixels that somebody asks for.

    Attributes:
        probes: those that are drawn; chosen by `choose`.
    """

    def __init__(self, wanted: Sequence[tuple[int, int]] = ()) -> None:
        """Start without curves.

        Args:
            wanted: columns and rows of pixels of the left view that are shown in any case.
        """
        self.probes: list[Probe] = [
            Probe(f"asked_{x}_{y}", x, y, "asked for") for x, y in dict.fromkeys(wanted)
        ]
        self._pair: RectifiedPair | None = None
        self._kept: list[Kept] = []

    def look_at(self, pair: RectifiedPair) -> None:
        """Begin with a pair.

        Raises:
            ValueError: if a pixel that was asked for lies outside it.
        """
        width, height = pair.geometry.size
        for probe in self.probes:
            if not (0 <= probe.x < width and 0 <= probe.y < height):
                raise ValueError(
                    f"probed pixel {probe.x},{probe.y} lies outside the rectified left picture of "
                    f"{width} x {height} px; columns go from 0 to {width - 1}, rows from 0 to "
                    f"{height - 1}"
                )
        self._pair = pair

    def keep(self, stage: str, step: int, volume: CostVolume) -> None:
        """Copy what is needed of a volume of the left view.

        Args:
            stage: that made it; others than `STAGES_WITH_CURVES` are ignored.
            step: place of the stage on the timeline.
            volume: whole, or of a strip or tile.
        """
        if stage not in STAGES_WITH_CURVES or volume.of_right or self._pair is None:
            return
        crossings = [lattice(*self._pair.geometry.size)]
        crossings += [(np.array([probe.y]), np.array([probe.x])) for probe in self.probes]
        samples = [CurveSamples.of(volume, *crossing) for crossing in crossings]
        self._kept.append(Kept(stage, step, samples))

    def choose(self, disparity: DisparityMap[Array]) -> None:
        """Choose more probes by what came out.

        Args:
            disparity: (H, W), the result.
        """
        if self._pair is None:
            return
        first = STAGES_WITH_CURVES[0]
        samples = [kept.samples[0] for kept in self._kept if kept.stage == first]
        self.probes += choose_probes(self._pair.left, disparity, samples)

    def charts(self, disparity: DisparityMap[Array], step: int) -> Iterator[tuple[int, Drawing]]:
        """Draw the curves of the probes and where they ended.

        Args:
            disparity: (H, W), the result.
            step: place of the result on the timeline.

        Yields:
            A place on the timeline and what to draw there.
        """
        for probe in self.probes:
            highest = 0.0
            for kept in self._kept:
                curve = _curve_at(kept.samples, probe)
                bars = None if curve is None else cost_bars(curve, kept.stage)
                if curve is not None and bars is not None:
                    highest = max(highest, float(curve.costs[np.isfinite(curve.costs)].max()))
                    yield kept.step, [(f"{PROBES}/{probe.name}/{PLACES[kept.stage]}", bars)]
            value = float(disparity.values[probe.y, probe.x])
            if np.isfinite(value) and highest:
                yield step, [(f"{PROBES}/{probe.name}/{RESULT}", result_bar(value, highest))]

    def marks(self, disparity: DisparityMap[Array], thinned_by: int) -> Drawing:
        """Draw the probes into both photographs and the scene.

        Args:
            disparity: (H, W), the result.
            thinned_by: pixels of the pair in one pixel of the pictures.
        """
        if self._pair is None or not self.probes:
            return []
        pixels = np.array([(probe.x, probe.y) for probe in self.probes], dtype=np.float64)
        found = as_numpy(disparity.values)[pixels[:, 1].astype(int), pixels[:, 0].astype(int)]
        names = [probe.name for probe in self.probes]
        colours = [COLOURS[number % len(COLOURS)] for number in range(len(names))]
        known = np.isfinite(found)
        geometry = self._pair.geometry
        matches = pixels - np.stack([np.where(known, found, 0), np.zeros(len(found))], axis=1)
        depth = geometry.focal_px * geometry.baseline_m
        depth = depth / np.maximum(found - geometry.disparity_at_infinity, 1e-3)
        rays = (pixels - np.array(geometry.centre_left)) / geometry.focal_px
        points = np.concatenate([rays, np.ones((len(rays), 1))], axis=1) * depth[:, None]

        return [
            (
                f"{WORLD}/left/probes",
                _marks(rr.Points2D, pixels / thinned_by + 0.5, names, colours),
            ),
            *(
                (path, _marks(kind, places[known], _those(names, known), _those(colours, known)))
                for path, kind, places in (
                    (f"{WORLD}/right/probes", rr.Points2D, matches / thinned_by + 0.5),
                    (f"{WORLD}/probes", rr.Points3D, points),
                )
            ),
        ]


def _marks(
    kind: type[rr.Points2D | rr.Points3D], places: Array, names: list[str], colours: list[Colour]
) -> rr.AsComponents:
    """Return points with names."""
    radii = rr.Radius.ui_points(5)
    marks: rr.AsComponents = kind(
        places, labels=names, colors=colours, show_labels=True, radii=radii
    )
    return marks


def _those(items: list[T], which: Array) -> list[T]:
    return [item for item, take in zip(items, which, strict=True) if take]


def _curve_at(samples: list[CurveSamples], probe: Probe) -> Curve | None:
    """Return the curve of a probe, None if these samples do not have it."""
    found = (part.at(probe.x, probe.y) for part in samples)
    return next((curve for curve in found if curve is not None), None)
