"""Rays meet shapes where the shapes are, and looking only where a shape can be changes nothing."""

from dataclasses import replace

import pytest
import torch

from recon.training.casting import Camera, Rays, first_hits, surface_at, windows
from recon.training.composition import rotation_about
from recon.training.recipe import Recipe
from recon.training.scenery import compose
from recon.training.shapes import KINDS, Shapes

TURN = rotation_about(torch.tensor([0.6, 0.0, 0.8]), 0.7)
HALF, CENTRE = torch.tensor([0.5, 0.7, 0.9]), torch.tensor([0.2, -0.1, 4.0])


def one(kind, centre=CENTRE, turn=TURN, half=HALF):
    """Return one shape; a relief or cutout has an even slope and a hole at one side."""
    along = torch.linspace(-1, 1, 9)
    return Shapes(
        torch.tensor([KINDS.index(kind)]),
        torch.as_tensor(centre)[None],
        turn[None],
        torch.as_tensor(half)[None],
        torch.tensor([0]),
        (0.4 * along + 0.2).expand(1, 9, 9),
    )


def in_double(shapes):
    names = ("centre", "world_from_shape", "half_size", "maps")
    return replace(shapes, **{name: getattr(shapes, name).double() for name in names})


def from_origin(directions):
    """Return rays from the left camera in directions (N, 3)."""
    origin = torch.zeros(3, 1, 1, 1, dtype=directions.dtype)
    return Rays(origin, directions.T[:, None, None])


@pytest.fixture
def rays(generator):
    across = torch.rand(500, 2, generator=generator) * 0.5 - 0.25
    return torch.cat((across, torch.ones(500, 1)), 1)


def places_met(kind, rays):
    """Return the places met on one shape in its own half sizes, (3, N)."""
    depth = first_hits(one(kind), from_origin(rays)).depth[0, 0]
    met = depth.isfinite()
    return (((depth[met, None] * rays[met] - CENTRE) @ TURN) / HALF).T


@pytest.mark.parametrize("kind", KINDS)
def test_rays_meet_a_shape_on_its_surface(kind, rays, assert_close):
    place = places_met(kind, rays)

    x, y, z = place.abs()
    flat = torch.stack((x, y))
    within_square = flat.amax(0) <= 1.0001
    on_surface = {
        "box": place.abs().amax(0),
        "ellipsoid": place.norm(dim=0),
        "cylinder": torch.maximum(flat.norm(dim=0), z),
        "rectangle": torch.where(within_square, 1 + z, 0),
        "disc": torch.where(flat.norm(dim=0) <= 1.0001, 1 + z, 0),
        "tube": torch.where(z <= 1.0001, flat.norm(dim=0), 0),
        "relief": torch.where(within_square, 1 + place[2] - 0.4 * place[0] - 0.2, 0),
        "cutout": torch.where(within_square & (place[0] > -0.5001), 1 + z, 0),
    }[kind]
    assert 20 < place.shape[1] < 500
    assert_close(on_surface, torch.ones(place.shape[1]), atol=1e-4)  # single precision at 4 m


def test_a_cutout_lets_pass_what_meets_its_rectangle_where_the_map_is_not_positive(rays):
    met = first_hits(one("cutout"), from_origin(rays)).depth[0, 0].isfinite()
    depth = first_hits(one("rectangle"), from_origin(rays)).depth[0, 0]

    x = ((depth[:, None] * rays - CENTRE) @ TURN)[:, 0] / HALF[0]
    assert torch.equal(met, depth.isfinite() & (x > -0.5))
    assert 20 < met.sum() < depth.isfinite().sum() - 20


def test_a_tube_shows_its_inside_and_a_cylinder_does_not():
    upright = rotation_about(torch.tensor([1.0, 0.0, 0.0]), 0.2)  # its mouth towards the camera
    ahead = torch.tensor([[0.0, 0.0, 1.0]])

    lidless, solid = (
        one(kind, (0.0, 0.0, 4.0), upright, (0.5, 0.5, 1.0)) for kind in ("tube", "cylinder")
    )
    depths = [float(first_hits(shape, from_origin(ahead)).depth) for shape in (lidless, solid)]

    assert depths[1] == pytest.approx(4 - 1 / torch.cos(torch.tensor(0.2)).item(), abs=1e-4)
    assert depths[0] == float("inf")


@pytest.mark.parametrize("kind", KINDS)
def test_normals_are_those_of_the_surface_and_look_at_the_camera(kind, rays, assert_close):
    """Compare with the cross product of the steps to two neighbouring places."""
    shape, step = in_double(one(kind)), 1e-5
    nudges = torch.tensor([[0, 0, 0], [step, 0, 0], [0, step, 0]], dtype=torch.float64)
    bundles = rays.double()[:, None] + nudges  # (N, 3, 3)
    depth = first_hits(shape, from_origin(bundles.reshape(-1, 3))).depth.reshape(-1, 3)
    place = depth[..., None] * bundles
    across, down = place[:, 1] - place[:, 0], place[:, 2] - place[:, 0]
    apart = torch.stack((across, down)).norm(dim=-1).amax(0)
    kept = depth.isfinite().all(1) & (apart < 20 * step)  # all three on one piece
    expected = torch.nn.functional.normalize(torch.linalg.cross(down, across), dim=-1)[kept]

    met = torch.zeros(int(kept.sum()), dtype=torch.int64)
    surface = surface_at(shape, met, place[kept, 0].T, rays[kept].double().T)

    assert kept.sum() > 20
    assert (surface.normal * rays[kept].T).sum(0).max() < 0
    agreeing = ((surface.normal.T - expected).abs().amax(1) < 1e-3).float().mean()
    assert agreeing > 0.98  # a bundle may lie astride an edge


def test_disparity_is_focal_length_times_baseline_over_depth():
    """A wall straight ahead, by hand."""
    wall = one("rectangle", (0.0, 0.0, 4.0), torch.eye(3), (9.0, 9.0, 1.0))

    hits = first_hits(wall, from_origin(torch.tensor([[0.1, 0.2, 1.0], [0.0, 0.0, -1.0]])))

    assert hits.depth[0, 0].tolist() == [4.0, float("inf")]


@pytest.mark.parametrize("radius", [0.002, 0.02])
@pytest.mark.parametrize("kind", ["cylinder", "ellipsoid", "tube"])
def test_thin_rods_are_exact_in_single_precision(kind, radius, rays):
    """The disparity of a rod a pixel wide at 4 m is within 0.001 px where it is 100 px."""
    rod = one(kind, CENTRE, TURN, (radius, radius, 0.7))
    aimed = torch.nn.functional.normalize(rays, dim=1)
    along = torch.linspace(-0.5, 0.5, 500)[:, None] * TURN[:, 2]
    aimed = CENTRE + along + radius * 2 * (aimed[:, :3] - aimed[:, :3].mean(0))
    aimed = aimed / aimed[:, 2:]

    depth = first_hits(rod, from_origin(aimed)).depth[0, 0]
    exact = first_hits(in_double(rod), from_origin(aimed.double())).depth[0, 0]

    both = depth.isfinite() & exact.isfinite()
    assert both.sum() > 50
    assert (depth.isfinite() != exact.isfinite()).sum() <= 2
    assert (100 * (4 / depth - 4 / exact).abs()[both]).max() < 1e-3


SCENES = ("room", "dense", "garden", "lattice", "landscape", "relief")


@pytest.mark.parametrize("kind", SCENES)
def test_casting_only_within_windows_changes_no_hit(kind):
    generator = torch.Generator().manual_seed(11)
    scene, view = compose(generator, (80, 48), Recipe(scenes=(kind,)))
    for x_m in (0.0, view.baseline_m):
        camera = Camera(view.width, view.height, view.focal_px, x_m)
        rays = camera.rays([(-0.25, -0.25), (0.0, 0.0)], torch.device("cpu"))

        windowed = first_hits(scene.shapes, rays, windows(scene.shapes.corners(), camera))
        asked = first_hits(scene.shapes, rays)

        assert torch.equal(windowed.depth, asked.depth)
        assert torch.equal(windowed.shape, asked.shape)


@pytest.mark.parametrize("kind", SCENES)
def test_disparities_are_those_of_double_precision_within_a_hundredth_of_a_pixel(kind):
    generator = torch.Generator().manual_seed(12)
    scene, view = compose(generator, (80, 48), Recipe(scenes=(kind,)))
    rays = Camera(80, 48, view.focal_px).rays([(0.0, 0.0)], torch.device("cpu"))

    single = first_hits(scene.shapes, rays)
    double = first_hits(
        in_double(scene.shapes), Rays(rays.origin.double(), rays.direction.double())
    )

    at_416_px = view.focal_px * view.baseline_m * 416 / 80
    apart = (at_416_px / single.depth - at_416_px / double.depth).abs()
    assert (single.shape == double.shape).float().mean() > 0.999  # outlines
    assert apart[single.shape == double.shape].max() < 0.01


def test_windows_leave_most_of_the_image_to_small_things():
    small = one("ellipsoid", (0.0, 0.0, 4.0), TURN, (0.1, 0.1, 0.1))
    camera = Camera(200, 100, 160.0)

    rows, columns = windows(small.corners(), camera)[0]
    (behind,) = windows(one("box", (0.0, 0.0, -4.0)).corners(), camera)
    (around,) = windows(one("box", (0.0, 0.0, 0.2)).corners(), camera)

    assert 8 <= rows.stop - rows.start < 30
    assert 8 <= columns.stop - columns.start < 30
    assert behind == (slice(0, 0), slice(0, 0))
    assert around == (slice(0, 100), slice(0, 200))


def test_windows_hold_every_pixel_of_what_faces_the_camera():
    camera, offsets = Camera(40, 30, 30.0), [(-0.4, -0.4), (0.0, 0.0), (0.4, 0.4)]
    rays = camera.rays(offsets, torch.device("cpu"))
    for step in range(20):
        aside, size = 0.03 * step - 0.3, 0.2 + 0.013 * step
        square = one("rectangle", (aside, -aside, 2.0), torch.eye(3), (size, size, 1.0))

        windowed = first_hits(square, rays, windows(square.corners(), camera))

        assert torch.equal(windowed.depth, first_hits(square, rays).depth)
