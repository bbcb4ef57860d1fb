"""Paint: every style has contrast, and what a pixel cannot show fades."""

import pytest
import torch

from recon.training.patterns import STYLES, Canvas
from recon.training.textures import Paint, noise_table, paint


@pytest.fixture
def table(generator):
    return noise_table(generator)


def even_paint(style, count, **more):
    """Return one paint from black to white for `count` places."""
    given = {"frequency": 10.0, "turn": 0.3, "slope": 0.2, "grain": 0.0, "gloss": 0.0, **more}
    return Paint(
        style=torch.full((count,), list(STYLES).index(style)),
        colours=torch.tensor([[0.0] * 3, [1.0] * 3]).expand(count, 2, 3),
        offset=torch.zeros(count, 2),
        **{name: torch.full((count,), value) for name, value in given.items()},
    )


def grid(side, extent_m):
    along = torch.linspace(0, extent_m, side)
    v, u = torch.meshgrid(along, along, indexing="ij")
    return torch.stack((u.flatten(), v.flatten()))


@pytest.mark.parametrize("style", STYLES)
def test_every_style_varies_between_its_colours(style, table):
    uv = grid(120, 1.2)

    tone = paint(even_paint(style, 120**2), uv, torch.full((120**2,), 0.01), table)

    least = 0.005 if style == "flat" else 0.06
    assert tone.shape == (3, 120**2)
    assert tone.min() >= 0
    assert tone.max() <= 1
    assert tone.std() > least
    assert torch.equal(tone[0], tone[1])


@pytest.mark.parametrize("style", [name for name in STYLES if name != "earth"])
def test_a_pattern_that_a_pixel_cannot_show_melts_into_its_mean(style, table):
    uv = grid(60, 100.0)
    fine = even_paint(style, 60**2, frequency=100.0)

    tone = paint(fine, uv, torch.full((60**2,), 1.0), table)

    assert tone.std() < 0.01


def test_earth_has_detail_of_the_size_of_a_pixel_at_every_distance(table):
    for footprint in (0.003, 0.05, 1.0):
        uv = grid(100, 100 * footprint)

        tone = paint(even_paint("earth", 100**2), uv, torch.full((100**2,), footprint), table)

        image = tone[0].reshape(100, 100)
        assert image.std() > 0.1
        assert 0.02 < image.diff(dim=1).abs().mean() < 0.2


def test_earth_changes_smoothly_while_the_footprint_of_a_pixel_grows(table):
    place = torch.full((2000,), 1.234)
    finest = torch.logspace(-1, 3, 2000)

    band = Canvas(table, place, place, torch.zeros(2000), finest).band()

    assert band.diff().abs().max() < 0.02


def test_steeper_spectra_are_smoother(table):
    uv = grid(100, 1.0)
    footprint = torch.full((100**2,), 0.01)

    rough, smooth = (
        paint(even_paint("noise", 100**2, frequency=2.0, slope=slope), uv, footprint, table)[0]
        for slope in (-0.2, 1.0)
    )

    steps = [tone.reshape(100, 100).diff(dim=1).std() / tone.std() for tone in (rough, smooth)]
    assert steps[0] > 2 * steps[1]


def test_the_table_repeats_without_a_seam(table, assert_close):
    place = torch.tensor([3.3, 511.7, -0.4])
    finest, slope = torch.full((3,), 100.0), torch.zeros(3)

    here, there = (
        Canvas(table, place + shift, place, slope, finest).fractal() for shift in (0, 512)
    )

    assert_close(here, there, atol=1e-3)  # 512 costs digits of the place
