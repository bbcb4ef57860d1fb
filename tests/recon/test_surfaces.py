"""Meshes of generated pairs beside the true surface, and the surface that closes their holes."""

from dataclasses import replace

import numpy as np
import pytest
from rendered import QUICK, SEARCHED, still_life

from recon.evaluation.surfaces import TrueSurface, first_hits, surface_measures
from recon.meshing import Meshing
from recon.pipeline import reconstruct
from recon.settings import load_preset
from recon.types import DisparityMap, PixelStatus

pytestmark = pytest.mark.slow  # imports open3d

SIGMA_PX = 0.5


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    path = tmp_path_factory.mktemp("presets") / "quick.toml"
    path.write_text(QUICK)
    return reconstruct(still_life().pair, load_preset(path), disparities=SEARCHED)


def truth():
    scene = still_life()
    return TrueSurface(scene.disparity, scene.visible, scene.pair.geometry)


def true_map(shift_px=0.0):
    values = truth().disparity + np.float32(shift_px)
    return DisparityMap(
        values, np.full(values.shape, PixelStatus.MATCHED, np.uint8), np.ones_like(values)
    )


def test_the_true_mesh_is_where_the_truth_is():
    found = surface_measures(
        Meshing(decimation_sigma=0)(true_map(), still_life().pair), truth(), SIGMA_PX
    )

    assert found.median_sigma < 1e-3
    assert found.complete > 0.99


def test_a_mesh_off_by_two_sigma_is_about_two_sigma_away():
    """The nearest point of a slanted surface is nearer than that on the same ray."""
    found = surface_measures(
        Meshing(decimation_sigma=0)(true_map(2 * SIGMA_PX), still_life().pair), truth(), SIGMA_PX
    )

    assert 1.2 < found.median_sigma < 2.3
    worse = Meshing(decimation_sigma=0)(true_map(5 * SIGMA_PX), still_life().pair)
    assert surface_measures(worse, truth(), SIGMA_PX).complete < 0.2


def test_meshes_are_as_near_to_the_truth_as_sigma_z_says_decimated_or_not(result):
    full, few = (
        surface_measures(mesh, truth(), SIGMA_PX) for mesh in (result.dense_mesh, result.mesh)
    )

    assert len(result.mesh.faces) < 0.1 * len(result.dense_mesh.faces)
    assert full.median_sigma <= 1.2
    assert few.median_sigma <= 1.3 * full.median_sigma
    for found in (full, few):
        assert found.complete >= 0.9


def test_decimation_opens_and_closes_nothing_but_slivers_of_the_outline(result):
    geometry = result.pair.geometry

    before, after = (
        np.isfinite(first_hits(mesh, geometry)[..., 2]) for mesh in (result.dense_mesh, result.mesh)
    )

    assert not (after & ~before).any()
    assert (before & ~after).mean() < 0.02


def test_a_watertight_surface_fills_the_holes_and_stays_where_points_are(result):
    meshing = Meshing(watertight=True, watertight_depth=6)

    near = meshing(result.disparity, result.pair)
    closed = replace(meshing, watertight_reach_px=0.0)(result.disparity, result.pair)

    assert near.texture is None
    assert near.uv is None
    missed, still = (
        np.isnan(first_hits(mesh, result.pair.geometry)[..., 2])
        for mesh in (result.dense_mesh, near)
    )
    assert still.mean() < missed.mean()
    assert len(near.faces) < len(closed.faces)
    assert surface_measures(near, truth(), SIGMA_PX).median_sigma <= 1.2
    towards = (near.normals * near.vertices).sum(axis=1) < 0
    assert towards.mean() > 0.8
    gaps = np.linalg.norm(
        near.vertices[::97, None] - result.dense_mesh.vertices[None], axis=-1
    ).min(axis=1)
    reach = meshing.watertight_reach_px * near.vertices[::97, 2] / result.pair.geometry.focal_px
    assert (gaps <= reach * 1.001).all()
    colours = {tuple(colour) for colour in result.dense_mesh.colours.tolist()}
    assert {tuple(colour) for colour in near.colours.tolist()} <= colours


def test_a_watertight_surface_comes_out_the_same_again(result):
    meshing = Meshing(watertight=True, watertight_depth=5)

    first, second = (meshing(result.disparity, result.pair) for _ in range(2))

    np.testing.assert_array_equal(first.vertices, second.vertices)
    np.testing.assert_array_equal(first.faces, second.faces)


def test_the_pipeline_takes_the_watertight_surface_from_settings(tmp_path):
    (tmp_path / "quick.toml").write_text(QUICK)
    preset = load_preset(tmp_path / "quick.toml", {"meshing": {"watertight": True}})
    preset = replace(preset, meshing=replace(preset.meshing, watertight_depth=5))

    result = reconstruct(still_life().pair, preset, disparities=SEARCHED)

    assert result.mesh.texture is None
    assert result.dense_mesh is result.mesh
