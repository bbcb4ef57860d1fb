"""The disparities of a view, tile by tile, each tile with candidates of its own."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple, Protocol

import torch
from torch import Tensor

from recon.aggregation import Aggregation
from recon.coarse_to_fine import Tile
from recon.matching_cost import MatchingCost
from recon.observer import Observer
from recon.optimisation import Optimisation
from recon.strips import GRID_PX, Reach, Strip, grown, moved
from recon.types import CostVolume, DisparityMap, PixelStatus

__all__ = ["of_left_view", "of_right_view"]


class Stages(Protocol):
    """The stages that make disparities of two views."""

    @property
    def matching_cost(self) -> MatchingCost:
        """How badly two pixels fit."""
        ...

    @property
    def aggregation(self) -> Aggregation:
        """How the costs around a pixel speak for it."""
        ...

    @property
    def optimisation(self) -> Optimisation:
        """Which candidate a pixel gets."""
        ...


class Crops(NamedTuple):
    """Columns of both views, equally many, so that they can be compared as images.

    They lie within the image: where a crop ends and the image does not, there is context.

    Attributes:
        left: of the left view.
        right: of the right view.
    """

    left: slice
    right: slice

    @classmethod
    def around(cls, left: slice, right: slice, width: int) -> Crops:
        """Return crops that hold these columns, as far as the image has them.

        Args:
            left: of the left view; may leave the image.
            right: of the right view; may leave the image.
            width: of the image.
        """
        within = [grown(part, 0, width) for part in (left, right)]
        starts = [min(part.start, width) // GRID_PX * GRID_PX for part in within]
        wanted = max(part.stop - start for part, start in zip(within, starts, strict=True))
        columns = width - (width - max(wanted, 1)) // GRID_PX * GRID_PX
        first, second = (min(start, width - columns) for start in starts)
        return cls(slice(first, first + columns), slice(second, second + columns))

    def shifted(self, candidates: range) -> range:
        """Return the candidates in columns of the crops."""
        step = self.right.start - self.left.start
        return range(candidates.start + step, candidates.stop + step)


def of_left_view(
    stages: Stages,
    views: tuple[Tensor, Tensor],
    tiles: Iterable[Tile],
    *,
    reach: Reach,
    observe: Observer,
) -> DisparityMap[Tensor]:
    """Match the tiles of the left view.

    Args:
        stages: what is done with each.
        views: left and right, (H, W, 3) in [0, 1].
        tiles: that cover the left view.
        reach: of the stages; how far `optimisation` looks may be less than it wants.
        observe: told the volumes of each tile, that of the matching cost with what overlaps.
    """
    left, _ = views
    height, width, _ = left.shape
    result = _nothing_yet(left)
    for tile in tiles:
        rows = Strip.around(tile.rows, height, reach)
        columns = Strip.around(tile.columns, width, reach)
        here, band = columns.seen, tile.candidates
        crops = Crops.around(here, slice(here.start - band[-1], here.stop - band[0]), width)
        volume = _costs(stages, views, rows, crops, band)
        inside = moved(columns.costs, here.start - crops.left.start)
        volume = replace(volume, cost=volume.cost[:, inside].contiguous(), disparities=band)
        origin = rows.first_cost, columns.first_cost
        observe("matching_cost", replace(volume, origin=origin))
        guide = left[rows.seen, crops.left][rows.costs, inside]
        volume = stages.aggregation(volume, guide=guide)
        chosen = rows.chosen, columns.chosen
        volume = replace(volume, cost=volume.cost[chosen].contiguous())
        origin = tile.rows.start, tile.columns.start
        cost = volume.cost[rows.result, columns.result]
        observe("aggregation", replace(volume, cost=cost, origin=origin))
        found = stages.optimisation(volume, guide=guide[chosen])
        _put(found, (rows.result, columns.result), result, (tile.rows, tile.columns))
        del volume  # before the next tile takes as much again
    return result


def of_right_view(
    stages: Stages,
    views: tuple[Tensor, Tensor],
    tiles: Iterable[Tile],
    *,
    reach: Reach,
    observe: Observer,
) -> DisparityMap[Tensor]:
    """Match the tiles of the right view; as everywhere the left view guides the aggregation.

    Args:
        stages: what is done with each.
        views: left and right, (H, W, 3) in [0, 1].
        tiles: that cover the right view.
        reach: see `of_left_view`.
        observe: told the volumes of each tile, under names of their own.
    """
    left, right = views
    height, width, _ = right.shape
    result = _nothing_yet(right)
    for tile in tiles:
        rows = Strip.around(tile.rows, height, reach)
        columns = Strip.around(tile.columns, width, reach)
        here, band = columns.seen, tile.candidates
        crops = Crops.around(slice(here.start + band[0], here.stop + band[-1]), here, width)
        volume = _costs(stages, views, rows, crops, band)
        origin = rows.first_cost, crops.left.start
        observe("matching_cost/right", replace(volume, disparities=band, origin=origin))
        guide = left[rows.seen, crops.left][rows.costs]
        volume = stages.aggregation(volume, guide=guide)
        volume = replace(volume, cost=volume.cost[rows.chosen]).seen_from_right()
        chosen = grown(tile.columns, reach.optimisation, width)
        inside = moved(chosen, -crops.right.start)
        volume = replace(volume, cost=volume.cost[:, inside].contiguous(), disparities=band)
        origin = tile.rows.start, tile.columns.start
        cost = volume.cost[rows.result, columns.result]
        observe("aggregation/right", replace(volume, cost=cost, origin=origin))
        guide = right[rows.seen][rows.costs][rows.chosen][:, chosen]
        found = stages.optimisation(volume, guide=guide)
        _put(found, (rows.result, columns.result), result, (tile.rows, tile.columns))
        del volume  # before the next tile takes as much again
    return result


def _costs(
    stages: Stages, views: tuple[Tensor, Tensor], rows: Strip, crops: Crops, band: range
) -> CostVolume:
    """Return the costs of a tile, its candidates in columns of the crops."""
    left, right = views[0][rows.seen, crops.left], views[1][rows.seen, crops.right]
    return stages.matching_cost(left, right, crops.shifted(band), rows=rows.costs)


def _nothing_yet(view: Tensor) -> DisparityMap[Tensor]:
    """Return a map of a view without any disparity."""
    values = view.new_full(view.shape[:2], float("nan"))
    status = torch.full_like(values, int(PixelStatus.OUTSIDE), dtype=torch.uint8)
    return DisparityMap(values, status, torch.zeros_like(values))


def _put(
    found: DisparityMap[Tensor],
    source: tuple[slice, slice],
    result: DisparityMap[Tensor],
    target: tuple[slice, slice],
) -> None:
    """Write a part of a map of a tile into its place of the whole, in place."""
    for name in ("values", "status", "confidence"):
        getattr(result, name)[target] = getattr(found, name)[source]
