"""Compiled loops and tensor forms against slow, obvious references."""

import numpy as np
import pytest
import references
import torch

from recon.kernels import bilateral, compiled, minimum, recursive, shifts, windows
from recon.kernels.holes import from_directions, from_row
from recon.kernels.local_planes import Belonging, local_planes
from recon.kernels.median import weighted_median
from recon.kernels.planes import plane_slopes
from recon.kernels.segments import segment_sizes

RANGES = [range(4), range(-3, 2), range(3, 6), range(-4, -1), range(20), range(40, 42)]
INF, NAN = float("inf"), float("nan")


@pytest.fixture(params=["compiled", "tensors"])
def form(request, monkeypatch):
    """Run a test with the compiled loops and with the form for other devices."""
    if request.param == "tensors":
        for module in (bilateral, minimum, recursive, shifts, windows):
            if hasattr(module, "on_cpu"):
                monkeypatch.setattr(module, "on_cpu", lambda _: False)
    return request.param


@pytest.fixture
def volume(generator):
    """A volume with single candidates missing, whole pixels missing, and complete pixels."""
    cost = torch.rand((9, 14, 5), generator=generator)
    missing = torch.rand(cost.shape, generator=generator) < 0.15
    missing[:, 8:] = False
    missing[4, 3] = True
    return cost.masked_fill(missing, INF)


@pytest.mark.parametrize("candidates", RANGES, ids=str)
class TestShifts:
    def test_cosine_distances_agree_with_the_loop(self, candidates, generator, assert_close):
        a, b = (
            torch.nn.functional.normalize(torch.randn((6, 3, 17), generator=generator), dim=0)
            for _ in range(2)
        )

        result = shifts.cosine_distances(a, b, candidates)

        expected = references.compare_at_shifts(
            a.numpy(), b.numpy(), candidates, lambda p, q: 1 - p @ q
        )
        assert_close(result, expected)

    @pytest.mark.parametrize("squared", [False, True])
    def test_pixel_differences_agree_with_the_loop(
        self, candidates, squared, form, generator, assert_close
    ):
        a, b = (torch.rand((3, 4, 17), generator=generator) for _ in range(2))

        result = shifts.pixel_differences(a, b, candidates, squared=squared)

        power = 2 if squared else 1
        expected = references.compare_at_shifts(
            a.numpy(), b.numpy(), candidates, lambda p, q: (abs(p - q) ** power).mean()
        )
        assert_close(result, expected)

    def test_hamming_distances_agree_with_the_loop(self, candidates, form, generator, assert_close):
        words, others = (
            torch.randint(0, 2**63 - 1, (4, 17), generator=generator) for _ in range(2)
        )
        cells = torch.randint(0, 2**63 - 1, (4, 17), generator=generator)
        cells[1, 5] = 0

        result = shifts.hamming_distances(words, others, cells, candidates)

        def share(p, q):
            both = int(p[1]) & int(q[1])
            return ((int(p[0]) ^ int(q[0])) & both).bit_count() / both.bit_count() if both else 1

        expected = references.compare_at_shifts(
            np.stack([words.numpy(), cells]), np.stack([others.numpy(), cells]), candidates, share
        )
        assert_close(result, expected)


def test_wide_images_are_cut_into_blocks_that_join(generator, assert_close):
    width = 2 * shifts.BLOCK_COLUMNS + 5
    a, b = (torch.randn((4, 2, width), generator=generator) for _ in range(2))
    a, b = (torch.nn.functional.normalize(x, dim=0) for x in (a, b))

    result = shifts.cosine_distances(a, b, range(-2, 9))

    expected = references.compare_at_shifts(
        a.numpy(), b.numpy(), range(-2, 9), lambda p, q: 1 - p @ q
    )
    assert_close(result, expected)


@pytest.mark.parametrize("radius", [0, 2, 20])
def test_box_mean_agrees_with_the_loop(radius, form, volume, assert_close):
    result = windows.box_mean(volume, radius)

    assert_close(result, references.weighted_mean(volume.numpy(), radius, lambda _p, _q: 1.0))


@pytest.mark.parametrize(("rows", "columns"), [(3, 3), (5, 3), (7, 9)])
def test_census_words_agree_with_the_loop(rows, columns, form, generator):
    image = torch.rand((8, 11), generator=generator)

    words, cells = windows.census_words(image, rows, columns)

    expected = references.census_words(image.numpy(), rows, columns)
    assert np.array_equal(words, expected[0])
    assert np.array_equal(cells, expected[1])


@pytest.mark.parametrize("centred", [False, True])
def test_normalised_patches_agree_with_the_loop(centred, generator, assert_close):
    image = torch.rand((7, 9), generator=generator)

    result = windows.normalised_patches(image, 2, centred=centred)

    assert_close(result, references.normalised_patches(image.numpy(), 2, centred=centred))


def test_patches_without_contrast_have_no_direction():
    assert not windows.normalised_patches(torch.full((5, 6), 0.3), 1, centred=True).any()


@pytest.mark.parametrize("sigma_colour", [0.05, 10.0])
def test_bilateral_mean_agrees_with_the_loop(
    sigma_colour, form, volume, smooth_texture, assert_close
):
    guide = (smooth_texture(*volume.shape[:2]) * 255).round() / 255
    settings = {"radius": 3, "sigma_space": 2.0, "sigma_colour": sigma_colour}

    result = bilateral.bilateral_mean(volume, guide, **settings)

    assert_close(result, references.bilateral_mean(volume.numpy(), guide.numpy(), **settings))


def test_bilateral_mean_joins_at_the_borders_of_tiles(smooth_texture, generator, assert_close):
    height, width = bilateral.TILE_ROWS + 3, bilateral.TILE_COLUMNS + 3
    volume = torch.rand((height, width, 1), generator=generator)
    guide = (smooth_texture(height, width) * 255).round() / 255
    settings = {"radius": 2, "sigma_space": 2.0, "sigma_colour": 0.2}

    result = bilateral.bilateral_mean(volume, guide, **settings)

    assert_close(result, references.bilateral_mean(volume.numpy(), guide.numpy(), **settings))


def test_lowest_agrees_with_the_loop(form, volume, assert_close):
    result = minimum.lowest(volume)

    for y, x in np.ndindex(volume.shape[:2]):
        layer, *values = references.lowest(volume[y, x].numpy())
        assert result.layer[y, x] == layer
        assert_close(torch.stack([field[y, x] for field in result[1:]]), values)


def test_recursive_smoothing_agrees_with_the_loop(form, generator, assert_close):
    values, weights = (torch.rand((11, 70), generator=generator) for _ in range(2))
    weights[3, 4:9] = 0.0
    steps = tuple(1 + 3 * torch.rand((11, 70), generator=generator) for _ in range(2))

    result = recursive.smooth_along_rows_and_columns(
        values, weights, steps, sigma=4.0, iterations=3
    )

    expected = references.smooth_along_rows_and_columns(
        values.numpy(), weights.numpy(), [s.numpy() for s in steps], sigma=4.0, iterations=3
    )
    assert_close(result, expected)


@pytest.mark.parametrize("sigma_colour", [0.3, INF])
def test_weighted_median_agrees_with_the_loop(sigma_colour, texture, generator, assert_close):
    values = torch.rand((8, 9), generator=generator)
    values[torch.rand((8, 9), generator=generator) < 0.2] = NAN
    guide = texture(8, 9)

    result = weighted_median(values, guide, radius=2, sigma_colour=sigma_colour)

    expected = references.weighted_median(
        values.numpy(), guide.numpy(), radius=2, sigma_colour=sigma_colour
    )
    assert_close(result, expected)


@pytest.mark.parametrize("rounds", [1, 2])
def test_local_planes_agree_with_the_loop(rounds, texture, generator, assert_close):
    values = 20 + 0.4 * torch.arange(15) + 0.5 * torch.rand((12, 15), generator=generator)
    values[torch.rand((12, 15), generator=generator) < 0.2] = NAN
    weights, guide = torch.rand((12, 15), generator=generator), texture(12, 15)
    belonging = Belonging(radius=5, step=2, colour=1.5, tolerance=0.8)

    result = local_planes(values, weights, guide, belonging, rounds=rounds)

    expected = references.local_planes(
        *(array.numpy() for array in (values, weights, guide)),
        belonging,
        plane_slopes(values.numpy(), radii=(4,), edge=1.0, noise=0.5),
        rounds=rounds,
    )
    assert_close(result, expected, rtol=1e-4, atol=1e-4)
    assert np.nanmax(np.abs(expected - values.numpy())) > 0.1


def test_segment_sizes_agree_with_a_flood(generator):
    values = torch.randint(0, 4, (20, 25), generator=generator).float()
    values[torch.rand((20, 25), generator=generator) < 0.2] = NAN

    result = segment_sizes(values, largest_step=1.0)

    assert np.array_equal(result, references.segment_sizes(values.numpy(), 1.0))


def test_a_loop_says_what_it_lacks_where_it_cannot_be_compiled(monkeypatch):
    monkeypatch.setattr(compiled, "numba", None)

    loop = compiled.compiled(parallel=True)(lambda values: values)

    with pytest.raises(ImportError, match=r"needs numba on a CPU \(pip install numba\)"):
        loop(1)


class TestHoles:
    def test_a_hole_in_a_row_takes_the_smaller_side(self):
        row = torch.tensor([[9.0, 9, 9, NAN, NAN, 4, 4, 4]])

        assert from_row(row).tolist() == [[9, 9, 9, 4, 4, 4, 4, 4]]
        assert from_row(row.flip(1)).tolist() == [[4, 4, 4, 4, 4, 9, 9, 9]]

    def test_a_hole_at_the_border_takes_its_only_side(self):
        row = torch.tensor([[NAN, 7.0, NAN]])

        assert from_row(row).tolist() == [[7, 7, 7]]

    def test_one_wrong_pixel_beside_a_hole_makes_no_streak(self):
        row = torch.tensor([[8.0, 8, 8, 8, 1, NAN, NAN, 9, 9, 9, 9, 9]])

        assert from_row(row)[0, 5:7].tolist() == [8, 8]

    def test_an_empty_row_takes_the_nearest_filled_row(self):
        empty = [NAN, NAN]
        image = torch.tensor([empty, [3.0, NAN], empty, empty, empty, [NAN, 5.0], empty])

        assert from_row(image)[:, 0].tolist() == [3, 3, 3, 3, 5, 5, 5]

    @pytest.mark.parametrize("mirrored", [False, True])
    def test_a_slanted_surface_goes_on_into_a_hole_at_the_border(self, mirrored):
        rows, columns = torch.arange(30.0)[:, None], torch.arange(60.0)
        plane = 20 + 0.05 * columns + 0.02 * rows
        holes = plane.clone()
        holes[:, :20] = NAN
        if mirrored:
            plane, holes = plane.flip(1), holes.flip(1)

        flat, slanted = from_row(holes), from_row(holes, most_rise=3.0)

        assert (flat - plane).abs().max() > 1
        # Less than the whole slope, for the sake of what is narrow or noisy.
        assert (slanted - plane).abs().max() < 0.15

    def test_the_rise_into_a_hole_is_limited(self):
        plane = (0.2 * torch.arange(60.0)).expand(30, 60).clone()
        plane[:, :40] = NAN

        filled = from_row(plane, most_rise=1.5)

        assert (plane[:, 40] - filled[:, 0]).tolist() == pytest.approx([1.5] * 30, abs=0.6)

    def test_what_is_beside_the_surface_does_not_bend_it(self):
        image = torch.full((30, 60), 5.0)
        image[:, :15] = NAN
        image[:, 25:] = 30.0  # another surface, near the hole
        image[12, 16] = NAN

        assert torch.equal(from_row(image, most_rise=3.0)[:, :15], torch.full((30, 15), 5.0))

    def test_a_few_pixels_tell_no_slope(self):
        row = torch.tensor([[NAN, NAN, 6.0, 6.5, 7.0, 7.5, 8.0]])

        assert torch.equal(from_row(row, most_rise=3.0), from_row(row))

    def test_nothing_is_made_of_nothing(self):
        nothing = torch.full((3, 4), NAN)

        assert from_row(nothing).isnan().all()
        assert from_directions(nothing, nothing.isnan()).isnan().all()

    def test_directions_take_the_median_of_what_is_seen_first(self):
        image = torch.full((9, 9), 2.0)
        image[1:8, 1:8] = 6.0
        image[2:7, 2:7] = NAN

        result = from_directions(image, image.isnan())

        assert (result[2:7, 2:7] == 6).all()
        assert result.isnan().sum() == 81 - 25

    def test_directions_are_sixteen_and_reach_all_sides(self):
        image = torch.full((21, 21), NAN)
        image[0], image[-1], image[:, 0], image[:, -1] = 1.0, 2.0, 3.0, 4.0
        centre = torch.zeros((21, 21), dtype=torch.bool)
        centre[10, 10] = True

        # Top and bottom edge are met by three directions each, with the corners by the sides.
        assert from_directions(image, centre)[10, 10] == pytest.approx(3.0)
