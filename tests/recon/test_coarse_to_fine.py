"""A band of candidates for every tile, from a smaller pair."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from calib.pair import RectifiedPair
from calib.rig import RectifiedGeometry
from recon.aggregation import BilateralAggregation, BoxAggregation
from recon.coarse_to_fine import CoarseToFine, both_views_checked
from recon.matcher import Matcher
from recon.matching_cost import Census, LearnedCost
from recon.networks import Architecture, FeatureNetwork, save_features
from recon.observer import ignore
from recon.optimisation import SemiGlobal
from recon.settings import load_preset, overrides_from, preset_names, spelled_out
from recon.strips import GRID_PX, Reach
from recon.tiles import Crops, of_left_view, of_right_view
from recon.types import CostVolume, DisparityMap, PixelStatus

HEIGHT, WIDTH = 160, 320
FAR, NEAR = 20, 60
SQUARE = (slice(50, 110), slice(140, 220))
SEARCHED = range(96)

DIRECT = Matcher(
    Census(5, 5),
    BoxAggregation(radius_px=1),
    SemiGlobal(small_step=0.3, large_step=2.25, across_edge=0.2, directions=4),
)
NARROWED = replace(DIRECT, coarse_to_fine=CoarseToFine())


def pair_of(left, right):
    height, width, _ = left.shape
    centre = (width / 2, height / 2)
    geometry = RectifiedGeometry((width, height), 100.0, centre, centre, 0.1)
    return RectifiedPair(*((255 * i).round().byte().numpy() for i in (left, right)), geometry)


def in_front_of(wall, thing, rows, columns, *, near=NEAR, far=FAR):
    """Put a thing of texture `thing` before a wall; both are larger than the image."""
    left, right = wall[:, :WIDTH].clone(), wall[:, far : far + WIDTH].clone()
    left[rows, columns] = thing[rows, columns]
    right[rows, columns.start - near : columns.stop - near] = thing[rows, columns]
    truth = np.full((HEIGHT, WIDTH), float(far))
    truth[rows, columns] = near
    hidden = np.zeros((HEIGHT, WIDTH), bool)
    hidden[rows, columns.start - (near - far) : columns.start] = True
    hidden[:, :far] = True
    return pair_of(left, right), truth, hidden


def watched(matcher, pair, searched):
    """Match, and return the map with the volumes and maps that observers were told."""
    told = []
    found = matcher(pair, searched, observe=lambda *result: told.append(result))
    return found, told


def map_of(values, matched=None):
    values = torch.as_tensor(values, dtype=torch.float32)
    matched = torch.ones(values.shape, dtype=torch.bool) if matched is None else matched
    status = torch.where(matched, int(PixelStatus.MATCHED), int(PixelStatus.MISMATCHED))
    return DisparityMap(
        values.masked_fill(~matched, torch.nan), status.to(torch.uint8), matched.float()
    )


@pytest.fixture
def scene(smooth_texture):
    wall = smooth_texture(HEIGHT, WIDTH + FAR)
    return in_front_of(wall, 0.6 * smooth_texture(HEIGHT, WIDTH), *SQUARE)


class TestAgainstDirectMatching:
    def test_nearly_all_pixels_get_the_same_disparity(self, scene):
        pair, truth, hidden = scene

        direct, narrowed = DIRECT(pair, SEARCHED), NARROWED(pair, SEARCHED)

        assert (np.abs(narrowed.values - direct.values) <= 1).mean() >= 0.98
        wrong, wrong_directly = (
            (np.abs(found.values - truth) > 1)[~hidden].mean() for found in (narrowed, direct)
        )
        assert wrong <= wrong_directly + 0.002

    def test_both_edges_of_an_object_stay_where_they_are(self, scene):
        pair, truth, _ = scene

        found = NARROWED(pair, SEARCHED).values

        rows = slice(SQUARE[0].start + 5, SQUARE[0].stop - 5)
        for edge in (SQUARE[1].start, SQUARE[1].stop):
            beside = slice(edge - 12, edge + 12)
            off = np.abs(found[rows, beside] - truth[rows, beside]) > 1
            assert off.sum(1).mean() < 3  # columns of 24

    def test_fewer_candidates_are_compared(self, smooth_texture):
        """Where one surface fills the image the band is what the margin makes it."""
        wall = smooth_texture(HEIGHT, WIDTH + FAR)
        pair = pair_of(wall[:, :WIDTH], wall[:, FAR:])

        _, told = watched(NARROWED, pair, SEARCHED)

        pixels_and_candidates = sum(
            result.cost[..., 0].numel() * len(result.disparities)
            for stage, result in told
            if stage.startswith("matching_cost")
        )
        assert pixels_and_candidates < 0.6 * HEIGHT * WIDTH * len(SEARCHED)

    @pytest.mark.parametrize("first", [-40, 7])
    def test_one_tile_over_the_whole_image_is_direct_matching_with_its_band(
        self, smooth_texture, first
    ):
        wall = smooth_texture(HEIGHT, WIDTH + 64)
        truth = 16 + first
        pair = pair_of(wall[:, 32 : 32 + WIDTH], wall[:, 32 + truth : 32 + truth + WIDTH])
        matcher = replace(NARROWED, coarse_to_fine=CoarseToFine(tile_px=WIDTH))

        found, told = watched(matcher, pair, range(first, first + 64))

        bands = [result.disparities for stage, result in told if stage == "matching_cost"]
        assert len(bands) == 1
        assert truth in bands[0]
        assert len(bands[0]) < 40
        direct = DIRECT(pair, bands[0])
        for name in ("values", "status", "confidence"):
            np.testing.assert_array_equal(getattr(found, name), getattr(direct, name))

    def test_bands_that_hold_everything_give_the_same_choice(self, scene):
        """Tiles, crops and both views alone: without paths nothing looks beyond its reach."""
        pair, _, _ = scene
        direct = Matcher(Census(), BilateralAggregation(radius_px=3), filling=None)
        everywhere = CoarseToFine(margin_px=1000)
        narrowed = replace(direct, coarse_to_fine=everywhere, volume_limit_mb=3.0)

        found, told = watched(narrowed, pair, SEARCHED)

        assert len([stage for stage, _ in told if stage == "matching_cost"]) > 4
        whole = direct(pair, SEARCHED)
        np.testing.assert_array_equal(found.status, whole.status)
        # Sums round as a processor takes candidates together; a flat valley shows it magnified.
        apart = np.abs(found.values - whole.values)[~np.isnan(whole.values)]
        assert np.quantile(apart, 0.995) < 1e-4
        assert apart.max() < 0.1
        np.testing.assert_allclose(found.confidence, whole.confidence, atol=1e-4)

    def test_a_network_sees_the_same_in_a_tile(self, scene, tmp_path):
        pair, _, _ = scene
        with torch.random.fork_rng():
            torch.manual_seed(0)
            network = FeatureNetwork(Architecture((8, 8, 8), 1, 8)).eval()
        save_features(tmp_path / "untrained.safetensors", network, about={})
        cost = LearnedCost(str(tmp_path / "untrained.safetensors"))
        direct = Matcher(cost, BoxAggregation(radius_px=1), filling=None)
        narrowed = replace(direct, coarse_to_fine=CoarseToFine(margin_px=1000), volume_limit_mb=3.0)

        found, whole = narrowed(pair, SEARCHED), direct(pair, SEARCHED)

        # Convolutions of another size add in another order: costs near a tie may swap.
        same = np.isclose(found.values, whole.values, atol=1e-3, equal_nan=True)
        assert same.mean() > 0.999

    def test_it_is_deterministic(self, scene):
        pair, _, _ = scene

        one, other = NARROWED(pair, SEARCHED), NARROWED(pair, SEARCHED)

        np.testing.assert_array_equal(one.values, other.values)

    def test_an_image_too_small_to_shrink_is_matched_directly(self, texture):
        image = texture(100, 120)
        pair = pair_of(image, image.roll(-4, dims=1))

        direct = DIRECT(pair, range(12))
        found, told = watched(NARROWED, pair, range(12))

        np.testing.assert_array_equal(found.values, direct.values)
        assert "coarse/left" not in [stage for stage, _ in told]


class TestThinThings:
    """What the small pair does not show is not searched: this is the limit of the method."""

    @pytest.fixture
    def bar(self, smooth_texture, texture):
        def make(width_px):
            columns = slice(200, 200 + width_px)
            wall = smooth_texture(HEIGHT, WIDTH + FAR)
            return in_front_of(wall, texture(HEIGHT, WIDTH), slice(0, HEIGHT), columns), columns

        return make

    def share_found(self, bar, matcher, width_px):
        (pair, truth, _), columns = bar(width_px)
        found = replace(matcher, min_segment_px=0)(pair, SEARCHED).values
        return (np.abs(found - truth)[:, columns] <= 1).mean()

    def test_a_bar_of_four_coarse_pixels_survives(self, bar):
        assert self.share_found(bar, NARROWED, 16) > 0.95

    def test_a_bar_of_two_coarse_pixels_survives_at_half_size(self, bar):
        half = replace(DIRECT, coarse_to_fine=CoarseToFine(shrink=2))

        assert self.share_found(bar, half, 8) > 0.9 * self.share_found(bar, DIRECT, 8)

    def test_a_bar_of_half_a_coarse_pixel_needs_a_margin_that_reaches_it(self, bar):
        reaching = replace(DIRECT, coarse_to_fine=CoarseToFine(margin_px=NEAR - FAR + 2))

        directly = self.share_found(bar, DIRECT, 3)

        assert directly > 0.5
        assert self.share_found(bar, reaching, 3) > 0.9 * directly
        assert self.share_found(bar, NARROWED, 3) < 0.1


class TestTiles:
    REACH = Reach(2, 1, 8)
    SIZE = (640, 1280)
    COARSE = (160, 320)

    def tiles(self, coarse, view="left", settings=None, limit_mb=768.0, searched=SEARCHED):
        return (settings or CoarseToFine()).tiles(
            coarse, view, searched, size=self.SIZE, reach=self.REACH, limit_mb=limit_mb
        )

    def steps(self):
        """A far wall with a near quarter, as a map of a quarter of the size."""
        values = torch.full(self.COARSE, FAR / 4)
        values[:80, 160:] = 80 / 4
        return map_of(values)

    @pytest.mark.parametrize("view", ["left", "right"])
    def test_they_cover_the_view_once(self, view):
        counts = np.zeros(self.SIZE, int)

        for tile in self.tiles(self.steps(), view, CoarseToFine(tile_px=16)):
            counts[tile.rows, tile.columns] += 1

        assert (counts == 1).all()

    def test_the_band_reaches_from_the_lowest_to_the_highest_and_the_margin_beyond(self):
        (tile,) = self.tiles(self.steps(), settings=CoarseToFine(tile_px=1280, margin_px=5))

        assert tile.candidates == range(FAR - 5, 80 + 5 + 1)

    def test_parts_of_one_surface_get_narrow_bands(self):
        settings = CoarseToFine(tile_px=16)

        lengths = [len(tile.candidates) for tile in self.tiles(self.steps(), settings=settings)]

        assert len(lengths) > 1
        assert min(lengths) == 2 * settings.margin_px + 1

    def test_the_band_keeps_to_what_is_searched(self):
        (tile,) = self.tiles(
            self.steps(), settings=CoarseToFine(tile_px=1280), searched=range(15, 70)
        )

        assert tile.candidates == range(15, 70)

    def test_what_is_not_matched_may_be_either_neighbour_or_anything_between(self):
        coarse = self.steps()
        matched = torch.ones_like(coarse.values, dtype=torch.bool)
        matched[:80, 155:165] = False
        settings = CoarseToFine(margin_px=0, least_matched=0.0)
        bounds = settings.bounds(map_of(coarse.values, matched))

        inside = slice(0, 40), slice(632, 648)

        assert settings.candidates(inside, bounds, SEARCHED) == range(FAR, 80 + 1)

    @pytest.mark.parametrize(("matched_rows", "band"), [(0, SEARCHED), (160, range(12, 29))])
    def test_where_too_little_is_matched_everything_is_searched(self, matched_rows, band):
        matched = torch.zeros(self.COARSE, dtype=torch.bool)
        matched[:matched_rows] = True
        matched[0] = True
        coarse = map_of(torch.full(matched.shape, FAR / 4), matched)

        (tile,) = self.tiles(coarse, settings=CoarseToFine(tile_px=1280))

        assert tile.candidates == band

    def test_without_any_match_everything_is_searched(self):
        nothing = torch.zeros(self.COARSE, dtype=torch.bool)

        (tile,) = self.tiles(map_of(nothing, nothing), settings=CoarseToFine(tile_px=1280))

        assert tile.candidates == SEARCHED

    def test_candidates_that_lead_no_column_into_the_other_view_are_left_out(self):
        nothing = torch.zeros(self.COARSE, dtype=torch.bool)
        settings = CoarseToFine(tile_px=20)
        reach = Reach(2, 0, 0)

        def last_candidates(view):
            tiles = settings.tiles(
                map_of(nothing, nothing), view, SEARCHED, size=self.SIZE, reach=reach, limit_mb=0.5
            )
            return [(tile.columns, tile.candidates[-1]) for tile in tiles]

        for columns, last in last_candidates("left"):
            assert last == min(SEARCHED[-1], columns.stop - 1)
        for columns, last in last_candidates("right"):
            assert last == min(SEARCHED[-1], self.SIZE[1] - 1 - columns.start)

    def test_large_volumes_are_cut_down_to_the_smallest_tiles(self):
        everything = CoarseToFine(tile_px=40, margin_px=1000)

        tiles = self.tiles(self.steps(), settings=everything, limit_mb=1e-6)

        assert {tile.columns.stop - tile.columns.start for tile in tiles} == {40}


class TestCosts:
    @pytest.mark.parametrize("searched", [range(-30, 40), range(30, 90), range(-90, -40)], ids=str)
    def test_only_candidates_outside_of_the_other_view_are_missing(self, texture, searched):
        height, width = 32, 200
        views = texture(height, width), texture(height, width)
        nothing = map_of(torch.zeros((8, 50)), torch.zeros((8, 50), dtype=torch.bool))
        reach = Reach(DIRECT.matching_cost.margin_px, DIRECT.aggregation.margin_px, 8)
        settings = CoarseToFine(tile_px=25)
        shapes = {"size": (height, width), "reach": reach, "limit_mb": 0.3}

        for view, match, towards in (("left", of_left_view, -1), ("right", of_right_view, 1)):
            tiles = settings.tiles(nothing, view, searched, **shapes)
            volumes = []

            match(
                DIRECT, views, tiles, reach=reach,
                observe=lambda stage, volume: (
                    volumes.append(volume) if stage.startswith("aggregation") else None  # noqa: B023
                ),
            )  # fmt: skip

            assert len(tiles) == len(volumes) >= 4
            for tile, volume in zip(tiles, volumes, strict=True):
                assert volume.disparities == tile.candidates
                columns = np.arange(tile.columns.start, tile.columns.stop)[:, None]
                partner = columns + towards * np.array(tile.candidates)
                inside = (partner >= 0) & (partner < width)
                assert (volume.cost.isfinite().numpy() == inside).all()

    def test_crops_hold_what_is_asked_and_start_on_the_grid(self):
        width = 333
        for start in range(-60, width + 60, 7):
            for step in (-150, -40, 0, 40, 150):
                left, right = slice(start, start + 50), slice(start + step, start + step + 90)

                crops = Crops.around(left, right, width)

                for crop, part in zip(crops, (left, right), strict=True):
                    assert crop.start % GRID_PX == 0
                    assert set(range(width)[crop]) >= set(range(width)).intersection(
                        range(part.start, part.stop)
                    )
                    assert 0 <= crop.start < crop.stop <= width
                assert crops.left.stop - crops.left.start == crops.right.stop - crops.right.start


class TestCoarseMaps:
    def test_shrinking_is_the_mean_of_squares(self, texture):
        image = texture(10, 13)

        small = CoarseToFine(shrink=4).shrunk(image)

        assert small.shape == (3, 4, 3)
        torch.testing.assert_close(small[1, 2], image[4:8, 8:12].mean((0, 1)))
        torch.testing.assert_close(small[2, 3], image[8:, 12:].mean((0, 1)))

    @pytest.mark.parametrize(
        ("searched", "coarse"),
        [(range(8), range(3)), (range(-5, 1), range(-2, 1)), (range(3, 5), range(2))],
    )
    def test_coarse_candidates_cover_the_fine_ones(self, searched, coarse):
        assert CoarseToFine(shrink=4).shrunk_range(searched) == coarse

    def test_each_view_is_checked_by_the_other(self):
        values = torch.full((4, 30), 5.0)
        wrong = values.clone()
        wrong[:, 20] = 9.0

        left, right = both_views_checked(map_of(values), map_of(wrong), range(12), min_segment_px=0)

        unmatched = [~found.valid for found in (left, right)]
        # Left pixel 25 leads to the wrong one; right pixels beyond 24 lead out of the left view.
        assert unmatched[0].nonzero()[:, 1].unique().tolist() == [0, 1, 2, 3, 4, 25]
        assert unmatched[1].nonzero()[:, 1].unique().tolist() == [20, 25, 26, 27, 28, 29]


class TestObservers:
    def test_they_are_told_the_coarse_maps_and_the_volumes_of_every_tile(self, scene):
        pair, _, _ = scene

        _, told = watched(NARROWED, pair, SEARCHED)

        names = [stage for stage, _ in told]
        assert names[:2] == ["coarse/left", "coarse/right"]
        assert [r.values.shape for _, r in told[:2]] == [(HEIGHT // 4, WIDTH // 4)] * 2
        for suffix in ("", "/right"):
            parts = [r for stage, r in told if stage == f"aggregation{suffix}"]
            assert all(isinstance(part, CostVolume) for part in parts)
            assert sum(part.cost[..., 0].numel() for part in parts) == HEIGHT * WIDTH
            assert names.count(f"matching_cost{suffix}") == len(parts)

    def test_they_change_no_value(self, scene):
        pair, _, _ = scene

        np.testing.assert_array_equal(
            NARROWED(pair, SEARCHED, observe=ignore).values,
            watched(NARROWED, pair, SEARCHED)[0].values,
        )


class TestSettings:
    @pytest.mark.parametrize("name", preset_names())
    def test_it_is_off_in_every_preset_and_can_be_switched_on(self, name):
        on = load_preset(name, overrides_from(None, ["coarse_to_fine=true"]))
        changed = load_preset(name, overrides_from(None, ["coarse_to_fine.shrink=2"]))

        assert load_preset(name).matcher.coarse_to_fine is None
        assert on.matcher.coarse_to_fine == CoarseToFine()
        assert changed.matcher.coarse_to_fine == CoarseToFine(shrink=2)

    def test_it_survives_spelling(self, tmp_path):
        changes = ["coarse_to_fine.shrink=2", "coarse_to_fine.margin_px=11"]
        preset = load_preset("fast", overrides_from(None, changes))
        table = spelled_out(preset)["coarse_to_fine"]
        path = tmp_path / "again.toml"
        lines = [f"{name} = {json.dumps(value)}" for name, value in table.items()]
        path.write_text("\n".join(["[coarse_to_fine]", *lines]))

        again = load_preset("fast", overrides_from(path, []))

        assert again.matcher == preset.matcher

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("shrink=1", r"^coarse_to_fine: shrink must be at least 2, got 1; to match directly"),
            ("margin_px=-1", r"^coarse_to_fine: margin_px must not be negative, got -1 px"),
            ("overlap_px=-1", r"^coarse_to_fine: overlap_px must not be negative, got -1 px"),
            ("tile_px=0", r"^coarse_to_fine: tile_px must be positive, got 0 px"),
            ("least_matched=2", r"^coarse_to_fine: least_matched must be in \[0, 1\], got 2"),
            ("factor=2", r"^unknown setting 'factor' in coarse_to_fine; it has shrink, margin_px"),
        ],
    )
    def test_mistakes_are_named(self, text, message):
        with pytest.raises(ValueError, match=message):
            load_preset("fast", overrides_from(None, [f"coarse_to_fine.{text}"]))
