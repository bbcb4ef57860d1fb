"""Fuse sequences whose surface is known in part, and say how far from it the result is.

python benchmarks/sequence.py street|room|board|generated [--datasets DIR] [--out DIR] [--scale 1]

street: 25 pairs of a KITTI street: time, memory and two pictures (side.jpg and top.jpg).
room: five colours with depths and poses: how flat the largest plane is against what is stated.
board: pairs of a rig moved round a ChArUco board, rig and poses from the board: how flat it is.
generated: a still life seen from exact poses: distance to the exact surface, fused and of one pair.
"""

from __future__ import annotations

import argparse
import math
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib import Pose, RectifiedGeometry, write_calibration
from calib.formats import CalibrationRecord
from calib.trajectories import Trajectory, read_trajectory, write_trajectory
from recon.files import read_ply, write_image
from recon.fusion import DepthView, FusedSurface
from recon.open3d_library import loaded_open3d
from recon.sequence import (
    RgbdSource,
    StereoSource,
    find_depth_frames,
    find_pairs,
    fuse_sequence,
    poses_of_frames,
)
from recon.sequence.frames import FrameOnDisk
from recon.sequence.sources import looked_at_first
from recon.settings import load_preset
from recon.training.composition import Scene, View
from recon.training.samples import still_life_scene
from recon.training.scenes import render
from recon.training.walks import off_surface, seen_from
from recon.types import Array

STREET, ROOM = "sequences/kitti-odometry-snippet", "sequences/slambook2-rgbd5"
BOARD = "calibration/charuco-wideangle"
TARGET = "charuco:31x16:49.33mm:38.46mm:DICT_4X4_1000"
BOARD_M = (31 * 0.04933, 16 * 0.04933)
MARGIN_M = 0.05
FEWEST = 1000
ROOM_INTRINSICS = ("518", "519", "325.5", "253.5")
SEEN = View(width=360, height=270, focal_px=380.0, baseline_m=0.14)
STEPS = 8
SPARE_PX = 4


def run(*arguments: str) -> tuple[float, float, float]:
    """Run `reconstruct` and return wall seconds, processor seconds and the peak in GB."""
    begun, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    code = "from recon.cli import main; main()"
    subprocess.run([sys.executable, "-c", code, *arguments], check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - begun, used, after.ru_maxrss / 1e6


def spread(values: Array) -> float:
    """Return the standard deviation of the middle of a distribution, 1.4826 x MAD."""
    return float(1.4826 * np.median(np.abs(values - np.median(values))))


def say_flat(name: str, off: Array, sigma: Array) -> None:
    """Print how far points lie from their plane, and what was stated."""
    print(
        f"{name}: {len(off):,} points, spread {spread(off) * 1000:.2f} mm, 95 % within "
        f"{np.quantile(np.abs(off - np.median(off)), 0.95) * 1000:.2f} mm of the median; stated "
        f"sigma {np.median(sigma) * 1000:.2f} mm (ratio {spread(off) / np.median(sigma):.2f})"
    )


def street(datasets: Path, out: Path, scale: str) -> None:
    """Fuse the street and draw it."""
    folder = datasets / STREET
    wall, used, peak = run(
        *("sequence", str(folder), "--calib", str(folder / "calib.txt")),
        *("--poses", str(folder / "poses.txt"), "-o", str(out), "--scale", scale, "--keep-frames"),
    )
    print(f"street: {wall:.0f} s, {used:.0f} s of all processors, peak {peak:.2f} GB")
    draw(out)


def draw(out: Path) -> None:
    """Draw the mesh of a street from the side and from above, without perspective."""
    import trimesh

    mesh = trimesh.load(out / "mesh.glb", force="mesh", process=False)
    cloud = read_ply(out / "cloud.ply")  # the vertices of the mesh, in the frame of the poses
    caster = Caster(cloud.points, np.asarray(mesh.faces), cloud.colours.astype(np.float64))
    middle = np.array([0.0, -2.5, 28.0])
    write_image(out / "side.jpg", caster.picture(middle, [1, 0, 0], [0, -1, 0], 64, (1400, 300)))
    write_image(out / "top.jpg", caster.picture(middle, [0, 1, 0], [-1, 0, 0], 64, (1400, 560)))


class Caster:
    """Draws a mesh with colours at its vertices, or a texture, by casting parallel rays."""

    def __init__(
        self, vertices: Array, faces: Array, colours: Array, texture: Array | None = None
    ) -> None:
        """Take a mesh in metres; with a texture, `colours` are (V, 2) places in it in [0, 1]."""
        o3d = loaded_open3d()
        self._tensor, self._faces, self._colours = o3d.core.Tensor, faces, colours
        self._texture, self._vertices = texture, vertices
        self._scene = o3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(
            self._tensor(vertices.astype(np.float32)), self._tensor(faces.astype(np.uint32))
        )

    def picture(
        self,
        middle: Array,
        ahead: list[float],
        up: list[float],
        wide_m: float,
        size: tuple[int, int],
        nothing: tuple[int, int, int] = (255, 255, 255),
    ) -> Array:
        """Return (H, W, 3) uint8 of what is `wide_m` wide around `middle`, white elsewhere."""
        (width, height), z = size, np.array(ahead, float)
        x = np.cross(z, up)
        x /= np.linalg.norm(x)
        y, step = np.cross(z, x), wide_m / width
        across = (np.arange(width) - (width - 1) / 2) * step
        down = (np.arange(height) - (height - 1) / 2) * step
        before = ((self._vertices - middle) @ z).min() - step  # near, as rays are single precision
        origin = middle + before * z + down[:, None, None] * y + across[None, :, None] * x
        rays = np.concatenate([origin, np.broadcast_to(z, origin.shape)], axis=-1)
        found = self._scene.cast_rays(self._tensor(rays.astype(np.float32)))
        hit = np.isfinite(found["t_hit"].numpy())
        corners = self._faces[np.where(hit, found["primitive_ids"].numpy(), 0)]
        u, v = np.moveaxis(found["primitive_uvs"].numpy(), -1, 0)
        shares = np.stack([1 - u - v, u, v], axis=-1)[..., None]
        lit = 0.6 + 0.4 * np.abs(found["primitive_normals"].numpy() @ z)[..., None]
        colour = (self._colours[corners] * shares).sum(-2)
        if self._texture is not None:
            rows, columns = self._texture.shape[:2]
            at = (colour * (columns, rows)).astype(int).clip(0, (columns - 1, rows - 1))
            colour = self._texture[at[..., 1], at[..., 0]]
        drawn: Array = np.where(hit[..., None], colour * lit, nothing).clip(0, 255).astype(np.uint8)
        return drawn


def room(datasets: Path, out: Path) -> None:
    """Fuse colours and depths, and look at the largest plane."""
    folder = datasets / ROOM
    wall, used, peak = run(
        *("sequence", str(folder), "--intrinsics", *ROOM_INTRINSICS),
        *("--poses", str(folder / "pose.txt"), "-o", str(out)),
    )
    print(f"room: {wall:.0f} s, {used:.0f} s of all processors, peak {peak:.2f} GB")
    plane, band = say_plane(out)
    frames = find_depth_frames(folder)
    poses, _ = poses_of_frames(read_trajectory(folder / "pose.txt"), frames)
    fx, fy, cx, cy = (float(value) for value in ROOM_INTRINSICS)
    source = RgbdSource.of((fx, fy, cx, cy), 0.001)
    for frame, pose in zip(frames, poses, strict=True):
        say_frame(frame.name, source.view(source.see(frame), pose), plane, band)


def say_frame(name: str, view: DepthView, plane: Array, band: float) -> None:
    """Print where one view alone, placed by its pose, has a plane (a, b, c, d), and how flat."""
    places = view.positions(np.isfinite(view.depth))
    off = places @ plane[:3] + plane[3]
    near = np.abs(off) < 2 * band
    if near.sum() < FEWEST:
        return
    there = places[near] - places[near].mean(axis=0)
    own = np.linalg.eigh(there.T @ there)[1][:, 0]
    tilt = np.degrees(np.arccos(min(1.0, abs(float(own @ plane[:3])))))
    print(
        f"  frame {name}: {near.sum():,} depths within {2000 * band:.0f} mm of it, in the median "
        f"{np.median(off[near]) * 1000:+.1f} mm off, its own plane tilted by {tilt:.2f} degrees "
        f"and flat to {spread(there @ own) * 1000:.1f} mm; stated sigma of one view "
        f"{np.median(view.sigma_m[np.isfinite(view.depth)][near]) * 1000:.1f} mm"
    )


def say_plane(out: Path) -> tuple[Array, float]:
    """Print how flat the largest plane of a cloud is; return it and how near to it points count."""
    cloud = read_ply(out / "cloud.ply")
    o3d = loaded_open3d()
    points = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud.points.astype(np.float64)))
    o3d.utility.random.seed(1)
    band = 5 * float(np.median(cloud.depth_sigma_m))
    (*normal, offset), _ = points.segment_plane(band, 3, 2000)
    off = cloud.points @ np.array(normal) + offset
    facing = np.abs(cloud.normals @ np.array(normal)) > 0.8
    near = facing & (np.abs(off) < 2 * band)  # wider than the fit, so that tails count
    say_flat("largest plane", off[near], cloud.depth_sigma_m[near])
    return np.array([*normal, offset]), band


def board(datasets: Path, out: Path) -> None:
    """Calibrate a rig on a board, place it by the board, fuse, and look at the board."""
    from recon.calibration import calibrate

    folder = datasets / BOARD
    found = calibrate(str(folder / "left"), str(folder / "right"), TARGET, model="rational")
    names, poses = found.estimate.names, found.estimate.board_poses
    out.mkdir(parents=True, exist_ok=True)
    write_calibration(out / "rig.json", found.estimate.calibration)
    with tempfile.TemporaryDirectory() as place:
        chosen = {pair.name: pair for pair in found.pairs if pair.name in names}
        for side in ("left", "right"):
            (Path(place) / side).mkdir()
        for pair in chosen.values():
            assert pair.right is not None
            (Path(place) / "left" / pair.left.name).symlink_to(pair.left.resolve())
            (Path(place) / "right" / pair.right.name).symlink_to(pair.right.resolve())
        trajectory = Trajectory(tuple(pose.inverse() for pose in poses), names=tuple(names))
        write_trajectory(out / "board_poses.json", trajectory)
        wall, used, peak = run(
            *("sequence", place, "--calib", str(out / "rig.json"), "--raw"),
            *("--poses", str(out / "board_poses.json"), "-o", str(out)),
        )
    print(f"board: {wall:.0f} s, {used:.0f} s of all processors, peak {peak:.2f} GB")
    say_board(out)


def say_board(out: Path) -> None:
    """Print how flat the board is, and how far from where the corners say."""
    cloud = read_ply(out / "cloud.ply")
    x, y, z = cloud.points.T
    on_board = (x > MARGIN_M) & (x < BOARD_M[0] - MARGIN_M) & (np.abs(z) < 0.1)
    on_board &= (y > MARGIN_M) & (y < BOARD_M[1] - MARGIN_M)
    say_flat("board", z[on_board], cloud.depth_sigma_m[on_board])
    print(f"the board lies {np.median(z[on_board]) * 1000:+.2f} mm from its corners")


def generated(out: Path) -> None:
    """Fuse a still life from exact poses, and compare with each of its pairs alone."""
    scene = still_life_scene("workshop")
    poses = tuple(
        Pose.from_values(np.array([0, -0.01 * n, 0, 0.04 * n, 0.01 * n, 0.1 * n]))
        for n in range(STEPS)
    )
    frames, rig = drawn_pairs(scene, SEEN, poses, out)
    look = looked_at_first(frames, rig)
    source = StereoSource(rig, load_preset("fast"), look.disparities, look.pair.geometry)
    fused = fuse_sequence(frames, source, poses)
    print(f"voxels of {fused.fusion.voxel_m:g} m, depths up to {fused.farthest_m:.2f} m")
    for number in (0, STEPS // 2, STEPS - 1):
        pose, there = poses[number], seen_from(scene, poses[number])
        view = source.view(source.see(frames[number]), Pose.identity())
        cast = depth_seen(fused.surface, view, pose)
        used = fused.fusion.solid(view)
        used &= np.isfinite(cast)
        alone = off_surface(there, view.positions(used))
        together = off_surface(there, replace(view, depth=cast).positions(used))
        one, many = (float(np.median(off)) * 1000 for off in (alone, together))
        print(
            f"pair {number}: median distance {one:.2f} mm alone, {many:.2f} mm fused "
            f"({one / many:.2f} times less), at the {used.mean():.0%} of pixels that both have"
        )


def drawn_pairs(
    scene: Scene, view: View, poses: tuple[Pose, ...], out: Path
) -> tuple[list[FrameOnDisk], Path]:
    """Draw a scene from every pose; return the pairs on disk and their calibration."""
    geometry = RectifiedGeometry(
        (view.width, view.height), view.focal_px, view.centre, view.centre, view.baseline_m
    )
    for side in ("left", "right"):
        (out / side).mkdir(parents=True, exist_ok=True)
    largest = 0.0
    for number, pose in enumerate(poses):
        sample = render(seen_from(scene, pose), view)
        largest = max(largest, float(sample.disparity_left.max()))
        for side, image in (("left", sample.left), ("right", sample.right)):
            write_image(out / side / f"{number}.png", (image * 255).round().byte().numpy())
    rig, searched = out / "rig.json", range(math.ceil(largest) + SPARE_PX)
    write_calibration(rig, CalibrationRecord(None, geometry, rig, "json", searched))
    return find_pairs(out), rig


def depth_seen(surface: FusedSurface, view: DepthView, pose: Pose) -> Array:
    """Return the depth (H, W) of a surface in the world as a view sees it from a pose."""
    o3d = loaded_open3d()
    scene = o3d.t.geometry.RaycastingScene()
    seen = pose.inverse().apply(surface.vertices.astype(np.float64)).astype(np.float32)
    scene.add_triangles(o3d.core.Tensor(seen), o3d.core.Tensor(surface.faces.astype(np.uint32)))
    ones = replace(view, depth=np.ones_like(view.depth))
    rays = ones.positions(np.ones(view.depth.shape, bool)).astype(np.float32)
    rays = np.concatenate([np.zeros_like(rays), rays], axis=1)
    met = scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()
    depth: Array = np.where(np.isfinite(met), met, np.nan).reshape(view.depth.shape)
    return depth


def main() -> None:
    """Run one of the four."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("which", choices=("street", "room", "board", "generated", "draw"))
    parser.add_argument("--datasets", type=Path, default=os.environ.get("RECON_DATASETS"))
    parser.add_argument("--out", type=Path, default=Path("out/sequence"))
    parser.add_argument("--scale", default="1")
    options = parser.parse_args()
    if options.which == "generated":
        generated(options.out)
    elif options.which == "draw":
        draw(options.out)
    elif options.datasets is None:
        parser.error("give --datasets, or set RECON_DATASETS")
    elif options.which == "street":
        street(options.datasets, options.out, options.scale)
    else:
        {"room": room, "board": board}[options.which](options.datasets, options.out)


if __name__ == "__main__":
    main()
