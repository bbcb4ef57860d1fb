"""GLB files keep the rules of glTF, and browsers show them as the photograph is."""

import dataclasses
import json
import shutil
import struct
import subprocess

import numpy as np
import pytest
from browser import drawn_in_a_browser, with_packages
from gltf_rules import broken_rules
from test_files import a_mesh, gltf_of

from calib.pair import RectifiedPair
from calib.rig import RectifiedGeometry
from recon.files import write_glb
from recon.meshing import Meshing
from recon.sample_pairs import sample_folder
from recon.types import DisparityMap, PixelStatus

EXPECTED = ("IMAGE_NPOT_DIMENSIONS",)
"""Photographs have the size they have; it mattered to the first WebGL."""

NAMES = ("texture", "vertex colours", "no texture at all")


def written(folder, name, mesh=None):
    mesh = a_mesh() if mesh is None else mesh
    if name == "no texture at all":
        mesh = dataclasses.replace(mesh, uv=None, texture=None)
    write_glb(folder / "m.glb", mesh, vertex_colours=name == "vertex colours")
    return folder / "m.glb"


@pytest.mark.parametrize("name", NAMES)
def test_a_glb_breaks_no_rule(tmp_path, name):
    assert broken_rules(written(tmp_path, name).read_bytes()) == []


@pytest.mark.parametrize("name", NAMES)
def test_the_validator_of_khronos_finds_nothing(tmp_path, name):
    if not (node := shutil.which("node")):
        pytest.skip("no node on this machine")
    folder = with_packages("gltf-validator")

    done = subprocess.run(
        [node, folder / "validate.cjs", written(tmp_path, name)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip

    said = json.loads(done.stdout)["issues"]["messages"]
    assert [entry for entry in said if entry["code"] not in EXPECTED] == []


def changed(contents, change):
    """Return a GLB with its JSON changed by a function."""
    length = struct.unpack("<I", contents[12:16])[0]
    tree = json.loads(contents[20 : 20 + length])
    change(tree)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = contents[20 + length :]
    header = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON")
    return header + text + rest


def set_in(tree, path, value):
    *rest, last = path
    for key in rest:
        tree = tree[key]
    tree[last] = value


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (("asset", "version"), "1.0", "asset.version"),
        (("bufferViews", 0, "byteLength"), 10**6, "ends outside of the buffer"),
        (("accessors", 0, "count"), 10**5, "reaches beyond its buffer view"),
        (("accessors", 1, "max"), [9, 9, 9], "max is wrong"),
        (("nodes", 0, "scale"), [1000, 1000, 1000], "scales the mesh"),
        (("extensionsUsed",), [], "used but not listed"),
        (("materials", 0, "pbrMetallicRoughness", "metallicFactor"), 2, "metallicFactor is not"),
        (("meshes", 0, "primitives", 0, "mode"), 1, "not made of triangles"),
    ],
)
def test_the_rules_notice_what_is_broken(tmp_path, path, value, words):
    contents = written(tmp_path, "texture").read_bytes()

    found = broken_rules(changed(contents, lambda tree: set_in(tree, path, value)))

    assert any(words in problem for problem in found), found


def test_the_normals_are_turned_like_the_vertices(tmp_path):
    mesh = a_mesh()

    tree, view = gltf_of(written(tmp_path, "texture"))

    number = tree["meshes"][0]["primitives"][0]["attributes"]["NORMAL"]
    normals = np.frombuffer(view(tree["accessors"][number]["bufferView"]), "<f4").reshape(-1, 3)
    np.testing.assert_allclose(normals, mesh.normals * (1, -1, -1), atol=1e-6)


SIZE = (320, 200)
GEOMETRY = RectifiedGeometry(SIZE, 300.0, (155.0, 104.0), (155.0, 104.0), 0.1)


def a_picture():
    """Return (H, W, 3): ramps of dark and light in every channel, and a different corner each."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    ramps = np.stack([x * 255 // SIZE[0], y * 255 // SIZE[1], 255 - x * 255 // SIZE[0]], axis=-1)
    ramps[:40, :40], ramps[:40, -40:] = (250, 20, 20), (20, 250, 20)
    ramps[-40:, :40], ramps[-40:, -40:] = (120, 120, 120), (250, 250, 20)
    return ramps.astype(np.uint8)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES[:2])
def test_a_browser_shows_the_picture_that_was_taken(tmp_path, name):
    """From where the camera stood: nothing is flipped, and no colour is lighter or darker."""
    x = np.mgrid[: SIZE[1], : SIZE[0]][1]
    values = (12 + 0.05 * x).astype(np.float32)
    disparity = DisparityMap(values, np.ones(values.shape, np.uint8), np.ones_like(values))
    picture = a_picture()
    meshing = Meshing(decimation_sigma=1.0 if name == "texture" else 0.0)
    mesh = meshing(disparity, RectifiedPair(picture, picture, GEOMETRY))

    shown = drawn_in_a_browser(written(tmp_path, name, mesh), GEOMETRY)

    inner = np.s_[2:-2, 2:-2]
    error = np.abs(shown[inner].astype(int) - picture[inner]).max(axis=-1)
    assert (error <= 3).mean() > 0.98
    assert np.abs(shown[inner].astype(float).mean((0, 1)) - picture[inner].mean((0, 1))).max() < 1


@pytest.mark.slow
def test_a_browser_shows_the_decimated_still_life_as_it_was_photographed(tmp_path):
    import cv2

    from recon.pairs import read_pair

    folder = sample_folder() / "workshop"
    pair = read_pair(folder / "left.png", folder / "right.png", folder / "rig.json").pair
    truth = cv2.imread(str(folder / "disparity_truth.png"), cv2.IMREAD_UNCHANGED)
    values = (truth / 256).astype(np.float32)
    status = np.full(values.shape, PixelStatus.MATCHED, np.uint8)
    mesh = Meshing()(DisparityMap(values, status, np.ones_like(values)), pair)

    shown = drawn_in_a_browser(written(tmp_path, "texture", mesh), pair.geometry)

    missing = (shown == (0, 0, 255)).all(axis=-1)
    error = np.abs(shown[~missing].astype(int) - pair.left[~missing]).max(axis=-1)
    assert len(mesh.faces) < 0.02 * 2 * values.size
    assert missing.mean() < 0.04
    assert error.mean() < 3
    assert (error < 12).mean() > 0.98
