"""The distance of two learned descriptions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from recon.kernels.shifts import cosine_distances
from recon.matching_cost.census import Census
from recon.matching_cost.protocol import ALL_ROWS
from recon.networks import FeatureNetwork, load_features
from recon.precision import Precision, check_precision, in_precision
from recon.types import CostVolume

__all__ = ["LearnedCost"]

CENSUS = Census(5, 5)
CENSUS_UNIT = 1.7
"""With it, pixels that have nothing to do with each other cost about as much in the census (0.48)
as by their vectors (0.80), means over all candidates of one pair of photographs."""


@lru_cache(maxsize=4)
def _network(weights: str, device: torch.device, share: float | None) -> FeatureNetwork:
    """Load a network once for every device."""
    return load_features(weights, device, direct_share=share)


@dataclass(frozen=True)
class LearnedCost:
    """C(x, d) = 1 - <f_L(x), f_R(x - d)>, in [0, 2], with f the vectors of a network.

    With a census beside it, it is (1 - s) C + 1.7 s H, s the share and H the share of neighbours
    that are darker than the middle in one view only: a vote of each neighbour where the vectors
    weigh steps by their size, so the two err in different places.

    Source: Zbontar & LeCun, Stereo Matching by Training a Convolutional Neural Network to Compare
    Image Patches, JMLR 17 2016, section 3.1 (the fast architecture).

    Attributes:
        weights: the name of weights that ship, or the path of a file.
        direct_share: share of the vector's squared length that its 24 steps to the neighbours, a
            soft census transform, have beside what is learned; that of the training if not given.
            Noise and blur of generated pairs teach a network to trust faint texture less than
            photographs deserve; a larger share gives it back, a smaller one bears more noise.
        census_share: s, the share of the cost that a census transform of 5 x 5 pixels has
            beside the vectors; 0 leaves it out.
        precision: of the convolutions, see `in_precision`; they were trained in bfloat16.
    """

    weights: str = "fast"
    direct_share: float | None = None
    census_share: float = 0.0
    precision: Precision = "auto"

    def __post_init__(self) -> None:
        check_precision(self.precision)
        if self.direct_share is not None and not 0 <= self.direct_share < 1:
            raise ValueError(f"direct_share must be in [0, 1), got {self.direct_share}")
        if not 0 <= self.census_share < 1:
            raise ValueError(f"census_share must be in [0, 1), got {self.census_share}")

    @property
    def margin_px(self) -> int:
        """Rows that the network sees up and down."""
        seen = _network(self.weights, torch.device("cpu"), self.direct_share).margin_px
        return max(seen, CENSUS.margin_px) if self.census_share else seen

    @torch.inference_mode()
    def __call__(
        self, left: Tensor, right: Tensor, disparities: range, *, rows: slice = ALL_ROWS
    ) -> CostVolume:
        """Compare the descriptions of pixels."""
        of_left, of_right = (
            self.vectors(image, rows=rows).permute(2, 0, 1) for image in (left, right)
        )
        cost = cosine_distances(of_left, of_right, disparities)
        if self.census_share:
            differing = CENSUS(left, right, disparities, rows=rows).cost
            cost.mul_(1 - self.census_share).add_(differing, alpha=CENSUS_UNIT * self.census_share)
        return CostVolume(cost, disparities)

    @torch.inference_mode()
    def vectors(self, image: Tensor, *, rows: slice = ALL_ROWS) -> Tensor:
        """Describe pixels, without the census; see `VectorCost`."""
        network = _network(self.weights, image.device, self.direct_share)
        with in_precision(self.precision, image.device):
            found: Tensor = network(image.permute(2, 0, 1)[None])[0, :, rows]
        return found.permute(1, 2, 0)
