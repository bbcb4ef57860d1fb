"""Path sums against the formula written out, and what they promise."""

import pytest
import torch
from references import path_sums as path_sums_written_out

from recon.kernels.scanlines import PathCosts, _sums_by_lines, path_sums

COSTS = PathCosts(small=0.1, large=0.5, edge=0.3, across=0.4)


@pytest.mark.parametrize("directions", [4, 8])
@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1), (7, 40), (40, 7)])
def test_sums_are_those_of_the_formula(directions, size, generator, assert_close):
    volume = torch.rand((*size, 6), generator=generator)
    guide = torch.rand(size, generator=generator)

    sums = path_sums(volume, guide, COSTS, directions=directions)

    expected = path_sums_written_out(volume.numpy(), guide.numpy(), COSTS, directions)
    assert_close(sums, expected, rtol=1e-4, atol=1e-4)  # sums of up to 40 costs in float32


@pytest.mark.parametrize("directions", [4, 8])
@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1), (7, 40), (40, 7)])
def test_the_form_for_other_devices_gives_the_same_sums(directions, size, generator, assert_close):
    """It is plain torch, so it can be held against the compiled one on any machine."""
    volume = torch.rand((*size, 6), generator=generator)
    guide = torch.rand(size, generator=generator)

    sums = _sums_by_lines(volume, guide, COSTS, directions)

    expected = path_sums(volume, guide, COSTS, directions=directions)
    assert_close(sums, expected, rtol=1e-4, atol=1e-4)


def test_missing_cells_stay_missing_and_count_as_the_highest(generator, assert_close):
    volume = torch.rand((6, 8, 5), generator=generator)
    volume[:, :3, 3:] = float("inf")
    volume[2, 2] = float("inf")
    guide = torch.rand((6, 8), generator=generator)
    highest = volume[volume.isfinite()].max()

    costs = COSTS._replace(large=20.0)  # above all costs, so that paths do not evade these cells

    sums = path_sums(volume, guide, costs, directions=8)

    filled = path_sums(volume.clamp(max=highest), guide, costs, directions=8)
    assert torch.equal(sums.isinf(), volume.isinf())
    assert_close(sums[sums.isfinite()], filled[sums.isfinite()])


def test_a_volume_without_any_cell_stays_so():
    volume = torch.full((3, 4, 5), float("inf"))

    assert path_sums(volume, torch.zeros(3, 4), COSTS, directions=8).isinf().all()


def test_the_volume_is_left_alone(generator):
    volume = torch.rand((5, 6, 4), generator=generator)
    before = volume.clone()

    path_sums(volume, torch.zeros(5, 6), COSTS, directions=8)

    assert torch.equal(volume, before)


def test_mirroring_the_input_mirrors_the_result(generator, assert_close):
    volume = torch.rand((9, 11, 4), generator=generator)
    guide = torch.rand((9, 11), generator=generator)

    sums = path_sums(volume, guide, COSTS, directions=8)

    for axes in ((0,), (1,), (0, 1)):
        mirrored = path_sums(volume.flip(axes), guide.flip(axes), COSTS, directions=8)
        assert_close(mirrored.flip(axes), sums, rtol=1e-4, atol=1e-4)


def test_without_penalties_nothing_is_passed_on(generator, assert_close):
    volume = torch.rand((6, 7, 4), generator=generator)
    free = PathCosts(0.0, 0.0, 1.0, 1.0)

    sums = path_sums(volume, torch.zeros(6, 7), free, directions=8)

    assert_close(sums, 8 * volume, rtol=1e-4, atol=1e-4)
