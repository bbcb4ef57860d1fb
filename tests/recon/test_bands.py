"""Volumes of bands against whole volumes, and against the formulas written out."""

import numpy as np
import pytest
import torch
from references import path_sums as path_sums_written_out

from recon.kernels.bands import (
    Bands,
    add_doubt,
    distances_in_bands,
    lowest_in_bands,
    means_in_bands,
    paths_in_bands,
    valleys_in_bands,
)
from recon.kernels.bilateral import bilateral_mean
from recon.kernels.minimum import lowest
from recon.kernels.scanlines import PathCosts, path_sums
from recon.kernels.shifts import cosine_distances

LAYERS = 9
COSTS = PathCosts(small=0.1, large=0.5, edge=0.3, across=0.4)
SIZES = [(1, 1), (1, 9), (9, 1), (7, 40), (40, 7)]


@pytest.fixture
def ragged(generator):
    """Return a maker of bands of all lengths from 0 on, within `LAYERS`."""

    def make(height, width):
        first = torch.randint(LAYERS, (height, width), generator=generator)
        size = torch.randint(LAYERS + 1, (height, width), generator=generator)
        return Bands.holding(first.numpy(), torch.minimum(size, LAYERS - first).numpy())

    return make


def full(height, width):
    return Bands.holding(np.zeros((height, width)), np.full((height, width), LAYERS))


def whole(values, bands):
    """Return (H, W, LAYERS) with +inf where a pixel has no such layer."""
    volume = torch.full((*bands.first.shape, LAYERS), float("inf"))
    for (y, x), first in np.ndenumerate(bands.first):
        size, start = bands.size[y, x], bands.start[y, x]
        volume[y, x, first : first + size] = torch.from_numpy(values[start : start + size])
    return volume


def drawn(bands, generator):
    return torch.rand(bands.total, generator=generator).numpy()


def test_bands_lie_one_after_the_other():
    bands = Bands.holding(np.array([[5, 0], [2, 1]]), np.array([[2, 0], [3, 1]]))

    assert bands.start.tolist() == [[0, 2], [2, 5]]
    assert bands.total == 6
    assert bands.extent == (1, 6)
    assert bands.rows(slice(1, 2)).start.tolist() == [[2, 5]]
    assert Bands.holding(np.zeros((2, 2)), np.zeros((2, 2))).extent == (0, 0)


def test_distances_are_those_of_the_whole_volume(generator, assert_close):
    reference, other = torch.nn.functional.normalize(
        torch.randn((2, 4, 6, 30), generator=generator), dim=1
    )
    expected = cosine_distances(reference, other, range(LAYERS))
    size = np.minimum(np.arange(30) + 1, LAYERS)[None].repeat(6, 0)  # those with a partner
    bands = Bands.holding(np.zeros((6, 30)), size)
    result = np.full(bands.total, np.nan, np.float32)

    for rows in (slice(0, 4), slice(4, 6)):
        vectors = (each.permute(1, 2, 0).numpy()[rows] for each in (reference, other))
        distances_in_bands(*vectors, bands.rows(rows), result)

    assert_close(whole(result, bands), expected)


@pytest.mark.parametrize("radius", [0, 2])
def test_means_are_those_of_the_whole_volume(radius, ragged, texture, generator, assert_close):
    bands, guide = ragged(20, 30), texture(20, 30)
    values = drawn(bands, generator)
    settings = {"radius": radius, "sigma_space": 1.5, "sigma_colour": 0.3}

    levels = (255 * guide).round().byte().numpy()
    means = means_in_bands(values, levels, bands, **settings)

    assert_close(whole(means, bands), bilateral_mean(whole(values, bands), guide, **settings))


def test_doubt_grows_with_the_distance_and_then_no_more():
    bands = Bands.holding(np.array([[3, 0]]), np.array([[4, 2]]))
    values = np.ones(6, np.float32)

    add_doubt(values, np.array([[4.5, np.nan]], np.float32), bands, most=0.4, reach=2.0)

    np.testing.assert_allclose(values, [1.225, 1.025, 1.025, 1.225, 1, 1], rtol=1e-6)


@pytest.mark.parametrize("size", SIZES)
def test_paths_through_full_bands_are_those_of_the_whole_volume(size, generator, assert_close):
    bands, guide = full(*size), torch.rand(size, generator=generator)
    values = drawn(bands, generator)

    sums = paths_in_bands(values, guide.numpy(), bands, COSTS)

    expected = path_sums(whole(values, bands), guide, COSTS, directions=4)
    assert_close(whole(sums, bands), expected, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("size", SIZES)
def test_paths_step_between_the_layers_that_there_are(size, ragged, generator, assert_close):
    bands, guide = ragged(*size), torch.rand(size, generator=generator)
    values = drawn(bands, generator)

    sums = paths_in_bands(values, guide.numpy(), bands, COSTS)

    expected = path_sums_written_out(whole(values, bands).numpy(), guide.numpy(), COSTS, 4)
    assert_close(whole(sums, bands), expected, rtol=1e-4, atol=1e-4)


def test_the_lowest_is_that_of_the_whole_volume(ragged, generator):
    bands = ragged(20, 30)
    values = drawn(bands, generator)

    found, expected = lowest_in_bands(values, bands), lowest(whole(values, bands)).layer

    there = torch.from_numpy(bands.size > 0)
    assert torch.equal(torch.from_numpy(found)[there], expected[there])


def test_valleys_around_the_lowest_are_those_of_the_whole_volume(ragged, generator, assert_close):
    bands = ragged(20, 30)
    values = drawn(bands, generator)

    found = valleys_in_bands(values, lowest_in_bands(values, bands), bands)
    expected = lowest(whole(values, bands))

    for name in ("value", "before", "after"):
        assert_close(getattr(found, name), getattr(expected, name))


def test_a_slope_is_a_valley_with_a_flat_side():
    bands = Bands.holding(np.array([[3]]), np.array([[3]]))

    valley = valleys_in_bands(np.float32([0.1, 0.4, 0.9]), np.array([[4]]), bands)

    assert [float(each) for each in valley[1:4]] == pytest.approx([0.4, 0.4, 0.9])


def test_nothing_comes_of_bands_without_layers():
    bands = Bands.holding(np.zeros((3, 4)), np.zeros((3, 4)))
    nothing = np.zeros(0, np.float32)

    sums = paths_in_bands(nothing, np.zeros((3, 4), np.float32), bands, COSTS)

    assert not len(sums)
    assert valleys_in_bands(sums, lowest_in_bands(sums, bands), bands).value.isinf().all()
