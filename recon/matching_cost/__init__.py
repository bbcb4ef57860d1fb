"""Stage one: how badly two pixels fit."""

from recon.matching_cost.absolute_difference import AbsoluteDifference
from recon.matching_cost.ad_census import AdCensus
from recon.matching_cost.census import Census
from recon.matching_cost.learned import LearnedCost
from recon.matching_cost.ncc import NormalisedCrossCorrelation
from recon.matching_cost.protocol import MatchingCost, VectorCost
from recon.matching_cost.sad import SumOfAbsoluteDifferences
from recon.matching_cost.soft_census import SoftCensus
from recon.matching_cost.ssd import SumOfSquaredDifferences
from recon.matching_cost.zncc import ZeroMeanNormalisedCrossCorrelation

__all__ = [
    "MATCHING_COSTS",
    "AbsoluteDifference",
    "AdCensus",
    "Census",
    "LearnedCost",
    "MatchingCost",
    "NormalisedCrossCorrelation",
    "SoftCensus",
    "SumOfAbsoluteDifferences",
    "SumOfSquaredDifferences",
    "VectorCost",
    "ZeroMeanNormalisedCrossCorrelation",
]

MATCHING_COSTS: dict[str, type[MatchingCost]] = {
    "absolute_difference": AbsoluteDifference,
    "sad": SumOfAbsoluteDifferences,
    "ssd": SumOfSquaredDifferences,
    "ncc": NormalisedCrossCorrelation,
    "zncc": ZeroMeanNormalisedCrossCorrelation,
    "census": Census,
    "ad_census": AdCensus,
    "soft_census": SoftCensus,
    "cnn": LearnedCost,
}
