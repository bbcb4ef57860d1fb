"""What each stage of the preset `best` buys: the preset, and the preset without one thing.

python benchmarks/stages.py DATASET... [--rows best no-bilateral ...] [-o out/stages] [--resume]

Every row is a variant for `reconstruct evaluate`, which this calls once with all of them.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from recon.cli import main as reconstruct

SMOOTH = "{method='domain_transform',sigma_space_px=10.0,sigma_range=0.03,confidence_weighted=true"
DOUBTED = f"{SMOOTH},below_confidence=0.5}}"
ROWS = {
    "best": "",
    "no-row-alignment": "row_alignment=false",
    "no-enlargement": "enlargement=false",
    "enlarged-network": "enlargement.cost=same",
    "no-census": "matching_cost.census_share=0.0",
    "census": "matching_cost=census",
    "paper-share": "matching_cost.direct_share=0.1",
    "no-bilateral": "aggregation=none",
    "no-paths": "optimisation=winner_takes_all",
    "8-paths": "optimisation.directions=8",
    "stronger-steps": "optimisation.large_step=3.75",
    "steps-across-edges": "optimisation.across_edge=1.0",
    "parabola": "optimisation.shared_slope=-1.0",
    "whole-pixels": "optimisation.subpixel=false",
    "no-check": "left_right_tolerance_px=1e9 min_segment_px=0",
    "islands": "min_segment_px=0",
    "flat-filling": "filling.most_rise_px=0.0",
    "background-filling": "filling=background",
    "no-contradiction": "filling.tolerance_px=1e9",
    "no-refinement": "refinements=[]",
    "median-alone": "refinements=['median']",
    "no-planes": f"refinements=['median',{DOUBTED}]",
    "no-filter": "refinements=['median','local_planes']",
    "weighted-median": f"refinements=['weighted_median',{DOUBTED},'local_planes']",
    "filter-everywhere": f"refinements=['median',{SMOOTH}}},'local_planes']",
    "coarse-to-fine": "coarse_to_fine=true",
}


def main() -> None:
    """Compare the rows."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("datasets", nargs="+")
    parser.add_argument("--scenes", default="")
    parser.add_argument("--rows", nargs="*", default=list(ROWS), choices=list(ROWS))
    parser.add_argument("-o", "--out", type=Path, default=Path("out/stages"))
    parser.add_argument("--resume", action="store_true")
    options = parser.parse_args()
    variants = [
        word for name in options.rows for word in ("--variant", f"{name}=best {ROWS[name]}".strip())
    ]
    only = ["--scenes", options.scenes] if options.scenes else []
    again = ["--resume"] if options.resume else []
    reconstruct(["evaluate", *options.datasets, *only, *variants, *again, "-o", str(options.out)])


if __name__ == "__main__":
    main()
