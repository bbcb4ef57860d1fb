"""The distance of two learned descriptions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from recon.kernels.shifts import cosine_distances
from recon.matching_cost.protocol import ALL_ROWS
from recon.networks import FeatureNetwork, load_features
from recon.precision import Precision, check_precision, in_precision
from recon.types import CostVolume

__all__ = ["LearnedCost"]


@lru_cache(maxsize=4)
def _network(weights: str, device: torch.device, share: float | None) -> FeatureNetwork:
    """Load a network once for every device."""
    return load_features(weights, device, direct_share=share)


@dataclass(frozen=True)
class LearnedCost:
    """C(x, d) = 1 - <f_L(x), f_R(x - d)>, in [0, 2], with f the vectors of a network.

    Source: Zbontar & LeCun, Stereo Matching by Training a Convolutional Neural Network to Compare
    Image Patches, JMLR 17 2016, section 3.1 (the fast architecture).

    Attributes:
        weights: the name of weights that ship, or the path of a file.
        direct_share: share of the vector's squared length that its 24 steps to the neighbours, a
            soft census transform, have beside what is learned; that of the training if not given.
            Noise and blur of generated pairs teach a network to trust faint texture less than
            photographs deserve; a larger share gives it back, a smaller one bears more noise.
        precision: of the convolutions, see `in_precision`; they were trained in bfloat16.
    """

    weights: str = "fast"
    direct_share: float | None = None
    precision: Precision = "auto"

    def __post_init__(self) -> None:
        check_precision(self.precision)
        if self.direct_share is not None and not 0 <= self.direct_share < 1:
            raise ValueError(f"direct_share must be in [0, 1), got {self.direct_share}")

    @property
    def margin_px(self) -> int:
        """Rows that the network sees up and down."""
        return _network(self.weights, torch.device("cpu"), self.direct_share).margin_px

    @torch.inference_mode()
    def __call__(
        self, left: Tensor, right: Tensor, disparities: range, *, rows: slice = ALL_ROWS
    ) -> CostVolume:
        """Compare the descriptions of pixels."""
        of_left, of_right = (
            self.vectors(image, rows=rows).permute(2, 0, 1) for image in (left, right)
        )
        return CostVolume(cosine_distances(of_left, of_right, disparities), disparities)

    @torch.inference_mode()
    def vectors(self, image: Tensor, *, rows: slice = ALL_ROWS) -> Tensor:
        """Describe pixels; see `VectorCost`."""
        network = _network(self.weights, image.device, self.direct_share)
        with in_precision(self.precision, image.device):
            found: Tensor = network(image.permute(2, 0, 1)[None])[0, :, rows]
        return found.permute(1, 2, 0)
