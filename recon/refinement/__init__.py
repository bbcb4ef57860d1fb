"""Stage four: smooth surfaces and sharp edges."""

from recon.refinement.domain_transform import DomainTransform
from recon.refinement.median import Median, WeightedMedian
from recon.refinement.protocol import Refinement

__all__ = ["REFINEMENTS", "DomainTransform", "Median", "Refinement", "WeightedMedian"]

REFINEMENTS: dict[str, type[Refinement]] = {
    "domain_transform": DomainTransform,
    "median": Median,
    "weighted_median": WeightedMedian,
}
