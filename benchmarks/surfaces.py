"""How far the meshes of a preset are from the truth, and what decimation costs.

python benchmarks/surfaces.py PRESET... [--pairs 10] [--pool FOLDER] [--watertight]

Pairs are generated with seeds far above those of any training, and taken as two cameras would;
the still lifes of data/ follow. Prints for every preset what the standard deviation of a MATCHED
disparity is (68 % are nearer than that; and 1.4826 times the median error, which is the same if
errors are normal), and how many of them are within 1 and 3 of what their pixels state. Then for
each way to mesh: triangles, seconds, the distance to the true surface in the sigma_z that the
pixels state, and how much of the surface that both cameras see has the mesh within 3 of these; the
last two columns say the same in half pixels, whatever the pixels state. `quadric` is open3d's
decimation of the points (x, y, disparity) to as many triangles as ours at the preset's setting;
`beyond` is the share of pixels where a mesh closes what the full mesh leaves open.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import open3d
import torch

from calib.pair import RectifiedPair
from calib.rig import RectifiedGeometry
from recon.evaluation.surfaces import TrueSurface, surface_distances
from recon.meshing import Meshing
from recon.pairs import read_pair
from recon.settings import Preset, load_preset
from recon.training.augmentation import Augmentation
from recon.training.pool import draw_pair
from recon.training.pool import read_pair as pooled
from recon.types import Array, DisparityMap, Mesh, PixelStatus

FIRST_SEED = 20_000_000
SIZE = (416, 256)
DATA = Path(__file__).parent.parent / "data"
EVEN_PX = 0.5
SIGMAS = (0.25, 0.5, 1.0, 2.0)
BASELINE_M = 0.1


@dataclass(frozen=True, eq=False)
class Known:
    """A pair with its truth.

    Attributes:
        name: of the scene.
        pair: as two cameras took it.
        truth: what they look at.
        disparities: to search.
    """

    name: str
    pair: RectifiedPair
    truth: TrueSurface
    disparities: range


def generated(seed: int, pool: Path | None) -> Known:
    """Draw the pair of one seed, or read it from a pool, and take it with two cameras."""
    drawn = draw_pair(FIRST_SEED + seed, SIZE) if pool is None else pooled(pool, seed)
    height, width = drawn["disparity"].shape
    size = width, height
    views = [
        torch.from_numpy(drawn[side]).permute(2, 0, 1)[None] / 255 for side in ("left", "right")
    ]
    taken = Augmentation()(views[0], views[1], torch.Generator().manual_seed(seed))
    left, right = ((255 * view[0].permute(1, 2, 0)).round().byte().numpy() for view in taken)
    middle = (size[0] / 2, size[1] / 2)
    geometry = RectifiedGeometry(size, size[0], middle, middle, BASELINE_M)
    truth = drawn["disparity"]
    return Known(
        f"seed {seed}",
        RectifiedPair(left, right, geometry),
        TrueSurface(truth, drawn["visible"], geometry),
        range(max(0, int(truth.min()) - 2), int(truth.max()) + 3),
    )


def still_life(folder: Path) -> Known:
    """Read a pair of data/ with its truth."""
    source = read_pair(folder / "left.png", folder / "right.png", folder / "rig.json")
    pair = source.pair
    assert isinstance(pair, RectifiedPair)
    assert source.disparities is not None
    truth = cv2.imread(str(folder / "disparity_truth.png"), cv2.IMREAD_UNCHANGED) / np.float32(256)
    visible = cv2.imread(str(folder / "visible.png"), cv2.IMREAD_UNCHANGED) > 0
    return Known(folder.name, pair, TrueSurface(truth, visible, pair.geometry), source.disparities)


def quadric(full: Mesh, known: Known, count: int) -> Mesh:
    """Let open3d decimate a mesh in (x, y, disparity), where noise is even, and place it again."""
    geometry = known.pair.geometry
    scale = geometry.focal_px * geometry.baseline_m
    d = scale / full.vertices[:, 2].astype(np.float64)
    cx, cy = geometry.centre_left
    x, y = (full.vertices[:, :2] / full.vertices[:, 2:] * geometry.focal_px + (cx, cy)).T
    mesh = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(np.stack([x, y, d], axis=1)),
        open3d.utility.Vector3iVector(full.faces),
    ).simplify_quadric_decimation(count)
    x, y, d = np.asarray(mesh.vertices).T
    z = scale / np.maximum(d, 1e-3)
    vertices = np.stack([(x - cx) * z, (y - cy) * z, z * geometry.focal_px], 1) / geometry.focal_px
    blank = np.zeros((len(vertices), 3))
    return Mesh(
        vertices.astype(np.float32),
        np.asarray(mesh.triangles).astype(np.int32),
        None,
        None,
        blank.astype(np.uint8),
        blank.astype(np.float32),
    )


def ways(
    preset: Preset, known: Known, disparity: DisparityMap[Array], *, watertight: bool
) -> Iterator[tuple[str, Callable[[], Mesh]]]:
    """Give each way to mesh by name, the full mesh first."""

    def by(meshing: Meshing) -> Callable[[], Mesh]:
        return lambda: meshing(disparity, known.pair)

    meshing = preset.meshing
    full = replace(meshing, decimation_sigma=0)
    yield "full", by(full)
    for sigma in SIGMAS:
        yield f"{sigma:g} sigma", by(replace(meshing, decimation_sigma=sigma))
    whole, few = full(disparity, known.pair), meshing(disparity, known.pair)
    yield "quadric", lambda: quadric(whole, known, len(few.faces))
    if watertight:
        yield "watertight", by(replace(meshing, watertight=True))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("presets", nargs="+")
    parser.add_argument("--pairs", type=int, default=10)
    parser.add_argument("--pool", type=Path, help="of drawn pairs, in place of drawing")
    parser.add_argument("--sigma-px", type=float, help="in place of the preset's")
    parser.add_argument("--watertight", action="store_true")
    options = parser.parse_args()
    scenes = [generated(number, options.pool) for number in range(options.pairs)]
    scenes += [still_life(DATA / name) for name in ("workshop", "reading_corner")]
    for name in options.presets:
        preset = load_preset(name)
        if options.sigma_px:
            points = replace(preset.triangulation, disparity_sigma_px=options.sigma_px)
            preset = replace(
                preset, triangulation=points, meshing=replace(preset.meshing, points=points)
            )
        measure(name, preset, scenes, watertight=options.watertight)


def measure(name: str, preset: Preset, scenes: list[Known], *, watertight: bool) -> None:
    """Print the figures of one preset."""
    errors, confidences, stated, rows = [], [], [], {}
    for known in scenes:
        disparity = preset.matcher(known.pair, known.disparities)
        matched = disparity.status == PixelStatus.MATCHED
        errors.append(np.abs(disparity.values - known.truth.disparity)[matched])
        confidences.append(disparity.confidence[matched])
        sigma_px = preset.triangulation.disparity_sigma(disparity)
        stated.append(sigma_px[matched])
        open_in_full, faces = None, 0
        for way, mesh_it in ways(preset, known, disparity, watertight=watertight):
            start = time.process_time()
            mesh = mesh_it()
            seconds = time.process_time() - start
            distances = surface_distances(mesh, known.truth)
            found, even = distances.in_sigmas(sigma_px), distances.in_sigmas(EVEN_PX)
            missed = np.isnan(distances.hit_m)
            if open_in_full is None:
                open_in_full, faces = missed, len(mesh.faces)
            beyond = float((open_in_full & ~missed).mean())
            row = (
                len(mesh.faces) / faces,
                seconds,
                found.median_sigma,
                found.p95_sigma,
                found.complete,
                beyond,
                even.median_sigma,
                even.complete,
            )
            rows.setdefault(way, []).append(row)
            print(f"  {name} {known.name} {way}: {len(mesh.faces)} triangles {row}", flush=True)
    everything, sure = np.concatenate(errors), np.concatenate(confidences)
    said = np.concatenate(stated)
    print(
        f"{name}: sigma_d of MATCHED pixels {np.percentile(everything, 68.27):.3f} px (68 %), "
        f"{1.4826 * np.median(everything):.3f} px (median); pixels state "
        f"{np.median(said):.3f} px (median), within 1 sigma are "
        f"{(everything <= said).mean():.1%}, within 3 {(everything <= 3 * said).mean():.1%}"
    )
    for low, high in ((0, 0.5), (0.5, 0.8), (0.8, 0.9), (0.9, 0.95), (0.95, 1.01)):
        there = everything[(sure >= low) & (sure < high)]
        if len(there) > 100:
            share, sigma = len(there) / len(everything), np.percentile(there, 68.27)
            print(f"  confidence {low} to {high:.2f}: {share:5.1%} of them, {sigma:.3f} px (68 %)")
    print(
        f"  {'means over scenes':>18} {'triangles':>9} {'CPU s':>6} {'median':>7} {'p95':>6} "
        f"{'within 3':>8} {'beyond':>7} {'of .5 px':>8} {'within 3':>8}"
    )
    for way, values in rows.items():
        share, seconds, median, p95, complete, beyond, half, within = np.mean(values, axis=0)
        print(
            f"  {way:>18} {share:9.1%} {seconds:6.2f} {median:7.3f} {p95:6.2f} {complete:8.1%} "
            f"{beyond:7.2%} {half:8.3f} {within:8.1%}"
        )


if __name__ == "__main__":
    main()
