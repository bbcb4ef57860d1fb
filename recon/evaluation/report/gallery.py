"""The pictures of every scene, placed inside the page."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from PIL import Image as Pictures

from recon.evaluation.report.contents import (
    SceneName,
    figure_of,
    main_protocol,
    region_of,
    scene_figures,
    scene_names,
)
from recon.evaluation.report.numbers import fixed, two_digits
from recon.evaluation.report.pictures import DISPARITY, ERROR, LEFT, TRUTH

__all__ = ["MethodPictures", "Picture", "PictureSource", "ScenePictures", "gallery"]

PictureSource = Callable[[str | None, str, str, str], bytes | None]
"""(method or None for the scene's own, data set, scene, file name) -> contents of the file."""

TYPES = {".jpg": "image/jpeg", ".png": "image/png"}


@dataclass(frozen=True)
class Picture:
    """An image file as part of a page.

    Attributes:
        address: a data URI.
        width: in pixels.
        height: in pixels.
        title: what it shows.
    """

    address: str
    width: int
    height: int
    title: str


@dataclass(frozen=True)
class MethodPictures:
    """What one method made of a scene.

    Attributes:
        method: its name.
        figures: pairs of a measure and its value, as they are written.
        reason: why there is no result, "" if there is one.
        disparity: None if there is no such file.
        error: None if there is no such file.
    """

    method: str
    figures: tuple[tuple[str, str], ...]
    reason: str
    disparity: Picture | None
    error: Picture | None


@dataclass(frozen=True)
class ScenePictures:
    """One scene and all results on it.

    Attributes:
        scene: its name.
        label: of the protocol whose figures are printed.
        region: in which they are counted.
        facts: size and range searched, "" if not known.
        left: None if there is no such file.
        truth: None if there is no such file.
        results: one a method that was tried.
    """

    scene: SceneName
    label: str
    region: str
    facts: str
    left: Picture | None
    truth: Picture | None
    results: tuple[MethodPictures, ...]


def gallery(results: Mapping[str, Any], pictures: PictureSource) -> tuple[ScenePictures, ...]:
    """Return all scenes with their pictures.

    Args:
        results: the whole result.
        pictures: where the files are found.
    """
    return tuple(
        _scene_pictures(results, scene, label, pictures)
        for scene in scene_names(results)
        if (label := main_protocol(results, scene.key)) is not None
    )


def _scene_pictures(
    results: Mapping[str, Any], scene: SceneName, label: str, pictures: PictureSource
) -> ScenePictures:
    tried = {
        method: figures
        for method in results["methods"]
        if (figures := scene_figures(results, method, label, scene.key)) is not None
    }
    regions = {region_of(figures) for figures in tried.values()}
    region = "nonocc" if "nonocc" in regions else "all"
    return ScenePictures(
        scene,
        label,
        region,
        next((_facts(figures) for figures in tried.values() if "size" in figures), ""),
        _picture(pictures, None, scene, LEFT, f"{scene.name}, left photograph"),
        _picture(pictures, None, scene, TRUTH, f"{scene.name}, true disparity"),
        tuple(
            MethodPictures(
                method,
                _captions(figures, region),
                str(figures.get("error", "")),
                _picture(pictures, method, scene, DISPARITY, f"{scene.name}, {method}: disparity"),
                _picture(pictures, method, scene, ERROR, f"{scene.name}, {method}: error"),
            )
            for method, figures in tried.items()
        ),
    )


def _facts(figures: Mapping[str, Any]) -> str:
    """Say how large a scene is and what was searched."""
    width, height = figures["size"]
    text = f"{width} × {height} px"
    if "disparities" in figures:
        first, last = figures["disparities"]
        text += f", disparities {first} to {last}"
    return text


def _captions(figures: Mapping[str, Any], region: str) -> tuple[tuple[str, str], ...]:
    if "error" in figures:
        return ()
    seconds = two_digits(figures.get("seconds"))
    return (
        ("avgerr", f"{fixed(figure_of(figures, region, 'avgerr'))} px"),
        ("bad2.0", f"{fixed(figure_of(figures, region, 'bad2.0'))} %"),
        ("time", f"{seconds} s"),
    )


def _picture(
    pictures: PictureSource, method: str | None, scene: SceneName, name: str, title: str
) -> Picture | None:
    """Return a file as part of the page, None if there is none."""
    contents = pictures(method, scene.dataset, scene.name, name)
    if contents is None:
        return None
    with Pictures.open(io.BytesIO(contents)) as picture:
        width, height = picture.size
    kind = TYPES[name[name.rindex(".") :]]
    encoded = base64.b64encode(contents).decode("ascii")
    return Picture(f"data:{kind};base64,{encoded}", width, height, title)
