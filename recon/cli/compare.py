"""`reconstruct compare`: how far one reconstruction is from another, or from the truth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from tyro.conf import Positional

from recon.cli.terminal import Out, console, warn

if TYPE_CHECKING:
    from recon.comparison import Comparison

__all__ = ["compare"]

ROWS = {
    "points": "points asked",
    "median_m": "median",
    "mean_m": "mean",
    "p90_m": "90 % are below",
    "p95_m": "95 % are below",
    "within_1%": "within 1 % of the range",
    "within_5%": "within 5 % of the range",
    "within_3_sigma": "within 3 sigma",
}


def compare(a: Positional[Path], b: Positional[Path], /, *, out: Out, align: bool = False) -> None:
    """Measure the distances between two reconstructions.

    Args:
        a: a folder that `reconstruct pair` made, a cloud (.ply, .npz, .las, .laz) or a mesh (.glb,
            .ply, .obj, ...).
        b: another one, or a folder with a pair and its true disparities, such as data/workshop.
        out: folder for compare.html, compare.json and a_by_distance.ply.
        align: move A onto B first (closest points to planes), and say by how much; for small
            motions, without scaling.
    """
    from recon import comparison
    from recon.output import all_or_nothing

    shapes = comparison.read_shape(a), comparison.read_shape(b)
    found = comparison.compare(*shapes, align=align)
    with all_or_nothing(out, comparison.DISTANCE_OUTPUTS) as folder:
        comparison.write_comparison(folder, found)
    _say(found, out)


def _say(found: Comparison, out: Path) -> None:
    """Print the figures of both directions, and what to be careful about."""
    from rich.table import Table

    from recon.comparison.figures import plain_figures

    figures = plain_figures(found)
    for key in ("a", "b"):
        shape = figures[key]
        of_mesh = " on its faces" if shape["mesh"] else ""
        console.print(f"{key.upper()}: {shape['name']}, {shape['points']:,} points{of_mesh}")
    if hint := figures["scale hint"]:
        warn(hint)
    if found.alignment is not None:
        motion = found.alignment
        console.print(
            f"A was turned by {motion.rotation_deg:.3f} degrees and shifted by "
            f"{_metres(motion.translation_m)}; its median distance was "
            f"{_metres(motion.median_before_m)} before",
            soft_wrap=True,
        )
    table = Table("", "from A to B", "from B to A", box=None, pad_edge=False)
    for name, title in ROWS.items():
        table.add_row(title, *(_cell(name, figures[key]) for key in ("a to b", "b to a")))
    console.print(table)
    console.print(f"compare.html, compare.json and a_by_distance.ply lie in {out}", soft_wrap=True)


def _cell(name: str, figures: dict[str, Any]) -> str:
    """Return one figure with its unit."""
    value = figures.get(name)
    if value is None:
        return "unknown"
    if name == "points":
        return f"{value:,}"
    return _metres(value) if name.endswith("_m") else f"{value:.1f} %"


def _metres(value: float) -> str:
    """Return a length in metres with four digits."""
    return f"{value:.4g} m"
