"""Which pixels are probed, and that what is drawn of them is what the volumes held."""

import dataclasses

import numpy as np
import pytest
import torch
from rendered import QUICK, SEARCHED, still_life
from rerun.chunk import RrdReader

from recon import reconstruct
from recon.aggregation import BoxAggregation
from recon.coarse_to_fine import CoarseToFine
from recon.matcher import Matcher
from recon.matching_cost import Census
from recon.settings import load_preset
from recon.types import CostVolume, DisparityMap, PixelStatus
from recon.viewer import RerunObserver
from recon.viewer.probing import CurveSamples, choose_probes, lattice

WANTED = ((120, 40), (31, 77))


def logged(recording, path):
    """Return what was logged at a path, a dictionary of components a row."""
    chunks = RrdReader(recording).store().stream().to_chunks()
    return [
        row
        for chunk in chunks
        if chunk.entity_path == path
        for row in chunk.to_record_batch().to_pylist()
    ]


@pytest.fixture
def quick(tmp_path):
    (tmp_path / "quick.toml").write_text(QUICK)
    return load_preset(str(tmp_path / "quick.toml"))


class Volumes:
    """An observer that keeps every volume."""

    def __init__(self):
        self.kept = []

    def __call__(self, stage, result):
        if isinstance(result, CostVolume):
            self.kept.append((stage, result))

    def curve(self, stage, x, y):
        """Return the candidates and costs of a pixel, of the last volume that has it."""
        for name, volume in reversed(self.kept):
            top, left = volume.origin
            height, width, _ = volume.cost.shape
            if name == stage and top <= y < top + height and left <= x < left + width:
                return np.array(volume.disparities), volume.cost[y - top, x - left].numpy()
        raise AssertionError("no volume has this pixel")


def charts(recording, name):
    """Return abscissa and heights of the bars of a probe, by stage."""
    found = {}
    for place, stage in enumerate(("matching_cost", "aggregation", "result"), start=1):
        for row in logged(recording, f"/probes/{name}/{place}_{stage}"):
            abscissa, heights = (
                np.array(row[f"BarChart:{what}"][0]["buffer"]) for what in ("abscissa", "values")
            )
            found[stage] = abscissa, heights, row["stage"]
    return found


def reconstructed(recording, preset, **how):
    """Reconstruct the still life with a recording, and return volumes and result."""
    volumes = Volumes()
    with RerunObserver(save=recording, probes=WANTED) as observer:

        def observe(stage, result):
            volumes(stage, result)
            observer(stage, result)

        result = reconstruct(
            still_life().pair, preset, disparities=SEARCHED, observe=observe, **how
        )
    return volumes, result


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"volume_limit_mb": 0.4},
        {"coarse_to_fine": CoarseToFine(shrink=2), "volume_limit_mb": 0.2},
    ],
    ids=["whole", "strips", "tiles"],
)
def test_the_bars_are_the_costs_in_the_volumes(quick, tmp_path, how):
    matcher = dataclasses.replace(quick.matcher, **how)

    volumes, result = reconstructed(tmp_path / "a.rrd", dataclasses.replace(quick, matcher=matcher))

    assert len({stage for stage, _ in volumes.kept if not stage.endswith("/right")}) == 2
    for x, y in WANTED:
        drawn = charts(tmp_path / "a.rrd", f"asked_{x}_{y}")
        for stage in ("matching_cost", "aggregation"):
            candidates, costs = volumes.curve(stage, x, y)
            present = np.isfinite(costs)
            np.testing.assert_array_equal(drawn[stage][0], candidates[present])
            np.testing.assert_array_equal(drawn[stage][1], costs[present].astype(np.float64))
        assert drawn["matching_cost"][2] < drawn["aggregation"][2] < drawn["result"][2]
        np.testing.assert_allclose(drawn["result"][0], [result.disparity.values[y, x]])


def test_probes_lie_on_their_pixels_in_both_pictures_and_in_space(quick, tmp_path):
    _, result = reconstructed(tmp_path / "a.rrd", quick)

    def places(path, kind):
        (row,) = logged(tmp_path / "a.rrd", path)
        names = row[f"{kind}:labels"]
        return dict(zip(names, np.array(row[f"{kind}:positions"]), strict=True))

    left = places("/world/left/probes", "Points2D")
    right = places("/world/right/probes", "Points2D")
    space = places("/world/probes", "Points3D")
    geometry = result.pair.geometry
    assert {"asked_120_40", "textured"} <= set(left)
    for name, (x, y) in left.items():
        column, row = int(x), int(y)
        value = result.disparity.values[row, column]
        np.testing.assert_allclose(right[name], [x - value, y], atol=1e-4)
        depth = result.depth[row, column]
        (cx, cy), f = geometry.centre_left, geometry.focal_px
        point = [(column - cx) * depth / f, (row - cy) * depth / f, depth]
        np.testing.assert_allclose(space[name], point, rtol=1e-5)


def test_a_pixel_outside_is_refused_before_anything_is_matched(tmp_path):
    with (
        pytest.raises(ValueError, match=r"probed pixel 200,3 lies outside .* 200 x 100 px"),
        RerunObserver(save=tmp_path / "a.rrd", probes=[(200, 3)]) as observe,
    ):
        observe("input/rectified", still_life().pair)


HEIGHT, WIDTH, COUNT = 60, 90, 24


def a_scene():
    """Return image, map and curves: one pixel of each kind stands out."""
    random = np.random.default_rng(3)
    image = np.full((HEIGHT, WIDTH, 3), 120, np.uint8)
    image[:, 45:] = random.integers(0, 256, (HEIGHT, 45, 1))
    values = np.full((HEIGHT, WIDTH), 5.0, np.float32)
    values[40:, :] = 15
    status = np.full((HEIGHT, WIDTH), PixelStatus.MATCHED, np.uint8)
    status[:, :8] = PixelStatus.FILLED_OCCLUSION  # the border is not what is meant
    status[5:25, 20:32] = PixelStatus.FILLED_OCCLUSION
    cost = np.ones((HEIGHT, WIDTH, COUNT), np.float32)
    cost += random.uniform(0, 0.05, cost.shape).astype(np.float32)
    cost[..., 5] = 0.1
    cost[10:30, 70:80, 17] = 0.12  # nearly as low, elsewhere
    return image, DisparityMap(values, status, np.ones_like(values)), cost


def chosen_in(image, disparity, cost):
    volume = CostVolume(torch.from_numpy(cost), range(COUNT))
    samples = CurveSamples.of(volume, np.arange(1, HEIGHT, 3), np.arange(1, WIDTH, 3))
    return {probe.name: probe for probe in choose_probes(image, disparity, [samples])}


def test_each_kind_of_pixel_is_found():
    chosen = chosen_in(*a_scene())

    assert list(chosen) == ["textured", "textureless", "depth_edge", "occluded", "repeated"]
    assert chosen["textured"].x >= 45
    assert not (chosen["textured"].x in range(70, 80) and chosen["textured"].y in range(10, 30))
    assert chosen["textureless"].x < 45
    assert abs(chosen["depth_edge"].y - 39.5) < 3
    assert chosen["occluded"].x in range(22, 30)
    assert chosen["occluded"].y in range(7, 23)
    assert chosen["repeated"].x in range(70, 80)
    assert chosen["repeated"].y in range(10, 30)


def test_a_kind_that_is_missing_is_left_out():
    image, disparity, cost = a_scene()
    flat = DisparityMap(
        np.full_like(disparity.values, 5),
        np.full_like(disparity.status, PixelStatus.MATCHED),
        disparity.confidence,
    )

    assert {"depth_edge", "occluded"}.isdisjoint(chosen_in(image, flat, cost))


def test_a_volume_without_any_cost_gives_no_second_minimum():
    volume = CostVolume(torch.full((40, 50, 6), float("inf")), range(6))
    rows, columns = lattice(50, 40)
    image = np.zeros((40, 50, 3), np.uint8)
    nothing = np.full((40, 50), np.nan, np.float32)
    disparity = DisparityMap(nothing, np.zeros((40, 50), np.uint8), np.zeros_like(nothing))

    assert choose_probes(image, disparity, [CurveSamples.of(volume, rows, columns)]) == []
    assert choose_probes(image, disparity, []) == []


@pytest.mark.parametrize("size", [(1440, 1000), (200, 100), (3, 2)])
def test_the_lattice_has_few_pixels_all_of_them_in_the_picture(size):
    rows, columns = lattice(*size)

    assert 0 < len(rows) * len(columns) <= 4500
    assert rows.max() < size[1]
    assert columns.max() < size[0]


def test_observers_are_told_where_strips_and_tiles_begin():
    pair = still_life().pair
    whole, strips, tiles = Volumes(), Volumes(), Volumes()
    matcher = Matcher(Census(), BoxAggregation(radius_px=2))
    matcher(pair, SEARCHED, observe=whole)
    dataclasses.replace(matcher, volume_limit_mb=0.4)(pair, SEARCHED, observe=strips)
    by_tiles = dataclasses.replace(
        matcher, coarse_to_fine=CoarseToFine(shrink=2), volume_limit_mb=0.2
    )
    by_tiles(pair, SEARCHED, observe=tiles)

    assert len(strips.kept) > 4
    assert len(tiles.kept) > 4
    for seen in (strips, tiles):
        for stage, volume in seen.kept:
            if stage not in ("matching_cost", "aggregation"):
                continue
            (top, left), (height, width, _) = volume.origin, volume.cost.shape
            (_, full), first = next(item for item in whole.kept if item[0] == stage), 0
            first = volume.disparities[0] - full.disparities[0]
            same = full.cost[
                top : top + height, left : left + width, first : first + len(volume.disparities)
            ]
            both = torch.isfinite(same) & torch.isfinite(volume.cost)
            inside = both[8:-8, 8:-8] if stage == "aggregation" else both
            assert torch.isfinite(volume.cost).any()
            ours, theirs = volume.cost, same
            if stage == "aggregation":
                ours, theirs = ours[8:-8, 8:-8], theirs[8:-8, 8:-8]
            torch.testing.assert_close(ours[inside], theirs[inside], rtol=1e-4, atol=1e-4)
