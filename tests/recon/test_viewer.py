import dataclasses
import socket
import subprocess
import sys
import time
import urllib.request
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest
import rerun as rr
import torch
from rerun.chunk import RrdReader

from calib.pair import RectifiedPair
from calib.rig import RectifiedGeometry
from recon.colours import STATUS_COLOURS
from recon.meshing import Meshing
from recon.triangulation import Triangulation, depth_map
from recon.types import CostVolume, DisparityMap, Mesh, PixelStatus, PointCloud
from recon.viewer import Limits, RerunObserver, archetypes, open_recording, serve_recording
from recon.viewer.thinning import thinned_image, thinned_mesh, thinned_points

TARGET = "EyeControls3D:look_target"
STAGES = (
    "settings",
    "input/rectified",
    "matching_cost",
    "aggregation",
    "disparity/left",
    "disparity/right",
    "left_right_check",
    "filling",
    "refinement/DomainTransform",
    "depth",
    "cloud",
    "mesh",
    "timings",
)


def a_pair(width=60, height=44):
    geometry = RectifiedGeometry(
        (width, height), 70.0, (width / 2, height / 2), (width / 2 + 3, height / 2), 0.2
    )
    left, right = np.random.default_rng(0).integers(0, 256, (2, height, width, 3), dtype=np.uint8)
    return RectifiedPair(left, right, geometry)


def a_disparity_map(pair):
    width, height = pair.geometry.size
    y, x = np.mgrid[:height, :width]
    values = (10 + 0.05 * x + 0.02 * y).astype(np.float32)
    values[: height // 3, : width // 4] = np.nan
    present = np.isfinite(values)
    status = np.where(present, PixelStatus.MATCHED, PixelStatus.MISMATCHED).astype(np.uint8)
    return DisparityMap(values, status, present * np.float32(0.8))


def in_torch(disparity):
    fields = (disparity.values, disparity.status, disparity.confidence)
    return DisparityMap(*(torch.from_numpy(field.copy()) for field in fields))


def a_volume(pair, count=16, rows=None):
    width, height = pair.geometry.size
    generator = torch.Generator().manual_seed(1)
    cost = torch.rand((rows or height, width, count), generator=generator)
    cost[:, :5] = float("inf")
    return CostVolume(cost, range(2, 2 + count))


def all_stages(pair, count=16):
    disparity = a_disparity_map(pair)
    tensors = in_torch(disparity)
    volume = a_volume(pair, count)
    results = (
        {"matching_cost": {"window_px": 9, "name": "census"}, "tolerance_px": 1.0},
        pair,
        volume,
        volume,
        *(
            dataclasses.replace(
                tensors, values=tensors.values + step, confidence=tensors.confidence - step / 100
            )
            for step in range(5)
        ),
        depth_map(disparity, pair.geometry),
        Triangulation()(disparity, pair),
        Meshing(decimation_sigma=0)(disparity, pair),
        {"matching_cost": 0.123456},
    )
    return dict(zip(STAGES, results, strict=True))


def paths_in(recording):
    return RrdReader(recording).store().schema().entity_paths()


def logged(recording, path):
    """Return what was logged at a path, a dictionary of components a row."""
    store = RrdReader(recording).store()
    chunks = [chunk for chunk in store.stream().to_chunks() if chunk.entity_path == path]
    return [row for chunk in chunks for row in chunk.to_record_batch().to_pylist()]


def arrays_in(value):
    """Return a copy of every array inside a result."""
    if isinstance(value, torch.Tensor):
        return [value.numpy().copy()]
    if isinstance(value, np.ndarray):
        return [value.copy()]
    if dataclasses.is_dataclass(value):
        inside = (getattr(value, field.name) for field in dataclasses.fields(value))
        return [array for item in inside for array in arrays_in(item)]
    return []


def test_a_recording_holds_every_stage(tmp_path):
    with RerunObserver(save=tmp_path / "all.rrd") as observe:
        for stage, result in all_stages(a_pair()).items():
            observe(stage, result)

    paths = paths_in(tmp_path / "all.rrd")
    for stage in STAGES:
        ends = f"/{stage.removesuffix('/left').removesuffix('/right')}/"
        assert any(ends in f"{path}/" for path in paths), stage
    assert {
        "/world/left/photograph",
        "/world/right/photograph",
        "/world/left/disparity/status",
        "/world/right/disparity/confidence",
        "/world/left/depth",
        "/world/cloud",
        "/world/mesh",
        "/summary",
        "/stages",
        "/histograms/disparity_px",
        "/histograms/confidence",
        "/histograms/depth",
    } <= set(paths)
    assert [path.name for path in tmp_path.iterdir()] == ["all.rrd"]


def test_a_recording_opens_with_an_arrangement_of_its_own(tmp_path):
    with RerunObserver(save=tmp_path / "a.rrd") as observe:
        observe("disparity/left", a_disparity_map(a_pair()))

    reader = RrdReader(tmp_path / "a.rrd")
    assert len(reader.recordings()) == 1
    (blueprint,) = reader.blueprints()
    chunks = reader.store(store=blueprint).stream().to_chunks()
    columns = [column for chunk in chunks for column in chunk.to_record_batch().columns]
    text = str([column.to_pylist() for column in columns if "timestamp" not in str(column.type)])
    assert "2D" in text
    assert "3D" in text
    assert "disparity/left" in text
    assert "StateTimeline" in text


def test_the_eye_looks_at_the_middle_of_the_cloud(tmp_path):
    pair = a_pair()
    disparity = a_disparity_map(pair)
    cloud = Triangulation()(disparity, pair)
    mesh = Meshing()(disparity, pair)

    with RerunObserver(save=tmp_path / "a.rrd") as observe:
        observe("cloud", cloud)
        observe("mesh", mesh)

    reader = RrdReader(tmp_path / "a.rrd")
    chunks = reader.store(store=reader.blueprints()[0]).stream().to_chunks()
    batches = [chunk.to_record_batch() for chunk in chunks]
    columns = [batch.column(TARGET) for batch in batches if TARGET in batch.schema.names]
    targets = [row[0] for column in columns for row in column.to_pylist() if row]
    assert targets
    for target in targets:
        np.testing.assert_allclose(target, np.median(cloud.points, axis=0), rtol=1e-5)


def test_stages_follow_each_other_on_the_timeline(tmp_path):
    with RerunObserver(save=tmp_path / "a.rrd") as observe:
        observe("first", "one")
        observe("second", "two")

    chunks = RrdReader(tmp_path / "a.rrd").stream().to_chunks()
    steps = {
        chunk.entity_path: chunk.to_record_batch().column("stage").to_pylist()
        for chunk in chunks
        if chunk.entity_path in ("/first", "/second")
    }
    assert steps == {"/first": [0], "/second": [1]}


def test_watching_changes_no_value(tmp_path):
    stages = all_stages(a_pair())
    before = {stage: arrays_in(result) for stage, result in stages.items()}

    with RerunObserver(save=tmp_path / "a.rrd") as observe:
        for stage, result in stages.items():
            observe(stage, result)

    for stage, result in stages.items():
        for array, copy in zip(arrays_in(result), before[stage], strict=True):
            np.testing.assert_array_equal(array, copy)


def test_a_failed_run_leaves_no_recording(tmp_path):
    def fail():
        with RerunObserver(save=tmp_path / "a.rrd") as observe:
            observe("settings", "text")
            raise RuntimeError("matching failed")

    with pytest.raises(RuntimeError, match="matching failed"):
        fail()

    assert list(tmp_path.iterdir()) == []


def test_the_recording_appears_only_when_it_is_whole(tmp_path):
    observe = RerunObserver(save=tmp_path / "a.rrd")
    observe("settings", "text")
    assert not (tmp_path / "a.rrd").exists()

    observe.close()
    observe.close()

    assert paths_in(tmp_path / "a.rrd")


def test_two_recordings_at_once_do_not_mix(tmp_path):
    with (
        RerunObserver(save=tmp_path / "a.rrd") as first,
        RerunObserver(save=tmp_path / "b.rrd") as second,
    ):
        first("only_here", "text")
        second("only_there", "text")

    assert "/only_there" not in paths_in(tmp_path / "a.rrd")
    assert "/only_here" not in paths_in(tmp_path / "b.rrd")
    assert rr.get_global_data_recording() is None


def test_an_observer_that_shows_nothing_draws_nothing():
    class Untouchable:
        def __str__(self):
            raise AssertionError("was drawn")

    with RerunObserver() as observe:
        observe("stage", Untouchable())

    assert observe.page is None


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"cannot write .*a\.rrd: folder .* does not"):
        RerunObserver(save=tmp_path / "nowhere" / "a.rrd")


def kinds(result, limits=None):
    return [(path, type(drawn).__name__) for path, drawn in archetypes(result, limits or Limits())]


def test_each_type_has_its_own_look():
    stages = all_stages(a_pair())

    assert kinds(stages["settings"]) == [("", "TextDocument")]
    assert kinds(stages["input/rectified"]) == [
        ("/world/right", "Transform3D"),
        ("", "TextDocument"),
        ("/world/left", "Pinhole"),
        ("/world/left/photograph", "EncodedImage"),
        ("/world/right", "Pinhole"),
        ("/world/right/photograph", "EncodedImage"),
    ]
    assert kinds(stages["matching_cost"]) == [
        ("row_11", "EncodedImage"),
        ("row_22", "EncodedImage"),
        ("row_33", "EncodedImage"),
    ]
    assert kinds(stages["filling"]) == [
        ("values", "EncodedImage"),
        ("status", "SegmentationImage"),
        ("confidence", "SegmentationImage"),
    ]
    assert kinds(stages["depth"]) == [("", "EncodedDepthImage")]
    assert kinds(stages["cloud"]) == [("", "Points3D")]
    assert kinds(stages["mesh"]) == [("", "Mesh3D")]
    assert kinds(stages["input/rectified"].left) == [("", "EncodedImage")]
    assert kinds(object()) == [("", "TextDocument")]


def test_the_cameras_stand_one_baseline_apart_and_see_what_was_calibrated():
    pair = a_pair()
    drawn = archetypes(pair, Limits())

    pinholes = [archetype for _, archetype in drawn if isinstance(archetype, rr.Pinhole)]
    (place,) = [archetype for _, archetype in drawn if isinstance(archetype, rr.Transform3D)]

    def numbers(component):
        return np.ravel(component.as_arrow_array().to_pylist())

    np.testing.assert_allclose(numbers(place.translation), [0.2, 0, 0])
    for camera, (cx, cy) in zip(
        pinholes, (pair.geometry.centre_left, pair.geometry.centre_right), strict=True
    ):
        expected = [70, 0, 0, 0, 70, 0, cx + 0.5, cy + 0.5, 1]  # column by column
        np.testing.assert_allclose(numbers(camera.image_from_camera), expected)


@pytest.mark.parametrize("rows", [1, 2, 7])
def test_a_strip_of_a_volume_of_any_height_is_drawn_at_its_place(rows):
    volume = dataclasses.replace(a_volume(a_pair(), rows=rows), origin=(40, 0))

    pictures = [name for name, kind in kinds(volume) if kind == "EncodedImage"]

    assert 1 <= len(pictures) <= 3
    assert all(40 <= int(name.removeprefix("row_")) < 40 + rows for name in pictures)


def test_a_volume_without_any_cost_is_drawn():
    volume = CostVolume(torch.full((4, 5, 6), float("inf")), range(6))

    assert [kind for _, kind in kinds(volume)] == ["EncodedImage"] * 3


def test_what_is_thinned_is_said_in_the_summary(tmp_path):
    pair = a_pair()
    disparity = a_disparity_map(pair)
    limits = Limits(max_points=100, max_faces=500, max_pixels=1000)

    with RerunObserver(save=tmp_path / "a.rrd", limits=limits) as observe:
        observe("input/rectified", pair)
        observe("cloud", Triangulation()(disparity, pair))
        observe("mesh", Meshing(decimation_sigma=0)(disparity, pair))
        observe("run", {"metric sanity": "f 70 px, baseline 0.2 m", "units": "metres"})

    said = logged(tmp_path / "a.rrd", "/summary")[-1]["TextDocument:text"][0]
    assert said.startswith("**f 70 px, baseline 0.2 m**")
    assert "cloud: 100 of 2,430 points are shown" in said
    assert "triangles are shown; the files have all of them" in said
    assert "every 2. pixel of every 2. row" in said
    assert "| units | metres |" in said
    (mesh,) = logged(tmp_path / "a.rrd", "/world/mesh")
    assert f"mesh: {len(mesh['Mesh3D:triangle_indices'])} of 4,655 triangles" in said
    (cloud,) = logged(tmp_path / "a.rrd", "/world/cloud")
    assert len(cloud["Points3D:positions"]) == 100


def test_cameras_of_thinned_photographs_see_the_same_rays():
    pair = a_pair()
    whole, thinned = (
        next(drawn for path, drawn in archetypes(pair, limits) if path == "/world/left")
        for limits in (Limits(), Limits(max_pixels=300))
    )

    def rays(camera, columns):
        K = np.ravel(camera.image_from_camera.as_arrow_array().to_pylist()).reshape(3, 3).T
        return (columns + 0.5 - K[0, 2]) / K[0, 0]

    columns = np.arange(20)
    np.testing.assert_allclose(rays(thinned, columns), rays(whole, 3 * columns), rtol=1e-6)


def test_a_layer_is_drawn_only_where_a_stage_changed_it(tmp_path):
    pair = a_pair()
    first = in_torch(a_disparity_map(pair))
    surer = dataclasses.replace(first, confidence=first.confidence / 2)

    with RerunObserver(save=tmp_path / "a.rrd") as observe:
        observe("input/rectified", pair)
        observe("filling", first)
        observe("confidence", surer)

    paths = set(paths_in(tmp_path / "a.rrd"))
    assert {f"/world/left/filling/{layer}" for layer in ("values", "status", "confidence")} <= paths
    assert "/world/left/confidence/confidence" in paths
    assert not {"/world/left/confidence/values", "/world/left/confidence/status"} & paths


def test_classes_have_names_and_colours(tmp_path):
    with RerunObserver(save=tmp_path / "a.rrd") as observe:
        observe("any", "text")

    (context,) = next(
        row["AnnotationContext:context"]
        for row in logged(tmp_path / "a.rrd", "/")
        if row.get("AnnotationContext:context")
    )
    named = {row["class_id"]: row["class_description"]["info"] for row in context}
    for state, colour in STATUS_COLOURS.items():
        assert named[int(state)]["label"] == state.name.lower()
        assert named[int(state)]["color"] == int.from_bytes(bytes([*colour, 255]), "big")
    assert named[109]["label"] == "right within 1 px: 90 to 100 %"


def test_confidence_is_drawn_by_tenths():
    status = np.full((1, 4), PixelStatus.MATCHED, np.uint8)
    confidence = np.array([[0, 0.09, 0.55, 1]], np.float32)

    drawn = dict(
        archetypes(DisparityMap(np.ones((1, 4), np.float32), status, confidence), Limits())
    )

    (classes,) = drawn["confidence"].buffer.as_arrow_array().to_pylist()
    assert list(classes) == [100, 100, 105, 109]


def test_thinning_keeps_few_enough_and_changes_nothing_small():
    pair = a_pair()
    cloud = Triangulation()(a_disparity_map(pair), pair)
    few = thinned_points(cloud, 7)

    assert isinstance(few, PointCloud)
    assert len(few) == 7
    assert {tuple(point) for point in few.points} <= {tuple(point) for point in cloud.points}
    assert thinned_points(cloud, len(cloud)) is cloud
    assert thinned_image(pair.left, 700).shape == (22, 30, 3)
    np.testing.assert_array_equal(thinned_image(pair.left, 44 * 60), pair.left)


def test_a_coarser_mesh_covers_the_same_surfaces_and_bridges_nothing():
    pair = a_pair(120, 90)
    disparity = a_disparity_map(pair)
    disparity.values[:, 61:] += 20  # a depth edge between columns
    mesh = Meshing(decimation_sigma=0)(disparity, pair)

    coarse = thinned_mesh(mesh, len(mesh.faces) // 4)

    assert isinstance(coarse, Mesh)
    assert 0 < len(coarse.faces) <= len(mesh.faces) / 4
    columns = coarse.uv[:, 0] * 120 - 0.5
    assert not (
        (columns[coarse.faces] < 60.5).any(axis=1) & (columns[coarse.faces] > 60.5).any(axis=1)
    ).any()
    corners = coarse.vertices[coarse.faces].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert ((normals * corners.mean(axis=1)).sum(axis=1) < 0).all()
    assert {tuple(v) for v in coarse.vertices} <= {tuple(v) for v in mesh.vertices}
    assert thinned_mesh(mesh, len(mesh.faces)) is mesh


def test_a_mesh_without_a_grid_is_drawn_whole():
    texture = np.zeros((4, 4, 3), np.uint8)
    twice = np.full((3, 2), 0.5, np.float32)
    mesh = Mesh(
        np.eye(3, dtype=np.float32),
        np.tile([[0, 1, 2]], (9, 1)).astype(np.int32),
        twice,
        texture,
        texture[0, :3],
        np.eye(3, dtype=np.float32),
    )

    assert thinned_mesh(mesh, 2) is mesh


def test_the_algorithms_do_not_load_rerun():
    code = (
        "import sys, recon.types, recon.observer, recon.meshing; assert 'rerun' not in sys.modules"
    )

    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.slow
def test_a_pair_of_one_and_a_half_megapixels_takes_little_time_and_space(tmp_path):
    stages = all_stages(a_pair(1440, 1000))  # noise: no photograph compresses as badly

    start = time.process_time()
    with RerunObserver(save=tmp_path / "a.rrd") as observe:
        for stage, result in stages.items():
            observe(stage, result)
    seconds = time.process_time() - start

    assert seconds < 15  # of the processor, so that a busy machine does not matter; 3 if quiet
    assert (tmp_path / "a.rrd").stat().st_size < 30e6


@pytest.mark.slow
def test_a_browser_is_served_during_the_run_and_after_it(tmp_path):
    with (
        RerunObserver(save=tmp_path / "a.rrd", show="browser", open_browser=False) as first,
        RerunObserver(show="browser", open_browser=False) as second,
    ):
        first("settings", "text")

    assert not set(first.page.ports) & set(second.page.ports)
    for observe in (first, second):
        with urllib.request.urlopen(observe.page.url, timeout=5) as page:
            assert b"<html" in page.read()
        data = parse_qs(urlsplit(observe.page.url).query)["url"][0]
        assert urlsplit(data).hostname == "127.0.0.1"
        socket.create_connection(("127.0.0.1", urlsplit(data).port), timeout=5).close()
    assert "/settings" in paths_in(tmp_path / "a.rrd")


def test_a_missing_recording_is_not_opened(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"there is no recording .*a\.rrd"):
        open_recording(tmp_path / "a.rrd")


def test_a_viewer_that_cannot_run_says_what_to_do(tmp_path, monkeypatch):
    (tmp_path / "a.rrd").write_bytes(b"RRF2")
    failed = subprocess.CompletedProcess([], 1)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: failed)

    with pytest.raises(ValueError, match=r"ended with status 1; without a display, .*view --web"):
        open_recording(tmp_path / "a.rrd")


@pytest.mark.parametrize("opened", [open_recording, serve_recording])
def test_a_file_that_is_no_recording_is_said(tmp_path, opened):
    (tmp_path / "a.rrd").write_bytes(b"ply\nformat")

    with pytest.raises(ValueError, match=r"a\.rrd is no recording of Rerun: it begins with b'ply"):
        opened(tmp_path / "a.rrd")
