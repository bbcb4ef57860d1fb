"""What a reconstruction leaves on disk."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from calib.formats import write_calibration
from calib.pair import RectifiedPair
from recon.files import (
    write_cloud,
    write_depth_png,
    write_disparity_png,
    write_glb,
    write_image,
    write_pfm,
    write_ply,
    write_status_png,
)
from recon.pipeline import Reconstruction

__all__ = [
    "OPTIONAL_CLOUDS",
    "OUTPUTS",
    "RECTIFIED_OUTPUTS",
    "all_or_nothing",
    "forget_unfinished",
    "write_rectified",
    "write_results",
]

OUTPUTS = {
    "disparity.pfm": "disparity of the left view in pixels, float; inf where there is none",
    "disparity.png": "the same as colours, with a bar",
    "depth.png": "depth in millimetres, 16 bit; 0 where there is none",
    "status.png": "why each pixel has a disparity, or has none",
    "cloud.ply": "points in metres with normal, colour, confidence, depth_sigma_m and status",
    "mesh.glb": "surfaces with the left photograph as texture, metres, y up",
    "mesh_vertex_colours.glb": "the same surfaces, a vertex for every pixel, with its colour",
    "recording.rrd": "every stage, for Rerun",
    "run.json": "settings, versions, times, counts and the metric sanity line",
}

OPTIONAL_CLOUDS = {
    "npz": "cloud.npz",
    "las": "cloud.las",
    "laz": "cloud.laz",
}
"""Further formats of the cloud, and their files."""

UNFINISHED = ".unfinished-"

RECTIFIED_OUTPUTS = ("left.png", "right.png", "rig.json")


@contextmanager
def all_or_nothing(
    folder: Path, outputs: Collection[str] = (*OUTPUTS, *OPTIONAL_CLOUDS.values())
) -> Iterator[Path]:
    """Give a new folder inside `folder`; its files move into `folder` if nothing went wrong.

    Then those of `outputs` that an earlier run left and this one did not make are removed: a
    recording beside the mesh of another run would mislead. If something went wrong, `folder` and
    its parents are as before, or missing as before.

    Args:
        folder: made if it does not exist.
        outputs: names of the files that are meant to be written.

    Yields:
        Where to write.

    Raises:
        ValueError: if the folder cannot be made or written to.
    """
    made: list[Path] = []
    unfinished = None
    try:
        try:
            made = [place for place in (folder, *folder.parents) if not place.exists()]
            unfinished = _writable(folder, outputs)
        except OSError as error:
            raise ValueError(
                f"cannot write to {folder}: {error.strerror}; choose another folder with -o"
            ) from error
        yield unfinished
        _moved(unfinished, folder, outputs)
        made = []
    finally:
        if unfinished is not None:
            shutil.rmtree(unfinished, ignore_errors=True)
        for place in made:
            with suppress(OSError):
                place.rmdir()


def forget_unfinished(folder: Path) -> None:
    """Remove what runs that were killed, and could not clean up, left inside `folder`."""
    for place in folder.glob(f"{UNFINISHED}*"):
        shutil.rmtree(place, ignore_errors=True)


def _writable(folder: Path, outputs: Collection[str]) -> Path:
    """Return a new folder inside `folder`, so on the same disk; make `folder` if need be."""
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder} is a file; give a folder to write to")
    in_the_way = [name for name in outputs if (folder / name).is_dir()]
    if in_the_way:
        raise ValueError(f"{folder / in_the_way[0]} is a folder; a file of this name is written")
    folder.mkdir(parents=True, exist_ok=True)
    return Path(tempfile.mkdtemp(prefix=UNFINISHED, dir=folder))


def _moved(unfinished: Path, folder: Path, outputs: Collection[str]) -> None:
    """Move the files of one folder into another, in place of those of an earlier run."""
    names = sorted(path.name for path in unfinished.iterdir())
    for name in names:
        (unfinished / name).replace(folder / name)
    for name in set(outputs) - set(names):
        (folder / name).unlink(missing_ok=True)


def write_results(folder: Path, result: Reconstruction, *, clouds: Collection[str] = ()) -> None:
    """Write all of `OUTPUTS` but the recording and run.json.

    Args:
        folder: exists.
        result: of `reconstruct`.
        clouds: keys of `OPTIONAL_CLOUDS`, formats to write the cloud in beside PLY.

    Raises:
        ValueError: if there is nothing to write, as when no pixel was matched.
    """
    if not len(result.mesh.faces):
        raise ValueError(
            "no surface was found: hardly a pixel was matched; is the pair rectified, and does "
            f"the range {result.disparities[0]} to {result.disparities[-1]} px fit it?"
        )
    disparity = result.disparity
    write_pfm(folder / "disparity.pfm", disparity.values)
    write_disparity_png(folder / "disparity.png", disparity.values)
    write_depth_png(folder / "depth.png", result.depth)
    write_status_png(folder / "status.png", disparity.status)
    write_ply(folder / "cloud.ply", result.cloud)
    for name in clouds:
        write_cloud(folder / OPTIONAL_CLOUDS[name], result.cloud)
    write_glb(folder / "mesh.glb", result.mesh)
    write_glb(folder / "mesh_vertex_colours.glb", result.dense_mesh, vertex_colours=True)


def write_rectified(folder: Path, pair: RectifiedPair) -> None:
    """Write `RECTIFIED_OUTPUTS`: both views and their geometry, for `read_pair`.

    Args:
        folder: exists.
        pair: rectified.
    """
    write_image(folder / "left.png", pair.left)
    write_image(folder / "right.png", pair.right)
    write_calibration(folder / "rig.json", pair.geometry)
