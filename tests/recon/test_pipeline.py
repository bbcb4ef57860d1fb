"""From a pair to surfaces, on a scene of exact truth, and without a network so that it is quick."""

from dataclasses import replace

import numpy as np
import pytest
from rendered import QUICK, SEARCHED, on_disk, still_life

import recon
from calib import Camera, Pose, StereoCalibration
from calib.pair import RectifiedPair, StereoPair
from recon.pipeline import reconstruct
from recon.settings import load_preset
from recon.types import CostVolume, DisparityMap, Mesh, PixelStatus, PointCloud


@pytest.fixture(scope="module")
def preset(tmp_path_factory):
    path = tmp_path_factory.mktemp("presets") / "quick.toml"
    path.write_text(QUICK)
    return load_preset(path, {"refinements": ["domain_transform"]})


@pytest.fixture(scope="module")
def result(preset):
    return reconstruct(still_life().pair, preset, disparities=SEARCHED)


def exact_depth(scene):
    geometry = scene.pair.geometry
    in_front = scene.disparity - geometry.disparity_at_infinity
    return geometry.focal_px * geometry.baseline_m / in_front


def test_depths_are_right_within_what_is_promised(result):
    scene = still_life()
    truth = exact_depth(scene)
    geometry = scene.pair.geometry
    sigma = truth**2 / (geometry.focal_px * geometry.baseline_m) * 0.5

    seen = scene.visible & (result.disparity.status == PixelStatus.MATCHED)
    good = np.abs(result.depth - truth) < 2 * sigma

    assert seen.mean() > 0.8
    assert good[seen].mean() > 0.97
    assert np.median(np.abs(result.depth - truth)[seen] / sigma[seen]) < 0.5


def test_points_lie_where_the_scene_is(result):
    geometry = result.pair.geometry
    x, y, z = result.cloud.points.T
    column = np.rint(geometry.focal_px * x / z + geometry.centre_left[0]).astype(int)
    row = np.rint(geometry.focal_px * y / z + geometry.centre_left[1]).astype(int)

    truth = exact_depth(still_life())[row, column]
    assert (np.abs(z - truth) / truth < 0.1).mean() > 0.97
    assert np.array_equal(result.cloud.colours, result.pair.left[row, column])
    assert len(result.cloud) > 0.8 * result.depth.size


def test_the_mesh_is_made_of_the_same_points(result):
    assert len(result.dense_mesh.faces) > len(result.cloud) > len(result.mesh.faces)
    points = {tuple(point) for point in result.cloud.points.tolist()}
    for mesh in (result.mesh, result.dense_mesh):
        assert {tuple(vertex) for vertex in mesh.vertices.tolist()} <= points


@pytest.mark.parametrize(("left", "right"), [(20, 0), (0, 20)])
def test_depths_do_not_depend_on_where_infinity_lies(preset, left, right):
    scene = still_life().shifted(left, right)

    result = reconstruct(scene.pair, preset)

    truth = exact_depth(scene)
    seen = scene.visible & (result.disparity.status == PixelStatus.MATCHED)
    assert seen.mean() > 0.6
    assert (np.abs(result.depth - truth) / truth < 0.1)[seen].mean() > 0.97


def test_watching_changes_no_value(preset, result):
    seen = {}

    watched = reconstruct(still_life().pair, preset, disparities=SEARCHED, observe=seen.__setitem__)

    assert np.array_equal(watched.disparity.values, result.disparity.values, equal_nan=True)
    assert np.array_equal(watched.disparity.status, result.disparity.status)
    assert np.array_equal(watched.cloud.points, result.cloud.points)
    assert np.array_equal(watched.mesh.faces, result.mesh.faces)
    assert seen["cloud"] is watched.cloud
    assert seen["mesh"] is watched.mesh
    assert seen["depth"] is watched.depth


def test_observers_are_told_every_stage_in_order(preset):
    stages = []

    reconstruct(
        still_life().pair,
        preset,
        observe=lambda stage, result: stages.append((stage, type(result))),
    )

    assert stages == [
        ("input/rectified", RectifiedPair),
        ("disparity_range", range),
        ("matching_cost", CostVolume),
        ("aggregation", CostVolume),
        ("disparity/left", DisparityMap),
        ("disparity/right", DisparityMap),
        ("left_right_check", DisparityMap),
        ("small_segments", DisparityMap),
        ("filling", DisparityMap),
        ("refinement/DomainTransform", DisparityMap),
        ("depth", np.ndarray),
        ("cloud", PointCloud),
        ("mesh", Mesh),
    ]


def test_a_raw_pair_is_rectified_first(preset):
    scene, seen = still_life(), {}
    camera = Camera(
        scene.pair.geometry.size,
        np.array([[160.0, 0, 99.5], [0, 160, 49.5], [0, 0, 1]]),
        np.zeros(5),
    )
    rig = StereoCalibration(camera, camera, Pose(np.eye(3), np.array([-0.2, 0, 0])))

    result = reconstruct(
        StereoPair(scene.pair.left, scene.pair.right, rig),
        preset,
        disparities=SEARCHED,
        observe=seen.__setitem__,
    )

    assert list(seen)[:2] == ["input/raw", "input/rectified"]
    assert result.pair is seen["input/rectified"]
    truth = exact_depth(scene)
    matched = scene.visible & (result.disparity.status == PixelStatus.MATCHED)
    assert np.median(np.abs(result.depth - truth)[matched] / truth[matched]) < 0.02


@pytest.mark.parametrize("disparities", [range(0), range(201), range(-200, 0)])
def test_a_range_that_does_not_fit_is_refused_before_matching(preset, disparities):
    seen = {}

    with pytest.raises(ValueError, match="disparit"):
        reconstruct(still_life().pair, preset, disparities=disparities, observe=seen.__setitem__)
    assert "matching_cost" not in seen


def test_what_is_too_far_is_left_out_of_cloud_and_mesh(preset):
    near = replace(preset.triangulation, max_depth_m=3.0)
    limited = replace(preset, triangulation=near, meshing=replace(preset.meshing, points=near))

    result = reconstruct(still_life().pair, limited, disparities=SEARCHED)

    assert result.cloud.points[:, 2].max() <= 3.0
    assert result.mesh.vertices[:, 2].max() <= 3.0


def test_five_lines_do_it(tmp_path):
    folder = on_disk(tmp_path, still_life().pair)

    source = recon.read_pair(folder / "left.png", folder / "right.png", folder / "rig.json")
    preset = recon.load_preset(folder / "quick.toml")
    result = recon.reconstruct(source.pair, preset, disparities=source.disparities)

    assert len(result.cloud) > 10_000
