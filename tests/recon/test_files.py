import dataclasses
import json
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from PIL import Image as Pictures

from recon.colours import MISSING_COLOUR, STATUS_COLOURS, colour_mapped, colour_range
from recon.files import (
    atomic,
    read_image,
    read_image_pair,
    read_pfm,
    read_ply,
    read_side_by_side,
    write_depth_png,
    write_disparity_png,
    write_glb,
    write_image,
    write_json,
    write_pfm,
    write_ply,
    write_status_png,
)
from recon.types import Mesh, PixelStatus, PointCloud


def an_image(height=12, width=16, *, dtype=np.uint8, highest=255, seed=0):
    random = np.random.default_rng(seed)
    image = random.integers(0, highest + 1, (height, width, 3)).astype(dtype)
    image[0, 0] = highest
    return image


def save(path, image):
    """Write RGB, grey or RGBA of 8 or 16 bits, without the code under test."""
    if image.ndim == 3:
        image = image[..., [2, 1, 0, 3][: image.shape[2]]]
    _, contents = cv2.imencode(path.suffix, image)
    path.write_bytes(contents.tobytes())
    return path


def a_cloud(count=50, seed=0):
    random = np.random.default_rng(seed)
    directions = random.normal(0, 1, (count, 3))
    return PointCloud(
        points=random.normal(0, 3, (count, 3)).astype(np.float32),
        colours=random.integers(0, 256, (count, 3), dtype=np.uint8),
        normals=(directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32),
        confidence=random.random(count).astype(np.float32),
        depth_sigma_m=random.random(count).astype(np.float32),
        status=random.choice([1, 4, 5], count).astype(np.uint8),
    )


def a_mesh():
    """Return a tilted sheet of 5 x 4 vertices over a texture whose quarters differ in colour."""
    y, x = np.mgrid[:4, :5]
    texture = np.zeros((40, 50, 3), np.uint8)
    texture[:20, :25], texture[:20, 25:] = (200, 30, 20), (20, 180, 40)
    texture[20:, :25], texture[20:, 25:] = (10, 60, 220), (129, 81, 53)
    uv = np.stack([(x.ravel() + 0.5) / 5, (y.ravel() + 0.5) / 4], axis=1).astype(np.float32)
    corner = (np.arange(20).reshape(4, 5)[:-1, :-1]).reshape(-1, 1)
    return Mesh(
        vertices=np.stack([x, y * 0.5, 2 + 0.1 * x], axis=-1).reshape(-1, 3).astype(np.float32),
        faces=np.concatenate([corner + np.array(three) for three in ((0, 5, 6), (0, 6, 1))]).astype(
            np.int32
        ),
        uv=uv,
        texture=texture,
        colours=texture[(uv[:, 1] * 40).astype(int), (uv[:, 0] * 50).astype(int)],
        normals=np.tile(np.array([0.1, 0, -1], np.float32) / np.float32(1.01**0.5), (20, 1)),
    )


def gltf_of(path):
    """Return the JSON of a GLB and a reader of its buffer views."""
    contents = path.read_bytes()
    length = struct.unpack("<I", contents[12:16])[0]
    tree = json.loads(contents[20 : 20 + length])
    body = contents[28 + length :]

    def view(number):
        chosen = tree["bufferViews"][number]
        return body[chosen["byteOffset"] :][: chosen["byteLength"]]

    return tree, view


# photographs


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".tiff", ".ppm"])
def test_colour_images_come_back_in_rgb(tmp_path, suffix):
    image = an_image()

    write_image(tmp_path / f"a{suffix}", image)

    np.testing.assert_array_equal(read_image(tmp_path / f"a{suffix}"), image)


def test_red_stays_red(tmp_path):
    Pictures.new("RGB", (4, 3), (250, 10, 20)).save(tmp_path / "red.png")

    assert read_image(tmp_path / "red.png")[0, 0].tolist() == [250, 10, 20]


def test_grey_becomes_three_equal_channels(tmp_path):
    grey = an_image()[..., 0]

    image = read_image(save(tmp_path / "grey.png", grey))

    np.testing.assert_array_equal(image, np.repeat(grey[..., None], 3, axis=2))


def test_transparency_is_dropped(tmp_path):
    rgba = np.concatenate([an_image(), an_image(seed=1)[..., :1]], axis=2)

    np.testing.assert_array_equal(read_image(save(tmp_path / "a.png", rgba)), rgba[..., :3])


def test_names_may_hold_any_character(tmp_path):
    path = tmp_path / "レンズ é 1.png"
    image = an_image()

    write_image(path, image)

    np.testing.assert_array_equal(read_image(path), image)


@pytest.mark.parametrize(("bits", "shape"), [(16, 3), (12, 3), (10, 3), (14, 2), (8, 2)])
def test_sixteen_bits_are_scaled_by_the_depth_in_use(tmp_path, bits, shape):
    image = an_image(dtype=np.uint16, highest=2**bits - 1)
    image = image if shape == 3 else image[..., 0]

    read = read_image(save(tmp_path / "deep.png", image))

    expected = np.rint(image * (255 / (2**bits - 1))).astype(np.uint8)
    expected = expected if shape == 3 else np.repeat(expected[..., None], 3, axis=2)
    np.testing.assert_array_equal(read, expected)
    assert read[0, 0].tolist() == [255, 255, 255]


def test_full_range_is_divided_by_257(tmp_path):
    values = np.arange(256, dtype=np.uint16).reshape(16, 16) * 257

    read = read_image(save(tmp_path / "deep.png", values))

    np.testing.assert_array_equal(read[..., 0], values // 257)


def test_both_images_of_a_pair_are_scaled_alike(tmp_path):
    bright = an_image(dtype=np.uint16, highest=4095)
    dark = np.minimum(bright, 500)

    left, right = read_image_pair(save(tmp_path / "l.png", dark), save(tmp_path / "r.png", bright))

    np.testing.assert_array_equal(left, np.rint(dark * (255 / 4095)).astype(np.uint8))
    np.testing.assert_array_equal(right, np.rint(bright * (255 / 4095)).astype(np.uint8))


def test_a_pair_may_mix_colour_and_grey_and_depths(tmp_path):
    colour, grey = an_image(), an_image(dtype=np.uint16, highest=65535)[..., 0]

    left, right = read_image_pair(save(tmp_path / "l.png", colour), save(tmp_path / "r.png", grey))

    np.testing.assert_array_equal(left, colour)
    np.testing.assert_array_equal(right[..., 2], np.rint(grey / 257).astype(np.uint8))


def test_a_side_by_side_picture_is_halved(tmp_path):
    left, right = an_image(seed=1), an_image(seed=2)
    save(tmp_path / "both.png", np.concatenate([left, right], axis=1))

    halves = read_side_by_side(tmp_path / "both.png")

    np.testing.assert_array_equal(halves[0], left)
    np.testing.assert_array_equal(halves[1], right)


def test_a_missing_image_is_named_with_what_its_folder_holds(tmp_path):
    save(tmp_path / "im0.png", an_image())

    with pytest.raises(FileNotFoundError, match=r"no file .*left\.png; its folder holds im0\.png"):
        read_image(tmp_path / "left.png")
    with pytest.raises(FileNotFoundError, match=r"the folder .*nowhere does not exist either"):
        read_image(tmp_path / "nowhere" / "left.png")


def test_a_folder_is_not_an_image(tmp_path):
    with pytest.raises(IsADirectoryError, match="is a folder; expected an image file"):
        read_image(tmp_path)


@pytest.mark.parametrize(
    ("contents", "message"),
    [
        (b"", r"is empty \(0 bytes\)"),
        (b"Pf\n2 2\n-1.0\n" + bytes(16), "PFM map; read it with read_pfm"),
        (b"version https://git-lfs.github.com/spec/v1\n", "Git LFS pointer"),
        (b"<!DOCTYPE html><html></html>", "web page or XML"),
        (b"\0\0\0\x18ftypheic" + bytes(40), "HEIC picture or a video"),
        (b"hello, world", r"begins with b'hello, w'; expected PNG, JPEG, TIFF"),
    ],
)
def test_what_is_not_an_image_is_named(tmp_path, contents, message):
    (tmp_path / "left.png").write_bytes(contents)

    with pytest.raises(ValueError, match=message):
        read_image(tmp_path / "left.png")


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_a_truncated_image_is_refused(tmp_path, suffix):
    path = save(tmp_path / f"a{suffix}", an_image(64, 64))
    path.write_bytes(path.read_bytes()[:-200])

    with pytest.raises(ValueError, match="ends too early; was the copy interrupted"):
        read_image(path)


def test_a_jpeg_with_something_appended_is_read(tmp_path):
    path = save(tmp_path / "a.jpg", an_image(64, 64))
    before = read_image(path)

    path.write_bytes(path.read_bytes() + bytes(5000))

    np.testing.assert_array_equal(read_image(path), before)


def test_floating_point_images_are_refused(tmp_path):
    save(tmp_path / "colour.tiff", np.ones((4, 5, 3), np.float32))
    save(tmp_path / "grey.tiff", np.ones((4, 5), np.float32))

    with pytest.raises(ValueError, match="has float32 pixels; expected 8 or 16 bits"):
        read_image(tmp_path / "colour.tiff")
    with pytest.raises(ValueError, match=r"TIFF is damaged or of a kind .* such as floats"):
        read_image(tmp_path / "grey.tiff")


def test_a_pair_of_two_sizes_is_refused(tmp_path):
    left, right = save(tmp_path / "l.png", an_image()), save(tmp_path / "r.png", an_image(12, 15))

    with pytest.raises(ValueError, match=r"is 16 x 12 but right image .* is 15 x 12"):
        read_image_pair(left, right)


def test_an_odd_width_cannot_be_halved(tmp_path):
    save(tmp_path / "both.png", an_image(4, 7))

    with pytest.raises(ValueError, match="is 7 pixels wide, which cannot be halved"):
        read_side_by_side(tmp_path / "both.png")


def test_an_unknown_image_format_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"no image format ends in '\.docx'"):
        write_image(tmp_path / "a.docx", an_image())
    with pytest.raises(ValueError, match=r"'\.jpg' files hold 8 bits a channel, not 16"):
        write_image(tmp_path / "a.jpg", an_image(dtype=np.uint16))


# float maps


def a_float_map(seed=0):
    values = np.random.default_rng(seed).normal(30, 10, (7, 5)).astype(np.float32)
    values[2, 3] = values[0, 0] = np.nan
    return values


@pytest.mark.parametrize("big_endian", [False, True])
def test_a_pfm_round_trip_is_exact_to_the_byte(tmp_path, big_endian):
    values = a_float_map()
    write_pfm(tmp_path / "a.pfm", values, big_endian=big_endian)

    read = read_pfm(tmp_path / "a.pfm")
    write_pfm(tmp_path / "b.pfm", read, big_endian=big_endian)

    assert read.dtype == np.float32
    np.testing.assert_array_equal(read, values)
    assert (tmp_path / "a.pfm").read_bytes() == (tmp_path / "b.pfm").read_bytes()


@pytest.mark.parametrize(("scale", "order"), [("-0.003922", "<f4"), ("1", ">f4")])
def test_a_pfm_holds_the_bottom_row_first_in_the_order_of_its_sign(tmp_path, scale, order):
    rows = np.array([[1, 2, 3], [4, np.inf, 6]], order)
    (tmp_path / "a.pfm").write_bytes(f"Pf\n3 2\n{scale}\n".encode() + rows.tobytes())

    values = read_pfm(tmp_path / "a.pfm")

    np.testing.assert_array_equal(values, [[4, np.nan, 6], [1, 2, 3]])


def test_opencv_reads_the_pfm(tmp_path):
    values = np.nan_to_num(a_float_map())

    write_pfm(tmp_path / "a.pfm", values)

    read = cv2.imread(str(tmp_path / "a.pfm"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(read, values)


@pytest.mark.parametrize(
    ("contents", "message"),
    [
        (b"PF\n1 1\n-1.0\n" + bytes(12), "is a colour PFM; expected one channel"),
        (b"\x89PNG\r\n\x1a\n", "is not a PFM: it begins with"),
        (b"Pf\n4 3\n-1.0\n" + bytes(47), "4 x 3 pixels need 48 bytes, it has 47"),
        (b"Pf\n0 3\n-1.0\n", "is 0 x 3 pixels with scale -1; all must differ from 0"),
    ],
)
def test_a_broken_pfm_is_refused(tmp_path, contents, message):
    (tmp_path / "a.pfm").write_bytes(contents)

    with pytest.raises(ValueError, match=message):
        read_pfm(tmp_path / "a.pfm")


def test_a_pfm_has_one_channel(tmp_path):
    with pytest.raises(ValueError, match=r"is \(H, W\), got \(3, 4, 3\)"):
        write_pfm(tmp_path / "a.pfm", np.zeros((3, 4, 3)))


# pictures


def test_disparities_are_drawn_beside_their_bar(tmp_path):
    values = np.tile(np.linspace(10, 60, 200, dtype=np.float32), (150, 1))
    values[40:60, 50:80] = np.nan

    write_disparity_png(tmp_path / "d.png", values, lowest=10, highest=60)

    picture = read_image(tmp_path / "d.png")
    np.testing.assert_array_equal(picture[:, :200], colour_mapped(values, 10, 60))
    assert (picture[40:60, 50:80] == MISSING_COLOUR).all()
    bar = picture[:, 200:]
    assert bar.shape[1] > 40
    near, far = colour_mapped(np.array([[60.0, 10.0]]), 10, 60)[0]
    assert (bar == near).all(axis=2).any(axis=1).argmax() < 20
    assert (bar[-20:] == far).all(axis=2).any()


@pytest.mark.parametrize("size", [(1, 1), (3, 200), (300, 2)])
@pytest.mark.parametrize("value", [np.nan, 0.0, -3.5, 1e6])
def test_any_size_and_range_of_disparities_can_be_drawn(tmp_path, size, value):
    write_disparity_png(tmp_path / "d.png", np.full(size, value, np.float32))

    assert read_image(tmp_path / "d.png").shape[0] == size[0]


def test_outliers_do_not_take_all_the_colours():
    values = np.linspace(10, 20, 10_000)
    values[:20], values[-20:] = -1e4, 1e6

    lowest, highest = colour_range(values)

    assert 9.9 < lowest < 10.2
    assert 19.8 < highest < 20.1


def test_nearer_is_a_different_colour_for_every_step():
    colours = colour_mapped(np.linspace(0, 1, 256)[None], 0, 1)[0]

    assert len(np.unique(colours, axis=0)) == 256
    assert not (colours == MISSING_COLOUR).all(axis=1).any()


def test_depths_are_whole_millimetres_and_those_out_of_range_are_counted(tmp_path):
    depth = np.array([[0.5, 1.2344, np.nan], [65.535, 65.5356, 0.0004]], np.float32)

    lost = write_depth_png(tmp_path / "z.png", depth)

    read = cv2.imread(str(tmp_path / "z.png"), cv2.IMREAD_UNCHANGED)
    assert read.dtype == np.uint16
    np.testing.assert_array_equal(read, [[500, 1234, 0], [65535, 0, 0]])
    assert lost == 2


@pytest.mark.parametrize("width", [30, 400])
def test_every_state_has_its_colour_and_a_legend(tmp_path, width):
    status = np.zeros((20, width), np.uint8)
    status[:] = np.arange(width) % len(PixelStatus)

    write_status_png(tmp_path / "s.png", status)

    picture = read_image(tmp_path / "s.png")
    for state, colour in STATUS_COLOURS.items():
        assert (picture[:20, :width][status == state] == colour).all()
        assert (picture[20:] == colour).all(axis=2).sum() > 50
    assert set(STATUS_COLOURS) == set(PixelStatus)
    assert len(set(STATUS_COLOURS.values())) == len(PixelStatus)


# point clouds


def test_a_ply_round_trip_is_exact(tmp_path):
    cloud = a_cloud()

    write_ply(tmp_path / "a.ply", cloud)

    read = read_ply(tmp_path / "a.ply")
    for field in dataclasses.fields(cloud):
        np.testing.assert_array_equal(getattr(read, field.name), getattr(cloud, field.name))
        assert getattr(read, field.name).dtype == getattr(cloud, field.name).dtype


def test_an_empty_cloud_can_be_written(tmp_path):
    write_ply(tmp_path / "a.ply", a_cloud(0))

    assert len(read_ply(tmp_path / "a.ply")) == 0


def test_trimesh_reads_points_and_colours_of_the_ply(tmp_path):
    cloud = a_cloud()

    write_ply(tmp_path / "a.ply", cloud)

    read = trimesh.load(tmp_path / "a.ply")
    np.testing.assert_array_equal(read.vertices.astype(np.float32), cloud.points)
    np.testing.assert_array_equal(read.colors[:, :3], cloud.colours)


@pytest.mark.slow  # imports open3d
def test_open3d_reads_every_property_of_the_ply(tmp_path):
    import open3d

    cloud = a_cloud()

    write_ply(tmp_path / "a.ply", cloud)

    read = open3d.t.io.read_point_cloud(str(tmp_path / "a.ply")).point
    np.testing.assert_array_equal(read.positions.numpy(), cloud.points)
    np.testing.assert_array_equal(read.colors.numpy(), cloud.colours)
    for name in ("confidence", "depth_sigma_m", "status"):
        np.testing.assert_array_equal(read[name].numpy()[:, 0], getattr(cloud, name))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ((b"ply\n", b"obj\n"), "is not a PLY: it begins with"),
        ((b"binary_little_endian", b"ascii"), "is 'format ascii 1.0'; expected binary_little"),
        ((b"element vertex", b"element face"), "does not begin with vertices"),
        ((b"float confidence", b"float quality"), r"lacks \['confidence'\]"),
        ((b"vertex 50", b"vertex 51"), "51 points need 1836 bytes, it has 1800"),
    ],
)
def test_a_foreign_ply_is_refused(tmp_path, change, message):
    write_ply(tmp_path / "a.ply", a_cloud())
    (tmp_path / "b.ply").write_bytes((tmp_path / "a.ply").read_bytes().replace(*change, 1))

    with pytest.raises(ValueError, match=message):
        read_ply(tmp_path / "b.ply")


# meshes


@pytest.mark.parametrize("vertex_colours", [False, True])
def test_the_glb_is_in_metres_with_y_up_and_z_towards_the_viewer(tmp_path, vertex_colours):
    mesh = a_mesh()

    write_glb(tmp_path / "m.glb", mesh, vertex_colours=vertex_colours)

    (read,) = trimesh.load(tmp_path / "m.glb").geometry.values()
    np.testing.assert_allclose(read.vertices, mesh.vertices * (1, -1, -1), rtol=1e-6)
    np.testing.assert_array_equal(read.faces, mesh.faces)


def test_triangles_still_face_the_camera(tmp_path):
    mesh = a_mesh()

    write_glb(tmp_path / "m.glb", mesh)

    (read,) = trimesh.load(tmp_path / "m.glb").geometry.values()
    towards_camera = -(read.face_normals * read.triangles_center).sum(axis=1)
    assert (towards_camera > 0).all()


def test_the_texture_lies_on_the_glb_the_right_way_up(tmp_path):
    mesh = a_mesh()

    write_glb(tmp_path / "m.glb", mesh)

    tree, view = gltf_of(tmp_path / "m.glb")
    attributes = tree["meshes"][0]["primitives"][0]["attributes"]
    uv = np.frombuffer(view(tree["accessors"][attributes["TEXCOORD_0"]]["bufferView"]), "<f4")
    np.testing.assert_allclose(uv.reshape(-1, 2), mesh.uv, atol=1e-6)
    contents = np.frombuffer(view(tree["images"][0]["bufferView"]), np.uint8)
    texture = cv2.imdecode(contents, cv2.IMREAD_COLOR)[..., ::-1]
    np.testing.assert_array_equal(texture, mesh.texture)


def test_the_material_is_unlit_dull_and_double_sided(tmp_path):
    write_glb(tmp_path / "m.glb", a_mesh())

    tree, _ = gltf_of(tmp_path / "m.glb")
    (material,) = tree["materials"]
    assert material["doubleSided"] is True
    assert material["pbrMetallicRoughness"]["metallicFactor"] == 0
    assert material["pbrMetallicRoughness"]["roughnessFactor"] == 1
    assert material["extensions"] == {"KHR_materials_unlit": {}}
    assert tree["extensionsUsed"] == ["KHR_materials_unlit"]
    assert "extensionsRequired" not in tree


def test_vertex_colours_are_linear_light(tmp_path):
    mesh = a_mesh()

    write_glb(tmp_path / "m.glb", mesh, vertex_colours=True)

    tree, view = gltf_of(tmp_path / "m.glb")
    accessor = tree["accessors"][tree["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"]]
    assert (accessor["componentType"], accessor["type"]) == (5123, "VEC4")
    assert accessor["normalized"] is True
    linear = np.frombuffer(view(accessor["bufferView"]), "<u2").reshape(-1, 4) / 65535
    assert (linear[:, 3] == 1).all()
    low, high = linear[:, :3] * 12.92, 1.055 * linear[:, :3] ** (1 / 2.4) - 0.055
    encoded = np.where(linear[:, :3] <= 0.0031308, low, high)
    np.testing.assert_allclose(encoded * 255, mesh.colours, atol=0.05)
    assert "images" not in tree


@pytest.mark.slow  # imports open3d
def test_open3d_shows_the_texture_and_the_vertex_colours(tmp_path):
    import open3d

    mesh = a_mesh()
    write_glb(tmp_path / "t.glb", mesh)
    write_glb(tmp_path / "c.glb", mesh, vertex_colours=True)

    textured = open3d.io.read_triangle_mesh(str(tmp_path / "t.glb"))
    coloured = open3d.io.read_triangle_mesh(str(tmp_path / "c.glb"))

    flipped = mesh.vertices * (1, -1, -1)
    for read in (textured, coloured):
        np.testing.assert_allclose(read.get_min_bound(), flipped.min(axis=0), rtol=1e-6)
        np.testing.assert_allclose(read.get_max_bound(), flipped.max(axis=0), rtol=1e-6)

    def colours_at(vertices):
        distance = np.linalg.norm(np.asarray(vertices)[:, None] - flipped[None], axis=2)
        return mesh.colours[distance.argmin(axis=1)]

    u, v = np.asarray(textured.triangle_uvs).T
    texels = np.asarray(textured.textures[0])[(v * 40).astype(int), (u * 50).astype(int)]
    corners = np.asarray(textured.vertices)[np.asarray(textured.triangles).ravel()]
    np.testing.assert_array_equal(texels[:, :3], colours_at(corners))
    linear = ((colours_at(coloured.vertices) / 255 + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(np.asarray(coloured.vertex_colors), linear, atol=2e-3)


def test_a_mesh_without_faces_is_refused(tmp_path):
    mesh = a_mesh()
    bare = dataclasses.replace(mesh, faces=mesh.faces[:0])

    with pytest.raises(ValueError, match="mesh has no faces, so there is nothing to write"):
        write_glb(tmp_path / "m.glb", bare)


# writing


def test_json_holds_every_kind_of_value(tmp_path):
    value = {
        "array": np.arange(3),
        "number": np.float32(0.5),
        "missing": float("nan"),
        "path": Path("a") / "b",
        "state": PixelStatus.MATCHED,
        "range": range(2),
        7: ("é", None, True),
    }

    write_json(tmp_path / "a.json", value)

    read = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert read == {
        "array": [0, 1, 2],
        "number": 0.5,
        "missing": None,
        "path": str(Path("a") / "b"),
        "state": 1,
        "range": [0, 1],
        "7": ["é", None, True],
    }


WRITERS = {
    "image": lambda path: write_image(path.with_suffix(".png"), an_image()),
    "pfm": lambda path: write_pfm(path, a_float_map()),
    "disparity": lambda path: write_disparity_png(path, a_float_map()),
    "depth": lambda path: write_depth_png(path, a_float_map()),
    "status": lambda path: write_status_png(path, np.ones((5, 6), np.uint8)),
    "ply": lambda path: write_ply(path, a_cloud()),
    "glb": lambda path: write_glb(path, a_mesh()),
    "json": lambda path: write_json(path, {"a": 1}),
}


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
def test_a_failure_midway_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, write):
    target = tmp_path / "result.png"
    target.write_bytes(b"before")

    def half(self, contents, **_):
        with self.open("w" if isinstance(contents, str) else "wb") as file:
            file.write(contents[: len(contents) // 2])
        raise OSError("no space left on device")

    monkeypatch.setattr(Path, "write_bytes", half)
    monkeypatch.setattr(Path, "write_text", half)
    with pytest.raises(OSError, match="no space left on device"):
        write(target)
    monkeypatch.undo()

    assert [path.name for path in tmp_path.iterdir()] == ["result.png"]
    assert target.read_bytes() == b"before"


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
def test_writing_replaces_the_old_file_and_leaves_nothing_beside_it(tmp_path, write):
    target = tmp_path / "result.png"
    target.write_bytes(b"before")

    write(target)

    assert [path.name for path in tmp_path.iterdir()] == ["result.png"]
    assert target.read_bytes() != b"before"


def test_the_file_appears_only_when_it_is_whole(tmp_path):
    with atomic(tmp_path / "a.txt") as partial:
        partial.write_text("half")
        assert not (tmp_path / "a.txt").exists()

    assert (tmp_path / "a.txt").read_text() == "half"


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"folder .*nowhere does not exist"):
        write_json(tmp_path / "nowhere" / "a.json", {})
