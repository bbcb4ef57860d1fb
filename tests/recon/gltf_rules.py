"""The rules of glTF 2.0 that a mesh file can break, read from the file without the code under test.

Source: Khronos, glTF 2.0 specification, sections 3.6 (buffers, accessors), 3.7 (meshes),
3.9 (materials), 4 (GLB container).
"""

import json
import struct

import numpy as np

COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
SIGNATURES = {"image/png": b"\x89PNG\r\n\x1a\n", "image/jpeg": b"\xff\xd8\xff"}
ATTRIBUTES = {
    "POSITION": ("VEC3", {5126}),
    "NORMAL": ("VEC3", {5126}),
    "TEXCOORD_0": ("VEC2", {5126, 5121, 5123}),
    "COLOR_0": ("VEC4", {5126, 5121, 5123}),
}


def broken_rules(contents):
    """Return what is wrong with the bytes of a GLB, in words; an empty list if nothing is."""
    wrong = []

    def rule(holds, words):
        if not holds:
            wrong.append(words)

    tree, body = _container(contents, rule)
    if wrong:
        return wrong
    _buffer(tree, body, rule)
    arrays = [_array(tree, accessor, body, rule) for accessor in tree["accessors"]]
    if wrong:
        return wrong
    for primitive in (part for mesh in tree["meshes"] for part in mesh["primitives"]):
        _primitive(tree, primitive, arrays, rule)
    for image in tree.get("images", []):
        view = tree["bufferViews"][image["bufferView"]]
        start = body[view.get("byteOffset", 0) :][:8]
        rule(start.startswith(SIGNATURES[image["mimeType"]]), "an image is not of its MIME type")
    _materials(tree, rule)
    _nodes(tree, rule)
    return wrong


def _container(contents, rule):
    magic, version, length = struct.unpack("<4sII", contents[:12])
    rule((magic, version) == (b"glTF", 2), "the header is not that of glTF 2")
    rule(length == len(contents), "the header gives another length than the file has")
    rule(length % 4 == 0, "the length is no multiple of 4")
    if length != len(contents):
        return None, None
    chunks, at = [], 12
    while at + 8 <= len(contents):
        size, kind = struct.unpack("<I4s", contents[at : at + 8])
        rule(size % 4 == 0, "a chunk does not end at a multiple of 4")
        chunks.append((kind, contents[at + 8 : at + 8 + size]))
        at += 8 + size
    rule([kind for kind, _ in chunks] == [b"JSON", b"BIN\0"], "chunks are not JSON and BIN")
    return json.loads(chunks[0][1].decode("utf-8")), chunks[1][1]


def _buffer(tree, body, rule):
    rule(tree["asset"]["version"] == "2.0", "asset.version is not 2.0")
    length = tree["buffers"][0]["byteLength"]
    rule(length <= len(body), "the buffer is longer than its chunk")
    rule(len(body) - length <= 3, "the chunk is longer than its buffer")
    for view in tree["bufferViews"]:
        end = view.get("byteOffset", 0) + view["byteLength"]
        rule(end <= length, "a buffer view ends outside of the buffer")


def _array(tree, accessor, body, rule):
    view = tree["bufferViews"][accessor["bufferView"]]
    kind = np.dtype(COMPONENTS[accessor["componentType"]])
    width = WIDTHS[accessor["type"]]
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    size = accessor["count"] * width * kind.itemsize
    rule(start % kind.itemsize == 0, "an accessor is not aligned with its numbers")
    rule((width * kind.itemsize) % 4 == 0 or width == 1, "elements are not 4 bytes apart")
    fits = accessor.get("byteOffset", 0) + size <= view["byteLength"]
    rule(fits, "an accessor reaches beyond its buffer view")
    if not fits or start % kind.itemsize:
        return None
    values = np.frombuffer(body[start : start + size], kind).reshape(accessor["count"], width)
    if kind.kind == "f":
        rule(np.isfinite(values).all(), "a number is not finite")
    for name, of in (("min", np.min), ("max", np.max)):
        if name in accessor:
            stated = np.array(accessor[name])
            rule(np.array_equal(stated.astype(kind), of(values, axis=0)), f"{name} is wrong")
    return values


def _primitive(tree, primitive, arrays, rule):
    rule(primitive.get("mode", 4) == 4, "the primitive is not made of triangles")
    attributes = {name: arrays[number] for name, number in primitive["attributes"].items()}
    count = len(attributes["POSITION"])
    for name, number in primitive["attributes"].items():
        accessor = tree["accessors"][number]
        if not name.startswith("_"):
            kind, components = ATTRIBUTES[name]
            rule(accessor["type"] == kind, f"{name} is not {kind}")
            rule(accessor["componentType"] in components, f"{name} has an unfit component type")
            integral = accessor["componentType"] != 5126
            rule(accessor.get("normalized", False) == integral, f"{name} normalised wrongly")
        rule(len(attributes[name]) == count, f"{name} has another length than POSITION")
        view = tree["bufferViews"][accessor["bufferView"]]
        rule(view.get("target") == 34962, f"{name} lies in no vertex buffer")
    rule(
        {"min", "max"} <= tree["accessors"][primitive["attributes"]["POSITION"]].keys(),
        "POSITION lacks min and max",
    )
    indices = arrays[primitive["indices"]].ravel()
    accessor = tree["accessors"][primitive["indices"]]
    target = tree["bufferViews"][accessor["bufferView"]].get("target")
    rule(target == 34963, "indices lie in no index buffer")
    rule(accessor["componentType"] in (5121, 5123, 5125), "indices are signed")
    rule(len(indices) % 3 == 0, "indices are not three for a triangle")
    rule(indices.max() < count, "an index names no vertex")
    lengths = np.linalg.norm(attributes["NORMAL"].astype(float), axis=1)
    rule(np.allclose(lengths, 1, atol=5e-4), "a normal is not of unit length")
    if "TEXCOORD_0" in attributes:
        uv = attributes["TEXCOORD_0"]
        rule((uv >= 0).all() and (uv <= 1).all(), "a texture coordinate leaves the picture")


def _materials(tree, rule):
    used = set()
    for material in tree["materials"]:
        shading = material["pbrMetallicRoughness"]
        for factor in ("metallicFactor", "roughnessFactor"):
            rule(0 <= shading.get(factor, 1) <= 1, f"{factor} is not in [0, 1]")
        if "baseColorTexture" in shading:
            texture = tree["textures"][shading["baseColorTexture"]["index"]]
            rule(texture["source"] < len(tree["images"]), "a texture has no image")
        used |= material.get("extensions", {}).keys()
    rule(used <= set(tree.get("extensionsUsed", [])), "an extension is used but not listed")
    required = set(tree.get("extensionsRequired", []))
    rule(not required, f"extensions {required} are required; not every viewer has them")


def _nodes(tree, rule):
    """One scene, and nothing that scales or turns: numbers in the file are metres as they are."""
    rule(tree.get("scene") == 0 and len(tree["scenes"]) == 1, "there is not one scene to show")
    for node in tree["nodes"]:
        matrix = np.array(node.get("matrix", np.eye(4).ravel().tolist())).reshape(4, 4)
        placed = {"translation", "rotation", "scale"} & node.keys()
        rule(np.array_equal(matrix, np.eye(4)) and not placed, "a node moves or scales the mesh")
