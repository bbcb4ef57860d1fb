"""How far one reconstruction is from another, or from the truth."""

from recon.comparison.alignment import Alignment, aligned
from recon.comparison.distances import Direction, distances_to
from recon.comparison.figures import Comparison, compare, scale_hint
from recon.comparison.report import DISTANCE_OUTPUTS, write_comparison
from recon.comparison.shapes import Shape, read_shape

__all__ = [
    "DISTANCE_OUTPUTS",
    "Alignment",
    "Comparison",
    "Direction",
    "Shape",
    "aligned",
    "compare",
    "distances_to",
    "read_shape",
    "scale_hint",
    "write_comparison",
]
