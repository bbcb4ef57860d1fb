"""Meshes with fewer triangles: what may be lost, and what may never appear."""

import numpy as np
import pytest
from test_meshing import (
    HEIGHT,
    WIDTH,
    a_disparity_map,
    a_pair,
    constant,
    pixels_of,
    rough_scene,
)

from recon.kernels.simplification import simplified
from recon.meshing import Meshing, grid_faces
from recon.triangulation import Triangulation

BORDER_PX = 0.5


def settings(sigma, **more):
    points = Triangulation(disparity_sigma_px=0.25, **more)
    return Meshing(points=points, min_component_faces=1, decimation_sigma=sigma)


def full_and_decimated(values, sigma=2.0):
    """Return corners (F, 3) as indices of pixels, before and after; the tolerance is sigma / 4."""
    disparity = a_disparity_map(values)
    meshes = [settings(number)(disparity, a_pair()) for number in (0, sigma)]
    columns_rows = [pixels_of(mesh)[mesh.faces] for mesh in meshes]
    return [corners @ (1, WIDTH) for corners in columns_rows]


def as_points(faces):
    """Return (F, 3, 2) columns and rows of indices."""
    return np.stack([faces % WIDTH, faces // WIDTH], axis=-1)


def area(corners):
    """Return twice the signed areas of triangles (F, 3, 2)."""
    (ux, uy), (vx, vy) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    return uy * vx - ux * vy


def covering(points, triangles, slack=1e-9):
    """Return (N, F): which triangles (F, 3, 2) contain which points (N, 2)."""
    inside = np.ones((len(points), len(triangles)), bool)
    for corner in range(3):
        p, q = triangles[:, corner], triangles[:, (corner + 1) % 3]
        dx, dy = (q - p).T
        inside &= (
            dx * (points[:, None, 1] - p[None, :, 1]) - dy * (points[:, None, 0] - p[None, :, 0])
            <= slack
        )
    return inside


def covered_by_cells(points, faces):
    """Return (N,): which points lie on triangles (F, 3) that each join pixels of one square."""
    triangles = as_points(faces)
    corner = triangles.min(axis=1) @ (1, WIDTH)
    of_cell = np.full((WIDTH * HEIGHT, 2), -1)
    for face, cell in enumerate(corner):
        of_cell[cell, int(of_cell[cell, 0] >= 0)] = face
    cells = np.floor(points).astype(int).clip(0, (WIDTH - 1, HEIGHT - 1)) @ (1, WIDTH)
    found = np.zeros(len(points), bool)
    for half in of_cell[cells].T:
        inside = half >= 0
        for p, q in ((0, 1), (1, 2), (2, 0)):
            start = triangles[half, p]
            (dx, dy), (x, y) = (triangles[half, q] - start).T, (points - start).T
            inside &= dx * y - dy * x <= 1e-9
        found |= inside
    return found


def border_edges(faces):
    """Return (E, 2) the edges that only one triangle has."""
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    edges, counts = np.unique(sides, axis=0, return_counts=True)
    assert counts.max() <= 2
    return edges[counts == 1]


def errors_of_removed(values, full, few):
    """Return the removed pixels (N,), and how far what is left passes from each, (N,)."""
    removed = np.setdiff1d(full, few)
    places, triangles = as_points(removed), as_points(few)
    corners = triangles.astype(float)
    sides = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=1)
    steps = values.ravel()[few[:, 1:]] - values.ravel()[few[:, :1]]
    slopes = np.linalg.solve(sides, steps[..., None].astype(float))[..., 0]  # (F, 2)
    offset = places[:, None] - corners[None, :, 0]
    planes = values.ravel()[few[:, 0]] + (offset * slopes).sum(-1)  # (N, F)
    errors = np.abs(planes - values.ravel()[removed][:, None])
    at_pixel = np.where(covering(places, triangles), errors, np.inf).min(axis=1)

    p, q = (as_points(end).astype(float) for end in border_edges(few).T)
    share = ((places[:, None] - p) * (q - p)).sum(-1) / ((q - p) ** 2).sum(-1)
    share = share.clip(0, 1)
    far = np.linalg.norm(places[:, None] - p - share[..., None] * (q - p), axis=-1)
    low, high = (values.ravel()[end] for end in border_edges(few).T)
    there = np.abs(low + share * (high - low) - values.ravel()[removed][:, None])
    at_border = np.where(far <= BORDER_PX + 1e-9, there, np.inf).min(axis=1)
    return removed, np.minimum(at_pixel, at_border)


@pytest.mark.parametrize("seed", range(6))
def test_every_removed_vertex_is_within_the_tolerance_of_what_is_left(seed):
    values = rough_scene(seed)
    full, few = full_and_decimated(values)

    _, errors = errors_of_removed(values, full, few)

    assert len(few) < 0.6 * len(full)
    assert errors.max() <= 0.5 + 1e-4


@pytest.mark.parametrize("seed", range(3))
def test_every_removed_vertex_is_within_its_own_tolerance(seed):
    values = rough_scene(seed)
    tolerance = np.where(np.arange(WIDTH) < WIDTH // 2, 0.05, 0.5) * np.ones((HEIGHT, 1))
    full = grid_faces(values, np.isfinite(values), depth_edge_px=1.0)

    few = simplified(
        values.astype(np.float32), full, tolerance=tolerance, border=BORDER_PX, shift=np.inf
    )

    removed, errors = errors_of_removed(values, full, few)
    assert (errors <= tolerance.ravel()[removed] + 1e-4).all()
    assert errors.max() > 0.2
    of_halves = np.bincount(removed % WIDTH >= WIDTH // 2)
    assert of_halves[0] < 0.7 * of_halves[1]


@pytest.mark.parametrize("seed", range(20))
def test_a_triangle_lies_on_triangles_that_were_there_so_it_bridges_no_jump(seed):
    full, few = full_and_decimated(rough_scene(seed), sigma=40.0)
    weights = np.random.default_rng(seed).dirichlet((0.6, 0.6, 0.6), (len(few), 12))

    points = (weights @ as_points(few).astype(float)).reshape(-1, 2)

    assert len(few) < 0.3 * len(full)
    assert covered_by_cells(points, full).all()


@pytest.mark.parametrize("seed", range(3))
def test_no_two_triangles_overlap_and_none_is_turned_over(seed):
    _, few = full_and_decimated(rough_scene(seed))
    grid = np.stack(np.mgrid[:WIDTH:0.61, :HEIGHT:0.61], axis=-1).reshape(-1, 2)

    assert (area(as_points(few)) > 0).all()
    assert covering(grid, as_points(few), slack=-1e-9).sum(axis=1).max() <= 1


@pytest.mark.parametrize("seed", range(3))
def test_inside_a_surface_there_are_no_cracks(seed):
    """What is covered shrinks only at the outline, by less than half a pixel."""
    full, few = full_and_decimated(rough_scene(seed))
    grid = np.stack(np.mgrid[:WIDTH:0.61, :HEIGHT:0.61], axis=-1).reshape(-1, 2)

    before = covered_by_cells(grid, full)
    after = covering(grid, as_points(few)).any(axis=1)

    lost = grid[before & ~after]
    p, q = (as_points(end).astype(float) for end in border_edges(full).T)
    share = ((lost[:, None] - p) * (q - p)).sum(-1) / ((q - p) ** 2).sum(-1)
    far = np.linalg.norm(lost[:, None] - p - share.clip(0, 1)[..., None] * (q - p), axis=-1)
    assert not (after & ~before).any()
    assert far.min(axis=1, initial=9).max(initial=0) <= BORDER_PX


def test_a_flat_wall_is_two_triangles_and_keeps_its_corners():
    mesh = settings(1.0)(a_disparity_map(constant(9.0)), a_pair())

    assert len(mesh.faces) == 2
    assert {tuple(p) for p in pixels_of(mesh)} == {
        (x, y) for x in (0, WIDTH - 1) for y in (0, HEIGHT - 1)
    }


def test_the_texture_slides_by_half_a_pixel_at_most():
    """On a slanted wall the middle of a side in space is not the middle of it in the picture."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    disparity = a_disparity_map(6 + 0.6 * x + 0.1 * y)
    mesh = settings(1.0)(disparity, a_pair())

    weights = np.linspace(0, 1, 21)[:, None, None]
    ends = [mesh.faces[:, [0, 1, 2]].ravel(), mesh.faces[:, [1, 2, 0]].ravel()]
    first, second = (mesh.vertices[end].astype(float) for end in ends)
    X, Y, Z = np.moveaxis(first * (1 - weights) + second * weights, -1, 0)
    pictured = np.stack([60.0 * X / Z + 24.5, 60.0 * Y / Z + 18.25], axis=-1)
    first, second = (mesh.uv[end] * (WIDTH, HEIGHT) - 0.5 for end in ends)
    shown = first * (1 - weights) + second * weights

    slide = np.linalg.norm(pictured - shown, axis=-1).max()
    assert 0.3 < slide <= 0.5 + 1e-3
    assert 2 < len(mesh.faces) < 200


def test_a_depth_edge_stays_where_it_is():
    values = constant(5.0)
    values[10:30, 15:40] = 12.0

    mesh = settings(1.0)(a_disparity_map(values), a_pair())

    front = pixels_of(mesh)[mesh.vertices[:, 2] < mesh.vertices[:, 2].mean()]
    assert {tuple(p) for p in front} == {(15, 10), (39, 10), (15, 29), (39, 29)}
    assert len(mesh.faces) < 20


@pytest.mark.parametrize("size", [2, 3])
def test_a_cell_across_a_jump_is_never_closed(size):
    """A gap between four pixels holds no pixel, so only the outline can tell of it."""
    values = constant(8.0)
    values[20, 20 : 20 + size] = 9.5

    _, few = full_and_decimated(values, sigma=40.0)

    centres = np.array([[20 + step + 0.5, 19.5] for step in range(size - 1)])
    assert not covering(centres, as_points(few)).any()


def test_more_tolerance_leaves_fewer_triangles_and_none_leaves_all():
    disparity = a_disparity_map(rough_scene(4))

    counts = [len(settings(s)(disparity, a_pair()).faces) for s in (0, 0.25, 0.5, 1, 2, 4)]

    assert counts[0] == len(
        grid_faces(
            disparity.values,
            settings(0).points.kept_pixels(disparity, a_pair().geometry),
            depth_edge_px=1.0,
        )
    )
    assert sorted(counts, reverse=True) == counts


def test_faces_that_are_given_stay_as_they_are():
    values = constant(8.0)
    faces = grid_faces(values, np.ones(values.shape, bool), depth_edge_px=1.0)
    before = faces.copy()

    simplified(values, faces, tolerance=0.1, border=0.5, shift=0.5)

    np.testing.assert_array_equal(faces, before)


def test_colours_and_texture_places_of_what_is_left_are_those_of_the_pixels():
    mesh = settings(1.0)(a_disparity_map(rough_scene(1)), a_pair())

    x, y = pixels_of(mesh).T
    np.testing.assert_array_equal(mesh.colours, mesh.texture[y, x])
    np.testing.assert_allclose(mesh.uv * (WIDTH, HEIGHT) - 0.5, pixels_of(mesh), atol=1e-4)


@pytest.mark.parametrize("sigma", [0, 1.0])
def test_normals_of_a_slanted_wall_are_those_of_its_plane(sigma):
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    mesh = settings(sigma)(a_disparity_map(20 + 0.3 * x - 0.2 * y), a_pair())

    a, b, c = mesh.vertices[[0, 1, -1]].astype(float)
    plane = np.cross(b - a, c - a)
    plane *= -np.sign(plane @ a) / np.linalg.norm(plane)
    np.testing.assert_allclose(mesh.normals, np.tile(plane, (len(mesh.normals), 1)), atol=2e-3)


def test_normals_do_not_mix_across_a_depth_edge():
    x = np.mgrid[:HEIGHT, :WIDTH][1]
    values = 10 + 0.4 * x
    values[:, 26:] = 40 - 0.4 * x[:, 26:]
    mesh = settings(0)(a_disparity_map(values), a_pair())

    left = pixels_of(mesh)[:, 0] < 26
    for side in (left, ~left):
        np.testing.assert_allclose(
            mesh.normals[side], mesh.normals[side][:1].repeat(side.sum(), axis=0), atol=2e-3
        )


@pytest.mark.parametrize("seed", range(3))
def test_normals_have_unit_length_and_look_at_the_camera(seed):
    mesh = settings(1.0)(a_disparity_map(rough_scene(seed)), a_pair())

    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, rtol=1e-5)
    assert ((mesh.normals * mesh.vertices).sum(axis=1) < 0).mean() > 0.97


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"decimation_sigma": -0.1}, "decimation_sigma must be 0 or more, got -0.1"),
        ({"decimation_sigma": float("nan")}, "decimation_sigma must be 0 or more, got nan"),
        ({"watertight_depth": 13}, "watertight_depth must be 1 to 12, got 13"),
        ({"watertight_reach_px": -1.0}, "watertight_reach_px must be 0 or more, got -1"),
    ],
)
def test_impossible_settings_of_what_is_left_are_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        Meshing(**wrong)
