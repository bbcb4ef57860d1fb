"""Stage two: how the costs around a pixel speak for it."""

from recon.aggregation.bilateral import BilateralAggregation
from recon.aggregation.box import BoxAggregation
from recon.aggregation.none import NoAggregation
from recon.aggregation.protocol import Aggregation

__all__ = ["AGGREGATIONS", "Aggregation", "BilateralAggregation", "BoxAggregation", "NoAggregation"]

AGGREGATIONS: dict[str, type[Aggregation]] = {
    "bilateral": BilateralAggregation,
    "box": BoxAggregation,
    "none": NoAggregation,
}
