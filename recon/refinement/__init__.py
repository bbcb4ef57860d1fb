"""Stage four: smooth surfaces and sharp edges."""

from recon.refinement.domain_transform import DomainTransform
from recon.refinement.local_planes import LocalPlanes
from recon.refinement.median import Median, WeightedMedian
from recon.refinement.protocol import Refinement

__all__ = [
    "REFINEMENTS",
    "DomainTransform",
    "LocalPlanes",
    "Median",
    "Refinement",
    "WeightedMedian",
]

REFINEMENTS: dict[str, type[Refinement]] = {
    "domain_transform": DomainTransform,
    "local_planes": LocalPlanes,
    "median": Median,
    "weighted_median": WeightedMedian,
}
