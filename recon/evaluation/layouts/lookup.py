"""Which files lie where, and what the data set around them is called."""

from __future__ import annotations

from pathlib import Path

from recon.evaluation.scene import SceneFiles

__all__ = ["dataset_name", "first_file", "picture", "scene_in", "truth_file"]

SHORT_NAME = 2
"""Letters, as in Q, H and F; such names, years and those below need that of the folder above."""

SAY_LITTLE = ("train", "test", "two_view", "frames_", "full", "half", "third", "quarter")
PICTURE_ENDINGS = ("png", "ppm", "pgm")


def dataset_name(folder: Path) -> str:
    """Return a name for the scenes of a folder: its own, with that of its parent if it is vague.

    Args:
        folder: an absolute path, such as /data/MiddEval3/trainingQ (MiddEval3/trainingQ) or
            /data/middlebury-2005 (middlebury-2005).
    """
    own, above = folder.name, folder.parent.name
    vague = len(own) <= SHORT_NAME or own.isdigit() or own.lower().startswith(SAY_LITTLE)
    return f"{above}/{own}" if vague and above else own


def scene_in(folder: Path, layout: str, *, truth_folder: Path | None = None) -> SceneFiles:
    """Return the scene of a folder that is named after it.

    Args:
        folder: an absolute path.
        layout: a key of `LAYOUTS`.
        truth_folder: that holds its truth; None takes the same.
    """
    return SceneFiles(
        layout, dataset_name(folder.parent), folder.name, folder, truth_folder or folder
    )


def first_file(folder: Path, names: tuple[str, ...]) -> Path | None:
    """Return the first of these files that exists; None if there is none."""
    return next((folder / name for name in names if (folder / name).is_file()), None)


def picture(folder: Path, stem: str) -> Path | None:
    """Return the PNG, PPM or PGM file of this stem; None if there is none."""
    return first_file(folder, tuple(f"{stem}.{ending}" for ending in PICTURE_ENDINGS))


def truth_file(files: SceneFiles, names: tuple[str, ...]) -> Path:
    """Return the file that holds the true disparities.

    Args:
        files: the scene.
        names: of the file inside the truth folder, the usual one first.

    Raises:
        FileNotFoundError: if there is none.
    """
    found = first_file(files.truth_folder, names)
    if found is None:
        raise FileNotFoundError(
            f"{files.truth_folder} has no truth: expected {' or '.join(names)}; "
            "is it an archive of images only?"
        )
    return found
