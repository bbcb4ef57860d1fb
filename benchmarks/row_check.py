"""See at which vertical residual matching along rows is meaningless, and whether that is noticed.

python benchmarks/row_check.py FOLDER... [--generated 2] [--scenes 1] [--preset fast]

Good pairs with truth are disturbed: one view is shifted or rolled, mirrored or turned upside down,
both are exchanged, or one is of another scene. Prints what the check measures and says, and what
becomes of the matching: the share of the pixels both cameras see that is matched within 2 px of
where the disturbed view shows them, and the share of what is matched that is not. A pair is called
meaningless if under half as many pixels are right as without the disturbance, or more than half of
the matched ones are wrong.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch

from calib.pair import Image, RectifiedPair
from calib.rig import RectifiedGeometry
from recon.evaluation import Scene, Truth, find_scenes, read_scene
from recon.evaluation.opencv_matchers import OpenCvMatcher
from recon.rectification import RectificationCheck, check_rectification
from recon.settings import load_preset
from recon.training.scenes import draw
from recon.types import Array, DisparityMap, PixelStatus

RIGHT_PX = 2.0
FIRST_SEED = 20_000_000
SIZE = (480, 320)
SHIFTS_PX = (0.5, 1, 2, 3, 4, 6, 10)
ROLLS_DEG = (0.5, 1, 2, 4)

Matching = Callable[[RectifiedPair, range], DisparityMap[Array]]


@dataclass(frozen=True)
class Outcome:
    """What became of one disturbed pair."""

    scene: str
    disturbed: str
    height: int
    check: RectificationCheck
    right: float
    wrong: float
    meaningless: bool


@dataclass(frozen=True, eq=False)
class Disturbed:
    """A pair after a disturbance, and where the right view shows its points now.

    Attributes:
        name: of the disturbance.
        pair: as it is checked and matched.
        truth: (H, W) disparities; those of the undisturbed pair where there are no right ones.
    """

    name: str
    pair: RectifiedPair
    truth: Array


def disturbances(scene: Scene, other: Image) -> Iterator[Disturbed]:
    """Disturb a pair in many ways, with the right view of another scene at last."""
    pair, truth = scene.pair, scene.truth.disparity
    yield Disturbed("as it is", pair, truth)
    for rows in SHIFTS_PX:
        yield _warped(f"down {rows:g} px", scene, np.array([[1, 0, 0], [0, 1, rows], [0, 0, 1.0]]))
    height, width = truth.shape
    middle = np.array([[1, 0, width / 2], [0, 1, height / 2], [0, 0, 1]])
    for degrees in ROLLS_DEG:
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        yield _warped(f"rolled {degrees:g} deg", scene, middle @ turn @ np.linalg.inv(middle))
    yield Disturbed("exchanged", replace(pair, left=pair.right, right=pair.left), truth)
    for name, view in (
        ("mirrored", np.ascontiguousarray(pair.right[:, ::-1])),
        ("upside down", np.ascontiguousarray(pair.right[::-1, ::-1])),
        ("of another scene", other),
    ):
        yield Disturbed(name, replace(pair, right=view), truth)


def _warped(name: str, scene: Scene, H: Array) -> Disturbed:
    """Warp the right view by a homography, and move the true matches with it."""
    right, truth = scene.pair.right, scene.truth.disparity
    size = right.shape[1::-1]
    image = cv2.warpPerspective(
        right, H, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )
    y, x = np.mgrid[: truth.shape[0], : truth.shape[1]]
    place = np.stack([x - truth, y, np.ones_like(truth)], axis=-1) @ H.T
    moved = x - place[..., 0] / place[..., 2]
    return Disturbed(name, replace(scene.pair, right=np.asarray(image, np.uint8)), moved)


def generated(count: int) -> Iterator[Scene]:
    """Draw pairs with truth."""
    for seed in range(FIRST_SEED, FIRST_SEED + count):
        sample = draw(torch.Generator().manual_seed(seed), SIZE)
        left, right = ((255 * v).round().byte().numpy() for v in (sample.left, sample.right))
        truth = Truth(sample.disparity_left.numpy(), sample.visible.numpy())
        candidates = range(int(np.nanmax(truth.disparity)) + 2)
        centre = (SIZE[0] / 2, SIZE[1] / 2)
        pair = RectifiedPair(left, right, RectifiedGeometry(SIZE, 500.0, centre, centre, 0.1))
        yield Scene("generated", f"{seed}", pair, False, candidates, truth)


def on_disk(folders: Sequence[Path], most: int) -> Iterator[Scene]:
    """Read some scenes of each folder, spread evenly."""
    for folder in folders:
        files = find_scenes(folder)
        for file in files[:: max(1, len(files) // most)][:most]:
            scene = read_scene(file)
            if scene.truth.disparity.shape == scene.pair.left.shape[:2]:
                yield scene


def shares(scene: Scene, changed: Disturbed, matcher: Matching) -> tuple[float, float]:
    """Return the share of the visible pixels that are right, and of the matched that are wrong."""
    known = np.isfinite(changed.truth)
    if scene.truth.visible is not None:
        known &= scene.truth.visible
    least, most = np.nanpercentile(changed.truth, (0.1, 99.9))
    first = min(scene.disparities[0], int(least) - 1)
    last = max(scene.disparities[-1], int(most) + 1)
    found = matcher(changed.pair, range(first, last + 1))
    matched = (np.asarray(found.status) == PixelStatus.MATCHED) & known
    off = np.abs(np.asarray(found.values) - changed.truth)[matched]
    right = int((off <= RIGHT_PX).sum())
    return right / int(known.sum()), 1 - right / max(1, len(off))


def outcomes_of(scene: Scene, other: Image, matcher: Matching) -> list[Outcome]:
    """Return what becomes of a pair after each disturbance."""
    outcomes: list[Outcome] = []
    height, width = scene.pair.left.shape[:2]
    other = np.asarray(cv2.resize(other, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
    for changed in disturbances(scene, other):
        right, wrong = shares(scene, changed, matcher)
        before = outcomes[0].right if outcomes else right
        meaningless = right < before / 2 or wrong > 0.5
        check = check_rectification(changed.pair)
        outcomes.append(Outcome(scene.name, changed.name, height, check, right, wrong, meaningless))
    return outcomes


def verdict(check: RectificationCheck) -> str:
    """Return what the check said, in a word."""
    if check.error is not None:
        return "error"
    if check.warnings:
        return "warning"
    return "nothing" if check.residual.reliable else "unknown"


def table(outcomes: Sequence[Outcome]) -> str:
    """Return a line for each disturbance."""
    lines = ["disturbance         residual px  of height  right  wrong  meaningless  said"]
    for name in dict.fromkeys(one.disturbed for one in outcomes):
        some = [one for one in outcomes if one.disturbed == name]
        reliable = [one for one in some if one.check.residual.reliable]
        off = [one.check.residual.mean_absolute_px for one in reliable] or [np.nan]
        share = [px / one.height for px, one in zip(off, reliable, strict=False)] or [np.nan]
        said = Counter(verdict(one.check) for one in some)
        lines.append(
            f"{name:20s} {np.median(off):10.2f} {np.median(share):10.2%} "
            f"{np.mean([one.right for one in some]):6.1%} "
            f"{np.mean([one.wrong for one in some]):6.1%} "
            f"{sum(one.meaningless for one in some):6d} of {len(some)}  "
            + ", ".join(f"{count} {word}" for word, count in said.most_common())
        )
    return "\n".join(lines)


def main() -> None:
    """Disturb many pairs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--generated", type=int, default=2)
    parser.add_argument("--scenes", type=int, default=1, help="of each folder, at most")
    parser.add_argument("--preset", help="that matches; OpenCV's semi-global matching if left out")
    options = parser.parse_args()
    matcher = OpenCvMatcher() if options.preset is None else load_preset(options.preset).matcher
    scenes = [*generated(options.generated), *on_disk(options.folders, options.scenes)]
    others = [scene.pair.right for scene in scenes[1:] + scenes[:1]]
    outcomes = []
    for scene, other in zip(scenes, others, strict=True):
        some = outcomes_of(scene, other, matcher)
        outcomes += some
        for one in some:
            residual = one.check.residual
            print(
                f"{scene.dataset} {one.scene}, {one.disturbed}: {residual.mean_absolute_px:.2f} px "
                f"of {one.height} on {residual.count} matches, {one.right:.1%} right, "
                f"{one.wrong:.1%} wrong, {'meaningless, ' if one.meaningless else ''}"
                f"{verdict(one.check)}",
                flush=True,
            )
    print(table(outcomes))


if __name__ == "__main__":
    main()
