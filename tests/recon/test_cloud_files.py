import dataclasses

import laspy
import numpy as np
import pytest
import trimesh
from test_files import a_cloud

from recon.files import CLOUD_FORMATS, read_cloud, write_cloud
from recon.types import PointCloud

FIELDS = [field.name for field in dataclasses.fields(PointCloud)]


@pytest.mark.parametrize("ending", CLOUD_FORMATS)
def test_a_cloud_comes_back_from_every_format(tmp_path, ending):
    cloud = a_cloud()

    write_cloud(tmp_path / f"a{ending}", cloud)

    back = read_cloud(tmp_path / f"a{ending}")
    half_a_step = 0.5e-6 if ending in (".las", ".laz") else 0
    np.testing.assert_allclose(back.points, cloud.points, atol=1.1 * half_a_step, rtol=1e-7)
    for name in FIELDS[1:]:
        np.testing.assert_array_equal(getattr(back, name), getattr(cloud, name))
        assert getattr(back, name).dtype == getattr(cloud, name).dtype


@pytest.mark.parametrize("ending", CLOUD_FORMATS)
def test_an_empty_cloud_is_a_cloud(tmp_path, ending):
    write_cloud(tmp_path / f"a{ending}", a_cloud().chosen(np.zeros(50, bool)))

    assert len(read_cloud(tmp_path / f"a{ending}")) == 0


@pytest.mark.parametrize("ending", CLOUD_FORMATS)
def test_a_file_cut_short_is_refused_by_name(tmp_path, ending):
    write_cloud(tmp_path / f"a{ending}", a_cloud())
    whole = (tmp_path / f"a{ending}").read_bytes()
    (tmp_path / f"b{ending}").write_bytes(whole[: len(whole) // 3])

    with pytest.raises(ValueError, match=f"b{ending}"):
        read_cloud(tmp_path / f"b{ending}")


@pytest.mark.parametrize("ending", CLOUD_FORMATS)
def test_a_missing_cloud_is_a_missing_file(tmp_path, ending):
    with pytest.raises(FileNotFoundError, match=f"none{ending}"):
        read_cloud(tmp_path / f"none{ending}")


def test_an_ending_of_no_cloud_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"a\.xyz does not end as a cloud does: \.ply, \.npz"):
        write_cloud(tmp_path / "a.xyz", a_cloud())


def test_numpy_alone_reads_the_archive(tmp_path):
    cloud = a_cloud()

    write_cloud(tmp_path / "a.npz", cloud)

    with np.load(tmp_path / "a.npz", allow_pickle=False) as archive:
        assert set(archive.files) == {*FIELDS, "frame"}
        assert str(archive["frame"]).startswith("metres; left rectified camera: x right")
        np.testing.assert_array_equal(archive["points"], cloud.points)


def test_an_archive_of_something_else_is_refused(tmp_path):
    np.savez(tmp_path / "a.npz", points=np.zeros((3, 3)))

    with pytest.raises(ValueError, match=r"lacks \['colours', 'confidence', 'depth_sigma_m', 'nor"):
        read_cloud(tmp_path / "a.npz")


@pytest.mark.parametrize("ending", [".las", ".laz"])
def test_las_is_z_up_and_coloured_in_16_bits(tmp_path, ending):
    cloud = a_cloud()

    write_cloud(tmp_path / f"a{ending}", cloud)

    las = laspy.read(tmp_path / f"a{ending}")
    x, y, z = cloud.points.T
    np.testing.assert_allclose(las.xyz, np.stack([x, z, -y], axis=1), atol=1e-6)
    np.testing.assert_array_equal(las["nz"], -cloud.normals[:, 1])
    assert las.red.max() == 257 * int(cloud.colours[:, 0].max())
    assert (las.header.version, las.header.point_format.id) == ("1.4", 7)
    assert las.header.are_points_compressed == (ending == ".laz")


@pytest.mark.parametrize(("farthest", "scale"), [(3.0, 1e-6), (2000.0, 1e-6), (5e5, 1e-3)])
def test_las_coordinates_are_as_fine_as_the_farthest_point_allows(tmp_path, farthest, scale):
    cloud = a_cloud()
    points = cloud.points.copy()
    points[7] = (0, 0, farthest)
    cloud = dataclasses.replace(cloud, points=points)

    write_cloud(tmp_path / "a.las", cloud)

    assert laspy.read(tmp_path / "a.las").header.scales[0] == pytest.approx(scale)
    np.testing.assert_allclose(read_cloud(tmp_path / "a.las").points, points, atol=scale)


def test_the_las_of_another_program_is_refused(tmp_path):
    las = laspy.create(point_format=7, file_version="1.4")
    las.xyz = np.zeros((2, 3))
    las.write(str(tmp_path / "foreign.las"))

    with pytest.raises(ValueError, match=r"foreign.las was written by 'laspy.*expected a cloud"):
        read_cloud(tmp_path / "foreign.las")


def test_trimesh_reads_points_and_colours_of_the_ply(tmp_path):
    cloud = a_cloud()

    write_cloud(tmp_path / "a.ply", cloud)

    read = trimesh.load(tmp_path / "a.ply")
    np.testing.assert_array_equal(read.vertices, cloud.points)
    np.testing.assert_array_equal(read.colors[:, :3], cloud.colours)


@pytest.mark.slow  # imports open3d
def test_both_readers_of_open3d_take_normals_and_colours_from_the_ply(tmp_path):
    import open3d

    cloud = a_cloud()

    write_cloud(tmp_path / "a.ply", cloud)

    legacy = open3d.io.read_point_cloud(str(tmp_path / "a.ply"))
    np.testing.assert_allclose(np.asarray(legacy.normals), cloud.normals)
    np.testing.assert_allclose(np.asarray(legacy.colors) * 255, cloud.colours, atol=1e-4)
    tensor = open3d.t.io.read_point_cloud(str(tmp_path / "a.ply")).point
    np.testing.assert_array_equal(tensor.normals.numpy(), cloud.normals)


@pytest.mark.parametrize(
    "normals", [np.full((50, 3), np.nan, np.float32), np.ones((50, 3), np.float32)]
)
def test_normals_that_are_none_are_refused(normals):
    with pytest.raises(ValueError, match="normals must be of unit length, and none may be NaN"):
        dataclasses.replace(a_cloud(), normals=normals)
