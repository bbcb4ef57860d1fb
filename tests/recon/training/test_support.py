"""The bilateral mean that a training looks through."""

import pytest
import torch

from recon.kernels.bilateral import bilateral_mean
from recon.training.support import Support


@pytest.fixture
def guide(generator):
    """A slope of grey with grain, one edge, (1, 3, 9, 20)."""
    grain = 0.06 * torch.rand(1, 3, 9, 20, generator=generator)
    return grain + 0.5 * (torch.arange(20) > 11)


def test_it_is_the_mean_that_the_matcher_takes(guide, generator):
    volume = torch.rand(1, 9, 20, 5, generator=generator)

    mean = Support(3)(volume, guide)

    expected = bilateral_mean(
        volume[0], guide[0].permute(1, 2, 0), radius=3, sigma_space=2.4, sigma_colour=0.04
    )
    torch.testing.assert_close(mean[0], expected, atol=0.01, rtol=0)  # which uses 256 levels
    assert (mean - volume).abs().max() > 0.1


def test_its_gradient_is_that_of_finite_differences(guide, generator):
    volume = torch.rand(1, 4, 5, 2, dtype=torch.double, generator=generator, requires_grad=True)
    part = guide[..., :4, 9:14].double()

    assert torch.autograd.gradcheck(lambda values: Support(2)(values, part), volume)


def test_nothing_crosses_a_strong_edge(guide):
    volume = torch.zeros(1, 9, 20, 1)
    volume[:, :, 12:] = 1.0

    torch.testing.assert_close(Support(4)(volume, guide), volume, atol=1e-4, rtol=0)


def test_each_pair_has_its_own_weights(guide, generator):
    volume = torch.rand(1, 9, 20, 2, generator=generator)
    other = guide.flip(3)

    both = Support(2)(torch.cat((volume, volume)), torch.cat((guide, other)))

    torch.testing.assert_close(both[:1], Support(2)(volume, guide))
    torch.testing.assert_close(both[1:], Support(2)(volume, other))
    assert not torch.allclose(both[0], both[1])
