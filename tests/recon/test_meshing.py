import numpy as np
import pytest

from calib.pair import RectifiedPair
from calib.rig import RectifiedGeometry
from recon.meshing import Meshing, components, grid_faces
from recon.triangulation import Triangulation, depth_map
from recon.types import DisparityMap, PixelStatus

HEIGHT, WIDTH = 40, 52
GEOMETRY = RectifiedGeometry(
    size=(WIDTH, HEIGHT),
    focal_px=60.0,
    centre_left=(24.5, 18.25),
    centre_right=(27.0, 18.25),
    baseline_m=0.1,
)
WHOLE = Meshing(min_component_faces=1, decimation_sigma=0)


def a_disparity_map(values):
    values = np.asarray(values, np.float32)
    present = np.isfinite(values)
    status = np.where(present, PixelStatus.MATCHED, PixelStatus.OCCLUDED).astype(np.uint8)
    return DisparityMap(values, status, present.astype(np.float32))


def a_pair(geometry=GEOMETRY):
    width, height = geometry.size
    left, right = np.random.default_rng(0).integers(0, 256, (2, height, width, 3), dtype=np.uint8)
    return RectifiedPair(left, right, geometry)


def constant(value):
    return np.full((HEIGHT, WIDTH), value, np.float32)


def pixels_of(mesh):
    """Return (V, 2) whole x, y of the pixels that the vertices came from, by projection."""
    X, Y, Z = mesh.vertices.astype(np.float64).T
    x, y = 60.0 * X / Z + 24.5, 60.0 * Y / Z + 18.25
    return np.rint(np.stack([x, y], axis=1)).astype(int)


def rough_scene(seed):
    """Return random plates, slopes, noise and holes."""
    random = np.random.default_rng(seed)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    values = 8 + random.uniform(-0.6, 0.6) * x / 4 + random.uniform(-0.6, 0.6) * y / 4
    for _ in range(6):
        top, left = random.integers(0, HEIGHT - 8), random.integers(0, WIDTH - 8)
        plate = np.s_[top : top + random.integers(2, 20), left : left + random.integers(2, 20)]
        values[plate] = random.uniform(5, 30) + random.uniform(-0.8, 0.8) * x[plate]
    values += random.normal(0, 0.3, values.shape)
    values[random.random(values.shape) < 0.05] = np.nan
    return values.astype(np.float32)


def test_a_flat_wall_is_covered_by_two_triangles_a_square():
    mesh = WHOLE(a_disparity_map(constant(8.0)), a_pair())

    assert len(mesh.vertices) == HEIGHT * WIDTH
    assert len(mesh.faces) == 2 * (HEIGHT - 1) * (WIDTH - 1)
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    depth = 60.0 * 0.1 / (8.0 + 2.5)
    area = (HEIGHT - 1) * (WIDTH - 1) * (depth / 60.0) ** 2
    np.testing.assert_allclose(np.linalg.norm(crosses, axis=1).sum() / 2, area, rtol=1e-5)


@pytest.mark.parametrize("seed", range(5))
def test_normals_point_to_the_camera(seed):
    mesh = WHOLE(a_disparity_map(rough_scene(seed)), a_pair())

    corners = mesh.vertices[mesh.faces].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])

    assert len(mesh.faces) > 100
    assert ((normals * corners.mean(axis=1)).sum(axis=1) < 0).all()


@pytest.mark.parametrize("seed", range(20))
def test_no_triangle_bridges_a_jump_of_disparity(seed):
    values = rough_scene(seed)

    mesh = WHOLE(a_disparity_map(values), a_pair())

    x, y = pixels_of(mesh).T
    at_corners = values[y, x][mesh.faces]
    assert len(mesh.faces) > 100
    assert np.ptp(at_corners, axis=1).max() <= 1.0


@pytest.mark.parametrize("seed", range(5))
def test_triangles_join_neighbouring_pixels_and_never_overlap(seed):
    mesh = WHOLE(a_disparity_map(rough_scene(seed)), a_pair())

    corners = pixels_of(mesh)[mesh.faces]  # (F, 3, 2)
    assert (np.ptp(corners, axis=1) == 1).all()
    doubled = corners.sum(axis=1) * 2  # a triangle is named by its centre of mass, times six
    assert len(np.unique(doubled, axis=0)) == len(mesh.faces)
    _, counts = np.unique(corners.min(axis=1), axis=0, return_counts=True)
    assert counts.max() <= 2


@pytest.mark.parametrize("slope", [(0.95, 0.0), (0.0, 0.95), (0.9, 0.9), (-0.9, 0.9), (0.5, -0.7)])
def test_a_steep_plane_has_no_holes(slope):
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    plane = 60 + slope[0] * x + slope[1] * y

    mesh = WHOLE(a_disparity_map(plane), a_pair())

    assert len(mesh.faces) == 2 * (HEIGHT - 1) * (WIDTH - 1)


def test_a_square_is_cut_along_the_diagonal_with_the_smaller_step():
    falling = np.array([[5.0, 5.4], [4.6, 5.0]], np.float32)
    rising = falling[:, ::-1]
    everything = np.ones((2, 2), bool)

    def diagonals(values):
        faces = grid_faces(values, everything, depth_edge_px=1.0)
        return set.intersection(*(set(face.tolist()) for face in faces))

    assert diagonals(falling) == {0, 3}
    assert diagonals(rising) == {1, 2}


def test_a_square_with_one_corner_missing_keeps_the_other_triangle():
    for corner in range(4):
        kept = np.ones((2, 2), bool)
        kept.flat[corner] = False

        faces = grid_faces(np.full((2, 2), 5.0, np.float32), kept, depth_edge_px=1.0)

        assert [set(face.tolist()) for face in faces] == [{0, 1, 2, 3} - {corner}]


def test_a_vertex_has_the_colour_of_its_texel():
    mesh = WHOLE(a_disparity_map(rough_scene(1)), a_pair())

    u, v = mesh.uv.T
    texels = mesh.texture[(v * HEIGHT).astype(int), (u * WIDTH).astype(int)]
    np.testing.assert_array_equal(texels, mesh.colours)
    np.testing.assert_allclose(mesh.uv * (WIDTH, HEIGHT) - 0.5, pixels_of(mesh), atol=1e-4)


def test_vertices_are_the_points_of_the_cloud():
    disparity = a_disparity_map(rough_scene(2))

    mesh = WHOLE(disparity, a_pair())

    cloud = Triangulation()(disparity, a_pair())
    assert {tuple(point) for point in mesh.vertices} <= {tuple(point) for point in cloud.points}


def test_every_vertex_is_used():
    mesh = Meshing(min_component_faces=20, decimation_sigma=0)(
        a_disparity_map(rough_scene(3)), a_pair()
    )

    np.testing.assert_array_equal(np.unique(mesh.faces), np.arange(len(mesh.vertices)))


def test_small_fragments_vanish_and_large_pieces_stay_whole():
    values = constant(np.nan)
    values[2:5, 2:5] = 9.0  # 8 faces
    values[2:6, 10:14] = 9.0  # 18 faces
    values[10:30, 10:30] = 9.0  # 722 faces

    def faces(smallest):
        pieces = Meshing(min_component_faces=smallest, decimation_sigma=0)
        return len(pieces(a_disparity_map(values), a_pair()).faces)

    assert [faces(n) for n in (1, 8, 9, 18, 19, 722, 723)] == [748, 748, 740, 740, 722, 722, 0]


def test_a_piece_that_winds_is_one_component():
    values = constant(np.nan)
    for row in range(0, HEIGHT - 4, 4):
        values[row : row + 2] = 9.0
        column = np.s_[:2] if row % 8 else np.s_[-2:]
        values[row : row + 6, column] = 9.0
    disparity = a_disparity_map(values)

    total = len(WHOLE(disparity, a_pair()).faces)

    largest = Meshing(min_component_faces=total, decimation_sigma=0)
    assert len(largest(disparity, a_pair()).faces) == total


def components_slowly(faces):
    """Return the least vertex of the piece of each face, by spreading it until all agree."""
    least = {vertex: vertex for face in faces for vertex in face}
    for _ in faces:
        for face in faces:
            lowest = min(least[vertex] for vertex in face)
            least.update(dict.fromkeys(face, lowest))
    return [least[face[0]] for face in faces]


@pytest.mark.parametrize("seed", range(30))
def test_components_are_those_of_a_slow_search(seed):
    faces = np.random.default_rng(seed).integers(0, 60, (24, 3), dtype=np.int32)

    assert components(faces, 60).tolist() == components_slowly(faces.tolist())


def test_given_pixels_are_the_only_vertices():
    kept = np.zeros((HEIGHT, WIDTH), bool)
    kept[5:15, 8:20] = True

    mesh = WHOLE(a_disparity_map(constant(8.0)), a_pair(), kept=kept)

    x, y = pixels_of(mesh).T
    assert len(mesh.vertices) == 120
    assert kept[y, x].all()


def test_pixels_beyond_infinity_are_no_vertices():
    values = constant(8.0)
    values[:, 30:] = GEOMETRY.disparity_at_infinity - 0.2
    disparity = a_disparity_map(values)

    mesh = WHOLE(disparity, a_pair(), kept=np.ones(values.shape, bool))

    assert np.isfinite(mesh.vertices).all()
    assert len(mesh.vertices) == np.isfinite(depth_map(disparity, GEOMETRY)).sum()


@pytest.mark.parametrize("size", [(WIDTH, 1), (1, HEIGHT), (1, 1)])
def test_a_line_of_pixels_has_no_faces(size):
    geometry = RectifiedGeometry(size, 60.0, (0.0, 0.0), (0.0, 0.0), 0.1)

    mesh = Meshing()(a_disparity_map(np.full(size[::-1], 5.0)), a_pair(geometry))

    assert (len(mesh.faces), len(mesh.vertices)) == (0, 0)


def test_a_disparity_of_another_size_is_refused():
    with pytest.raises(ValueError, match=r"disparity is \(39, 52\) but the left image is \(40, 52"):
        Meshing()(a_disparity_map(constant(5.0)[1:]), a_pair())


def test_impossible_settings_are_refused():
    with pytest.raises(ValueError, match="min_component_faces must be at least 1, got 0"):
        Meshing(min_component_faces=0)
