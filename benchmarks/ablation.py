"""What each ingredient of the training buys: short trainings, each without one, on photographs.

python benchmarks/ablation.py DATASETS/middlebury-2005 DATASETS/middlebury-2006 [--scenes Art,Aloe]
    [--rows all no-light ...] [--steps 150] [--out out/ablation] [--network regulariser]

Every row is `reconstruct train` with one setting changed, from nothing, for a few steps on a small
pool; then all are compared by `reconstruct evaluate`: the matching cost network under the stages of
the `paper` preset, the regulariser under those of `context`, where it decides alone. The row
`another-seed` changes nothing but the seed: differences smaller than its own mean nothing.
What was trained before is kept.
"""

from __future__ import annotations

import argparse
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from recon.cli import main as reconstruct
from recon.training.progress import Lines, Scores
from recon.training.recipe import HARD, SCENES, Recipe
from recon.training.settings import FeatureTraining, RegulariserTraining, Training
from recon.training.train import train

ROWS: dict[str, dict[str, Any]] = {
    "all": {},
    "another-seed": {"seed": 1},
    "raw-costs": {"support_px": 0},
    "no-edge-weight": {"edge_weight": 0.0},
    "no-photometric": {"photometric": False},
    "no-geometric": {"geometric": False},
    "no-occluders": {"occluders": False},
    "narrow-baselines": {"recipe": Recipe(wide_baselines=False)},
    "flat-background": {"recipe": Recipe(textured_background=False)},
    "no-weak-texture": {"recipe": Recipe(weak_texture=False)},
    "no-shared-textures": {"recipe": Recipe(shared_textures=False)},
    "no-repetition": {"recipe": Recipe(repeated_structures=False)},
    "no-reliefs": {"recipe": Recipe(reliefs=False)},
    "no-light": {"recipe": Recipe(light=False)},
    "cut-outs-alone": {"recipe": Recipe(scenes=("clutter",))},
    "hard-scenes-too": {"recipe": Recipe(scenes=(*SCENES, *HARD, *HARD))},
}
PRESETS = {
    "features": "paper matching_cost.weights={weights}",
    "regulariser": "context optimisation.weights={weights} optimisation.averaged_px=0"
    " optimisation.doubted_px=1e9",
}
"""Which stages a network is judged under."""


def trained(name: str, changes: dict[str, Any], base: Training, out: Path) -> Path:
    """Train a row unless that was done, and return its weights."""
    weights = out / name / f"{base.name}.safetensors"
    if not weights.exists():
        recipe = "all" if "recipe" not in changes else name
        settings = replace(base, out=out / name, pool=out / "pools" / recipe, **changes)
        lines = Lines(print)
        train(settings, observe=lambda stage, said: _say(lines, name, stage, said))
    return weights


def _rows_of(base: Training) -> list[str]:
    """Return the rows whose settings this training has."""
    known = {field.name for field in fields(base)}
    return [name for name, changes in ROWS.items() if changes.keys() <= known]


def _say(lines: Lines, name: str, stage: str, said: object) -> None:
    if isinstance(said, Scores):
        print(name, said)
    else:
        lines(stage, said)


def main() -> None:
    """Train what is missing and compare."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("datasets", nargs="+")
    parser.add_argument("--scenes", default="")
    parser.add_argument("--rows", nargs="*", choices=list(ROWS))
    parser.add_argument("--network", default="features", choices=list(PRESETS))
    parser.add_argument("--variant", default="fast", help="of the matching cost network")
    parser.add_argument("--steps", type=int, default=150)
    parser.add_argument("--batch", type=int, default=2)
    parser.add_argument("--pairs", type=int, default=56)
    parser.add_argument("--out", type=Path, default=Path("out/ablation"))
    options = parser.parse_args()
    shared: dict[str, Any] = {
        "source": "pool",
        "steps": options.steps,
        "batch": options.batch,
        "pairs": options.pairs,
        "validation_pairs": 8,
        "warm_up": max(1, options.steps // 10),
        "save_every": options.steps,
    }
    base: Training = RegulariserTraining(**shared)
    if options.network == "features":
        base = FeatureTraining(variant=options.variant, edges_from=options.steps // 4, **shared)
    variants = []
    rows = options.rows or _rows_of(base)
    for name in rows:
        weights = trained(name, ROWS[name], base, options.out)
        variants += ["--variant", f"{name}={PRESETS[options.network].format(weights=weights)}"]
    only = ["--scenes", options.scenes] if options.scenes else []
    reconstruct(["evaluate", *options.datasets, *only, *variants, "-o", str(options.out / "maps")])


if __name__ == "__main__":
    main()
