"""The layouts that are known, and how to find and read scenes of any of them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from recon.evaluation.layouts.generated import GENERATED, TRAINING_POOL
from recon.evaluation.layouts.kitti import KITTI
from recon.evaluation.layouts.middlebury_classic import (
    MIDDLEBURY_2001_2003,
    MIDDLEBURY_2005_2006,
)
from recon.evaluation.layouts.middlebury_v3 import MIDDLEBURY_V3
from recon.evaluation.layouts.protocol import Layout
from recon.evaluation.layouts.sceneflow import SCENEFLOW, SCENEFLOW_TREE
from recon.evaluation.scene import Scene, SceneFiles

__all__ = ["LAYOUTS", "find_scenes", "read_scene"]

# The first that recognises a folder takes it.
LAYOUTS: dict[str, Layout] = {
    layout.name: layout
    for layout in (
        MIDDLEBURY_V3,
        MIDDLEBURY_2001_2003,
        MIDDLEBURY_2005_2006,
        KITTI,
        SCENEFLOW,
        SCENEFLOW_TREE,
        GENERATED,
        TRAINING_POOL,
    )
}

DEEPEST = 4
"""Levels of folders below the one that was given."""

MOST_NAMES_SHOWN = 8


def find_scenes(path: str | Path, *, truth: str | Path | None = None) -> list[SceneFiles]:
    """Find the pairs with truth in a folder, told by the names of its files.

    A scene whose truth is missing is found too; reading it says so. Of a tree that has none at
    all (KITTI's testing, SceneFlow without its disparities) nothing is found, and if there is
    nothing else, the error says so.

    Args:
        path: one scene, a folder of scenes, or a folder of data sets.
        truth: a folder with the same scenes, whose truth is used in place of their own; it may
            be 2 or 4 times as large as the images. For layouts of a folder a scene only.

    Returns:
        At least one scene; sorted by data set and name, both together unique.

    Raises:
        ValueError: if there is no such folder, or nothing in it is recognised.
    """
    root = _folder(path)
    found = list(_search(root, DEEPEST))
    scenes = [item for item in found if isinstance(item, SceneFiles)]
    if not scenes:
        complaints = [item for item in found if isinstance(item, ValueError)]
        raise complaints[0] if complaints else _nothing_recognised(root)
    _check_unique(scenes)
    if truth is not None:
        scenes = _with_truth(scenes, root, _folder(truth))
    return sorted(scenes, key=lambda scene: (scene.dataset, scene.name))


def read_scene(files: SceneFiles) -> Scene:
    """Read a pair and its truth.

    Args:
        files: as `find_scenes` returned them.

    Raises:
        FileNotFoundError: if a file is missing, the truth for one; the message names it.
        ValueError: if a file is not what it should be; the message names it.
    """
    return LAYOUTS[files.layout].read(files)


def _folder(path: str | Path) -> Path:
    """Return an absolute path, or raise ValueError if it is not a folder."""
    folder = Path(path).resolve()
    if folder.is_file():
        raise ValueError(f"{path} is a file; give the folder of a scene, or one above it")
    if not folder.is_dir():
        raise ValueError(f"there is no folder {path}")
    return folder


def _search(folder: Path, levels: int) -> Iterator[SceneFiles | ValueError]:
    """Yield the scenes of a folder, or if it has none itself, those of its subfolders.

    A tree without truth is yielded as the error that says so.
    """
    for layout in LAYOUTS.values():
        try:
            scenes = layout.find(folder)
        except ValueError as error:
            yield error
            return
        if scenes:
            yield from scenes
            return
    if levels:
        for child in sorted(folder.iterdir()):
            if child.is_dir() and not child.name.startswith("."):
                yield from _search(child, levels - 1)


def _nothing_recognised(folder: Path) -> ValueError:
    """Return the error that says what a folder holds and what was expected."""
    expected = "\n".join(f"  {layout.looks_like}" for layout in LAYOUTS.values())
    return ValueError(
        f"no pair with truth was recognised in {folder}, which holds {_contents(folder)}; "
        f"expected folders of\n{expected}"
    )


def _contents(folder: Path) -> str:
    """Return the first names in a folder."""
    names = sorted(entry.name for entry in folder.iterdir())
    more = ", ..." if len(names) > MOST_NAMES_SHOWN else ""
    return ", ".join(names[:MOST_NAMES_SHOWN]) + more or "nothing"


def _check_unique(scenes: list[SceneFiles]) -> None:
    """Raise ValueError if two scenes would be told apart by their place only."""
    places = defaultdict(set)
    for scene in scenes:
        places[scene.dataset, scene.name].add(scene.folder)
    for (dataset, name), folders in places.items():
        if len(folders) > 1:
            raise ValueError(
                f"{' and '.join(map(str, sorted(folders)))} would both be called {dataset}/{name}; "
                "give one of the folders above them"
            )


def _with_truth(scenes: list[SceneFiles], root: Path, truth: Path) -> list[SceneFiles]:
    """Return the same scenes with the truth of another root.

    Raises:
        ValueError: if scenes have no folder of their own, or the root has a folder for none.
    """
    for scene in scenes:
        if scene.folder.name != scene.name:
            raise ValueError(
                f"{scene.dataset}/{scene.name} has no folder of its own, so its truth cannot be "
                f"taken from {truth}; leave the truth out"
            )
    moved = [replace(scene, truth_folder=_truth_folder(scene, root, truth)) for scene in scenes]
    if not any(scene.truth_folder.is_dir() for scene in moved):
        raise ValueError(
            f"{truth} has no folder that is called like one of the scenes, such as "
            f"{scenes[0].name}; it holds {_contents(truth)}"
        )
    return moved


def _truth_folder(scene: SceneFiles, root: Path, truth: Path) -> Path:
    """Return the folder in the same place below `truth`, else the one of the same name in it."""
    same_place = truth / scene.folder.relative_to(root)
    if scene.folder == root:
        same_place = truth / scene.name if (truth / scene.name).is_dir() else truth
    return same_place if same_place.is_dir() else truth / scene.name
