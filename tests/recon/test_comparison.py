import dataclasses
import json
import re

import numpy as np
import pytest
from test_cloud_filters import a_wall
from test_files import a_cloud, a_mesh

from recon.cli import main
from recon.comparison import compare, read_shape, scale_hint
from recon.comparison.drawing import drawn
from recon.comparison.figures import direction_figures
from recon.files import write_cloud, write_glb
from recon.sample_pairs import sample_folder


def saved(path, cloud):
    write_cloud(path, cloud)
    return path


def moved(cloud, *, by=(0, 0, 0), times=1.0):
    points = (cloud.points * times + np.array(by)).astype(np.float32)
    return dataclasses.replace(cloud, points=points)


def a_relief():
    """Return a wall with a wave in it, 2 m away, so that no motion leaves it as it is."""
    wall = a_wall(2.0, rows=120, columns=160)
    x, y, z = wall.points.T
    points = np.stack([x, y, z + 0.1 * np.sin(5 * x) + 0.1 * np.cos(4 * y)], axis=1)
    return dataclasses.replace(wall, points=points.astype(np.float32))


@pytest.mark.parametrize("ending", [".ply", ".npz", ".laz"])
def test_a_cloud_is_read_with_what_is_known_of_it(tmp_path, ending):
    cloud = a_cloud()

    shape = read_shape(saved(tmp_path / f"a{ending}", cloud))

    np.testing.assert_allclose(shape.points, cloud.points, atol=1e-6)
    np.testing.assert_array_equal(shape.colours, cloud.colours)
    np.testing.assert_array_equal(shape.sigma_m, cloud.depth_sigma_m)
    assert shape.asked.all()
    assert shape.faces is None


def test_the_cloud_stands_for_a_folder_of_results(tmp_path):
    write_glb(tmp_path / "mesh.glb", a_mesh())
    cloud = a_cloud()
    write_cloud(tmp_path / "cloud.ply", cloud)

    np.testing.assert_array_equal(read_shape(tmp_path).points, cloud.points)


def test_a_mesh_is_sampled_on_its_faces_in_the_frame_of_the_camera(tmp_path):
    mesh = a_mesh()
    write_glb(tmp_path / "m.glb", mesh)

    shape = read_shape(tmp_path / "m.glb")

    np.testing.assert_allclose(shape.vertices, mesh.vertices, rtol=1e-6)
    x, y, z = shape.points.T
    np.testing.assert_allclose(z, 2 + 0.1 * x, atol=1e-5)  # the sheet that a_mesh is
    assert (x.min() < 0.1, x.max() > 3.9, y.max() > 1.4) == (True, True, True)
    assert x.mean() == pytest.approx(2, abs=0.02)


def test_the_truth_of_a_pair_is_a_cloud_whose_hidden_points_are_not_asked():
    shape = read_shape(sample_folder() / "workshop")

    assert shape.sigma_m is None
    assert 0.8 < shape.asked.mean() < 1
    assert (shape.points[:, 2] > 0).all()


def test_a_cloud_of_another_program_is_read_without_what_it_lacks(tmp_path):
    (tmp_path / "a.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
        "property float z\nend_header\n0 0 1\n0 1 2\n"
    )

    shape = read_shape(tmp_path / "a.ply")

    np.testing.assert_array_equal(shape.points, [[0, 0, 1], [0, 1, 2]])
    assert shape.sigma_m is None


def test_what_cannot_be_compared_is_named(tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "a.txt").write_text("1 2 3")
    (tmp_path / "broken.ply").write_bytes(b"ply\nformat binary_little_endian 1.0\nnonsense")
    none = saved(tmp_path / "none.ply", a_cloud().chosen(np.zeros(50, bool)))

    for name, message in {
        "missing": "there is no file or folder .*missing",
        "empty": r"empty holds no result \(cloud.ply, .*\) and no pair with truth",
        "a.txt": r"a.txt is of no format that can be compared: \.glb, ",
        "broken.ply": "broken.ply",
    }.items():
        with pytest.raises((ValueError, FileNotFoundError), match=message):
            read_shape(tmp_path / name)
    with pytest.raises(ValueError, match=r"none.ply holds no points"):
        read_shape(none)
    with pytest.raises(ValueError, match="holds 2 scenes; give one of them: "):
        read_shape(sample_folder())


@pytest.mark.parametrize(
    ("times", "hint"),
    [
        (1.0, "^$"),
        (1.5, "^$"),
        (1000.0, r"^B is about 1000 times as large: wrong units \(millimetres for metres\)\?"),
        (0.01, r"^A is about 100 times as large: wrong units \(centimetres for metres\)\?"),
        (5.0, "^B is 5 times as large; do both show the same scene"),
    ],
)
def test_sizes_tell_of_wrong_units(times, hint):
    points = a_cloud(500).points

    assert re.search(hint, scale_hint(points, times * points))


@pytest.mark.slow  # imports open3d
def test_a_shift_is_the_distance_in_both_directions(tmp_path):
    wall = a_wall(2.0, rows=60, columns=60)
    a = read_shape(saved(tmp_path / "a.ply", wall))
    b = read_shape(saved(tmp_path / "b.ply", moved(wall, by=(0, 0, 0.004))))

    found = compare(a, b)

    for direction in (found.a_to_b, found.b_to_a):
        np.testing.assert_allclose(direction.distances, 0.004, rtol=1e-3)
        figures = direction_figures(direction)
        assert figures["median_m"] == pytest.approx(0.004, rel=1e-3)
        assert (figures["within_1%"], figures["within_3_sigma"]) == (100, 100)


@pytest.mark.slow
def test_where_only_the_other_side_knows_sigma_that_of_the_nearest_point_counts(tmp_path):
    wall = a_wall(2.0)
    sigma = np.linspace(0.1, 0.2, len(wall)).astype(np.float32)
    wall = dataclasses.replace(wall, depth_sigma_m=sigma)
    a = read_shape(saved(tmp_path / "a.ply", wall))
    b = dataclasses.replace(a, sigma_m=None)
    without = dataclasses.replace(a, sigma_m=None)

    np.testing.assert_array_equal(compare(a, b).b_to_a.sigma_m, sigma)
    assert direction_figures(compare(without, b).a_to_b)["within_3_sigma"] is None


@pytest.mark.slow
def test_shares_are_below_the_limit_and_only_of_points_that_are_asked(tmp_path):
    wall = a_wall(2.0)
    far = np.zeros(len(wall), bool)
    far[:300] = True
    b = moved(wall, by=(0, 0, 0))
    points = wall.points * np.where(far, 1.03, 1.001)[:, None]
    a = read_shape(
        saved(tmp_path / "a.ply", dataclasses.replace(wall, points=points.astype(np.float32)))
    )
    a = dataclasses.replace(a, asked=~far | (np.arange(len(wall)) < 100))

    found = compare(a, read_shape(saved(tmp_path / "b.ply", b)))

    figures = direction_figures(found.a_to_b)
    assert figures["points"] == len(wall) - 200
    assert figures["within_5%"] == 100
    assert figures["within_1%"] == pytest.approx(100 * (1 - 100 / (len(wall) - 200)), abs=0.01)


@pytest.mark.slow
def test_a_cloud_on_a_mesh_is_at_distance_nothing(tmp_path):
    write_glb(tmp_path / "m.glb", a_mesh())
    x, y = np.random.default_rng(0).uniform((0, 0), (4, 1.5), (200, 2)).T
    points = np.stack([x, y, 2 + 0.1 * x], axis=1).astype(np.float32)
    cloud = dataclasses.replace(a_cloud(200), points=points)

    found = compare(read_shape(saved(tmp_path / "a.ply", cloud)), read_shape(tmp_path / "m.glb"))

    assert found.a_to_b.distances.max() < 1e-5
    assert found.b_to_a.distances.max() > 0.01  # 200 points do not cover the sheet
    np.testing.assert_array_equal(found.a_to_b.sigma_m, cloud.depth_sigma_m)


@pytest.mark.slow
def test_alignment_finds_the_motion_that_was_made(tmp_path):
    relief = a_relief()
    angle = np.radians(1.5)
    turn = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    shift = np.array([0.01, -0.02, 0.015])
    points = (relief.points @ turn.T + shift).astype(np.float32)
    a = read_shape(saved(tmp_path / "a.ply", relief))
    b = read_shape(saved(tmp_path / "b.ply", dataclasses.replace(relief, points=points)))

    left_alone, found = compare(a, b), compare(a, b, align=True)

    pose = found.alignment.b_from_a
    np.testing.assert_allclose(pose[:3, :3], turn, atol=1e-3)
    np.testing.assert_allclose(pose[:3, 3], shift, atol=2e-3)
    assert found.alignment.rotation_deg == pytest.approx(1.5, abs=0.05)
    before = direction_figures(left_alone.a_to_b)["median_m"]
    assert found.alignment.median_before_m == pytest.approx(before)
    assert direction_figures(found.a_to_b)["median_m"] < before / 5


@pytest.mark.slow
def test_the_command_leaves_figures_a_coloured_cloud_and_a_page(tmp_path, capsys):
    wall = a_wall(2.0)
    a = saved(tmp_path / "a.ply", wall)
    b = saved(tmp_path / "b.ply", moved(wall, times=1000))
    out = tmp_path / "out"

    main(["compare", str(a), str(b), "-o", str(out)])

    said = capsys.readouterr()
    assert "B is about 1000 times as large: wrong units" in said.err
    assert "from A to B" in said.out
    names = {"compare.html", "compare.json", "a_by_distance.ply"}
    assert {path.name for path in out.iterdir()} == names
    figures = json.loads((out / "compare.json").read_text())
    assert figures["a to b"]["points"] == len(wall)
    assert figures["b"]["to_m"][2] == pytest.approx(2000)
    page = (out / "compare.html").read_text()
    assert page.count("data:image/png;base64,") == 12
    assert "wrong units" in page
    assert not re.search(r"""(src|href)=["']?https?:""", page)
    header = (out / "a_by_distance.ply").read_bytes()[:500].decode("ascii", errors="replace")
    assert "property float distance_m" in header
    assert "comment colour: distance, dark blue at 0, red from" in header


def test_the_command_names_what_is_missing_and_leaves_nothing(tmp_path, capsys):
    a = saved(tmp_path / "a.ply", a_cloud())

    with pytest.raises(SystemExit):
        main(["compare", str(a), str(tmp_path / "b.ply"), "-o", str(tmp_path / "out")])

    assert "there is no file or folder" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("view", "farther"),
    [("from the camera", (2, 2, 4)), ("from above", (1, 3, 2)), ("from the right", (-1, 1, 2))],
)
def test_the_nearer_of_two_points_is_seen(view, farther):
    points = np.array([(1, 1, 2), farther], np.float32)
    colours = np.array([(0, 0, 255), (255, 0, 0)], np.uint8)
    box = np.array([(0, 0, 1), (2, 2, 4)], np.float32)

    for order in ([0, 1], [1, 0]):
        picture = drawn(points[order], colours[order], view, box)

        assert (picture == (0, 0, 255)).all(axis=2).any()
        assert not (picture == (255, 0, 0)).all(axis=2).any()
