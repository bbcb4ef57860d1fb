"""What the cameras of a pair do differently leaves its truth true."""

import cv2
import numpy as np
import pytest
import torch
from rendered import VIEW, still_life_sample
from test_scenes import away_from_edges, sampled_at

from recon.training.augmentation import Augmentation, Pairs
from recon.training.misalignment import displaced, zoomed
from recon.training.photometry import (
    blurred,
    compressed,
    saturated,
    sensed,
    toned,
    uneven,
    vignetted,
)
from recon.training.recipe import Recipe
from recon.training.scenes import draw

ONLY_OCCLUDERS = Augmentation(photometric=False, geometric=False, covered=1.0)
ONLY_GEOMETRY = Augmentation(photometric=False, occluders=False)
NOTHING = Augmentation(photometric=False, geometric=False, occluders=False)


@pytest.fixture(scope="module")
def pairs():
    """The still life, three times."""
    sample = still_life_sample(2)
    views = [view.permute(2, 0, 1)[None].repeat(3, 1, 1, 1) for view in (sample.left, sample.right)]
    truth = [part[None].repeat(3, 1, 1) for part in (sample.disparity_left, sample.visible)]
    return Pairs(*views, *truth)


@pytest.fixture
def views(generator):
    return torch.rand(3, 3, 20, 30, generator=generator)


def value(number, count=1):
    return torch.full((count, 1, 1, 1), number)


def seeded(seed=4):
    return torch.Generator().manual_seed(seed)


@pytest.mark.parametrize("size", [(20, 30), (16, 8), (5, 3)])
def test_a_pair_stays_a_pair_of_images_and_the_given_one_is_left_alone(size, generator):
    left, right = (torch.rand(3, 3, *size, generator=generator) for _ in range(2))
    before = left.clone()

    for seed in range(5):
        changed = Augmentation()(left, right, seeded(seed))

        for view in changed:
            assert view.shape == left.shape
            assert view.dtype == torch.float32
            assert view.min() >= 0
            assert view.max() <= 1
        assert torch.equal(left, before)
        assert not torch.equal(changed[0], left)


@pytest.mark.parametrize("call", [lambda a, p, g: a(p.left, p.right, g), Augmentation.whole])
def test_the_same_seed_changes_in_the_same_way_and_another_in_another(call, pairs):
    torch.manual_seed(0)
    one = call(Augmentation(), pairs, seeded())
    torch.manual_seed(1)
    same, other = (call(Augmentation(), pairs, seeded(seed)) for seed in (4, 5))

    assert all(torch.equal(a, b) for a, b in zip(one, same, strict=True))
    assert not torch.equal(one[0], other[0])


def test_everything_can_be_switched_off(pairs):
    changed = NOTHING.whole(pairs, seeded())

    assert all(torch.equal(a, b) for a, b in zip(changed, pairs, strict=True))


def test_light_and_sharpness_leave_the_truth_alone(pairs):
    changed = Augmentation(geometric=False, occluders=False).whole(pairs, seeded())

    assert torch.equal(changed.disparity, pairs.disparity)
    assert torch.equal(changed.visible, pairs.visible)
    assert not torch.equal(changed.right, pairs.right)


class TestGeometry:
    def test_columns_stay_where_they_are(self, views):
        across = torch.linspace(0, 1, 30).expand(3, 3, 20, 30)
        rows = torch.tensor([[0.6, 0.6, 0.6]]).repeat(3, 1)

        assert torch.allclose(displaced(across, rows, torch.zeros(3, 2)), across, atol=1e-6)

    def test_rows_move_down_by_shift_turn_and_stretch(self):
        down = torch.arange(20.0)[:, None].expand(1, 3, 20, 31).contiguous()
        x, y = torch.linspace(-1, 1, 31), torch.linspace(-1, 1, 20)[:, None]
        shift, turn, stretch = 0.5, 0.3, -0.2

        moved = displaced(down, torch.tensor([[shift, turn, stretch]]), torch.zeros(1, 2))

        expected = down - (shift + turn * x + stretch * y)
        assert torch.allclose(moved[..., 2:-2, :], expected[..., 2:-2, :], atol=1e-4)

    def test_red_and_blue_move_apart_and_green_stays(self):
        across = torch.arange(30.0).expand(1, 3, 20, 30).contiguous()

        red, green, blue = displaced(across, torch.zeros(1, 3), torch.tensor([[0.3, 0.0]]))[0]

        inner = (slice(None), slice(2, -2))
        assert torch.allclose(red[inner], across[0, 0][inner] - 0.3, atol=1e-4)
        assert torch.allclose(green, across[0, 0], atol=1e-4)
        assert torch.allclose(blue[inner], across[0, 0][inner] + 0.3, atol=1e-4)

    def test_errors_of_rectification_grow_with_the_width_and_spare_the_left_view(self):
        """About 0.6 px at a width of 416."""
        moves = {}
        for width in (208, 832):
            down = torch.arange(40.0)[:, None].expand(8, 3, 40, width) / 40
            augmentation = Augmentation(photometric=False, most_colours_px=0.0, most_zoom=1.0)
            left, right = augmentation(down, down, seeded())
            assert torch.allclose(left, down, atol=1e-5)
            moves[width] = 40 * (right - down)[:, :, 10:-10].abs().amax()

        assert moves[832] == pytest.approx(4 * float(moves[208]), rel=0.01)
        assert 0.3 < moves[832] / 2 < 1.8  # three parts, each of up to 0.6

    def test_an_enlarged_pair_is_still_told_by_its_truth(self, pairs):
        scale = torch.tensor([[1.0, 1.0], [1.25, 1.1], [1.1, 1.25]])
        start = torch.tensor([[0.5, 0.5], [0.0, 1.0], [0.7, 0.2]])

        larger = zoomed(pairs, scale, start)

        assert torch.allclose(larger.disparity[0], pairs.disparity[0], atol=1e-4)
        assert torch.equal(larger.visible[0], pairs.visible[0])
        for left, right, disparity, visible in zip(*larger, strict=True):
            left, right = left.permute(1, 2, 0), right.permute(1, 2, 0)
            warped = sampled_at(right, torch.arange(VIEW.width) - disparity)
            judged = visible & away_from_edges(disparity)
            error = (warped - left).abs().mean(-1)[judged].mean()
            assert judged.float().mean() > 0.5
            assert error < 0.04
            assert error < 0.3 * (right - left).abs().mean(-1)[judged].mean()

    def test_enlarging_mixes_no_two_surfaces(self, pairs):
        """Between a near and a far surface there is nothing."""
        step = torch.full((1, 40, 60), 5.0)
        step[..., 30:] = 20.0
        blank = torch.zeros(1, 3, 40, 60)
        scale, start = torch.tensor([[1.25, 1.1]]), torch.tensor([[0.4, 0.5]])

        larger = zoomed(Pairs(blank, blank, step, step > 0), scale, start)

        assert larger.disparity.unique().tolist() == [6.25, 25.0]

    def test_the_part_that_is_enlarged_lies_where_it_is_said_to(self):
        across = torch.arange(100.0).expand(1, 3, 50, 100)
        down = torch.arange(50.0)[:, None].expand(1, 3, 50, 100)
        truth = torch.zeros(1, 50, 100)
        scale, start = torch.full((1, 2), 1.25), torch.tensor([[1.0, 0.0]])

        larger = zoomed(Pairs(across, down, truth, truth == 0), scale, start)

        columns, rows = larger.left[0, 0, 0], larger.right[0, 0, :, 0]
        assert columns[0] == pytest.approx(19.9, abs=1e-3)  # pixel centres: (0.5 / 1.25) + 19.5
        assert columns[-1] == pytest.approx(99, abs=0.2)
        assert rows[0] == pytest.approx(0, abs=0.2)
        assert rows[-1] == pytest.approx(39.1, abs=1e-3)

    def test_what_an_enlarged_right_view_has_lost_is_not_visible(self, pairs):
        scale, start = torch.full((3, 2), 1.25), torch.ones(3, 2)

        larger = zoomed(pairs, scale, start)

        partner = torch.arange(VIEW.width) - larger.disparity
        assert not larger.visible[partner < 0].any()
        assert larger.visible.float().mean() > 0.5

    def test_zoom_reaches_its_limit_and_never_shrinks(self, pairs):
        grown = [
            ONLY_GEOMETRY.whole(pairs, seeded(seed)).disparity.amax((1, 2)) for seed in range(20)
        ]

        factors = torch.cat(grown) / pairs.disparity.amax((1, 2))[0]
        assert factors.max() <= 1.251
        assert factors.max() > 1.15


class TestOccluders:
    def test_covered_pixels_and_only_they_are_not_visible(self, pairs):
        sides = set()
        for seed in range(6):
            changed = ONLY_OCCLUDERS.whole(pairs, seeded(seed))

            in_left = (changed.left != pairs.left).any(1)
            in_right = (changed.right != pairs.right).any(1)
            sides |= {
                (bool(a.any()), bool(b.any())) for a, b in zip(in_left, in_right, strict=True)
            }
            column = torch.arange(VIEW.width) - pairs.disparity
            landed = in_right.float().gather(2, column.round().long().clamp_min(0)) > 0
            lost = pairs.visible & ~changed.visible
            assert torch.equal(changed.disparity, pairs.disparity)
            assert not changed.visible[in_left].any()
            assert not (changed.visible & ~pairs.visible).any()
            expected = pairs.visible & (in_left | landed)
            # half a pixel of the outline is rounded away
            assert (lost != expected).float().mean() < 0.01
            assert (lost & expected).sum() > 0.7 * expected.sum()
        assert {(True, False), (False, True)} <= sides
        assert (True, True) not in sides

    def test_a_set_share_of_the_pairs_is_covered(self, pairs):
        few = Augmentation(photometric=False, geometric=False, covered=0.2)

        changed = [few.whole(pairs, seeded(seed)) for seed in range(60)]

        covered = [
            bool((one.left[i] != pairs.left[i]).any() or (one.right[i] != pairs.right[i]).any())
            for one in changed
            for i in range(3)
        ]
        assert 0.1 < np.mean(covered) < 0.3


class TestPhotometry:
    @pytest.mark.parametrize(("colourful", "error"), [(False, 0.45), (True, 1.2)])
    @pytest.mark.parametrize("quality", [30, 60, 90])
    def test_quantised_pictures_are_those_of_a_jpeg_file(self, quality, colourful, error):
        """cv2.imencode(".jpg", image, [quality, 4:4:4]) is the reference, in whole numbers.

        It rounds before the transform too: each of the three channels of a coloured picture.
        """
        image = (still_life_sample(1).left * 255).round().byte()
        image = image if colourful else image[..., 1:2].expand(-1, -1, 3).contiguous()
        flags = [cv2.IMWRITE_JPEG_QUALITY, quality]
        flags += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
        _, contents = cv2.imencode(".jpg", image.numpy()[..., ::-1], flags)
        reference = cv2.imdecode(contents, cv2.IMREAD_COLOR)[..., ::-1].astype(np.float32)

        view = image.permute(2, 0, 1)[None].float() / 255
        found = 255 * compressed(view, torch.tensor([float(quality)]))

        found = found[0].permute(1, 2, 0).numpy()
        assert np.abs(found - reference).mean() < error < np.abs(reference - image.numpy()).mean()

    def test_noise_grows_with_the_root_of_the_brightness(self, generator):
        noise = torch.randn(1, 3, 200, 200, generator=generator)

        dark, bright = (
            (sensed(torch.full_like(noise, tone), noise, value(0.02)) - tone).std()
            for tone in (0.1, 0.8)
        )

        assert bright / dark == pytest.approx(((0.15 + 0.68) / (0.15 + 0.085)) ** 0.5, rel=0.02)

    def test_blur_spreads_a_dot_by_its_standard_deviation(self):
        dot = torch.zeros(2, 3, 21, 21)
        dot[..., 10, 10] = 1.0

        spread = blurred(dot, torch.tensor([0.3, 1.4])[:, None, None, None])

        place = torch.arange(21.0) - 10
        variances = (spread[:, 0].sum(1) * place**2).sum(1)
        assert torch.allclose(spread.sum((2, 3)), torch.ones(2, 3))
        assert variances[0] < 0.1
        assert variances[1] == pytest.approx(1.4**2, rel=0.05)

    def test_a_tone_is_a_gain_for_each_channel_and_a_gamma(self):
        tone = torch.log(torch.tensor([0.5, 1.0, 2.0, 2.0]))[None, :, None, None]

        changed = toned(torch.full((1, 3, 1, 1), 0.4), tone).flatten()

        assert changed.tolist() == pytest.approx([0.04, 0.16, 0.64])

    def test_corners_lose_the_whole_share_and_the_middle_nothing(self):
        bright = vignetted(torch.ones(1, 3, 21, 31), value(0.4))[0, 0]

        assert bright[10, 15] == 1
        assert bright[0, 0] == pytest.approx(0.6)
        assert bright[0, 15] == pytest.approx(0.8)

    def test_uneven_light_is_smooth_and_of_its_coarse_values_at_the_corners(self):
        coarse = torch.tensor([[0.2, -0.2], [0.0, 0.1]])[None, None]

        field = uneven(torch.full((1, 3, 40, 60), 0.5), coarse)[0, 0] / 0.5

        assert field[0, 0].log() == pytest.approx(0.2, abs=1e-3)
        assert field[0, -1].log() == pytest.approx(-0.2, abs=1e-3)
        assert field.diff(dim=1).abs().max() < 0.02

    def test_colours_fade_to_their_mean(self):
        colour = torch.tensor([0.2, 0.4, 0.9])[None, :, None, None]

        assert torch.allclose(saturated(colour, value(0.0)), torch.full_like(colour, 0.5))
        assert torch.allclose(saturated(colour, value(1.0)), colour)

    def test_the_views_are_toned_alike_but_not_the_same(self):
        grey = torch.full((64, 3, 16, 16), 0.5)
        quiet = Augmentation(geometric=False, uneven_light=0.0, most_noise=0.0, compressed=0.0)

        left, right = quiet(grey, grey, seeded())

        tones = [view.mean((1, 2, 3)) for view in (left, right)]
        apart = (tones[0] - tones[1]).abs()
        assert tones[0].std() > 2 * apart.mean()
        assert (apart > 0.01).float().mean() > 0.5

    def test_only_one_view_is_lit_otherwise(self):
        grey = torch.full((20, 3, 16, 16), 0.5)
        uneven_only = Augmentation(
            geometric=False, shared=0.0, apart=0.0, darkest=0.0, vignetting=0.0, most_noise=0.0,
            compressed=0.0, relit=1.0, mildness=0.0,
        )  # fmt: skip

        left, right = uneven_only(grey, grey, seeded())

        assert left.flatten(1).std(1).max() < 1e-4
        assert right.flatten(1).std(1).mean() > 0.005


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"worst_quality": 0.0}, "worst_quality must be above 0 and at most 98, got 0"),
        ({"worst_quality": 99.0}, r"at most 98, got 99\.0"),
        ({"mildness": -1.0}, r"mildness must not be negative, got -1\.0"),
        ({"most_zoom": 0.9}, r"most_zoom must be at least 1, got 0\.9"),
        ({"most_blur_px": 0.1}, r"most_blur_px must be at least 0\.2, got 0\.1"),
    ],
)
def test_a_strength_that_cannot_be_is_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        Augmentation(**settings)


def found_by_sgbm(pairs):
    """Return the share of visible pixels that OpenCV's SGBM finds within 1 px, rows filled."""
    left, right = ((255 * view[0].permute(1, 2, 0)).round().byte().numpy() for view in pairs[:2])
    disparity, visible = pairs.disparity[0].numpy(), pairs.visible[0].numpy()
    count = 16 * int(np.ceil(0.31 * disparity.shape[1] / 16))
    matcher = cv2.StereoSGBM.create(
        0, count, 3, P1=8 * 3 * 9, P2=32 * 3 * 9, disp12MaxDiff=1, preFilterCap=63,
        mode=cv2.STEREO_SGBM_MODE_HH,
    )  # fmt: skip
    wide = [cv2.copyMakeBorder(v, 0, 0, count, 0, cv2.BORDER_REPLICATE) for v in (left, right)]
    found = matcher.compute(*wide)[:, count:].astype(np.float32) / 16
    for row in found:  # a missing pixel takes the further of its neighbours, as background
        known = np.flatnonzero(row >= 0)
        if len(known):
            after = np.searchsorted(known, np.arange(len(row)))
            ends = known[np.clip(np.stack((after - 1, after)), 0, len(known) - 1)]
            row[:] = np.where(row >= 0, row, row[ends].min(0))
    return float((np.abs(found - disparity) <= 1)[visible].mean())


def test_the_milder_the_rarer_are_strong_differences(generator):
    """The mean of u^m over u in [0, 1] is 1 / (m + 1)."""
    view = torch.rand(200, 3, 8, 24, generator=generator)

    def apart(mildness):
        rows = Augmentation(photometric=False, most_colours_px=0.0, mildness=mildness)
        return float((rows(view, view, seeded())[1] - view).abs().mean())

    always, mild, milder = (apart(mildness) for mildness in (0.0, 2.0, 8.0))

    assert always > 1.5 * mild > 2 * milder > 0


@pytest.mark.slow
def test_augmented_pairs_are_neither_trivial_nor_hopeless_for_semi_global_matching():
    """A mean of 84 % over 24 pairs of 416 x 256; without augmentation 89 %."""
    shares = []
    for seed in range(24):
        sample = draw(torch.Generator().manual_seed(seed), (416, 256), recipe=Recipe())
        views = (view.permute(2, 0, 1)[None] for view in (sample.left, sample.right))
        pair = Pairs(*views, sample.disparity_left[None], sample.visible[None])
        shares.append(
            [found_by_sgbm(one) for one in (Augmentation().whole(pair, seeded(seed)), pair)]
        )

    augmented, plain = np.mean(shares, 0)
    assert 0.75 < augmented < 0.89
    assert 0.85 < plain < 0.93
