"""The distance of two learned descriptions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from recon.kernels.shifts import cosine_distances
from recon.matching_cost.protocol import ALL_ROWS
from recon.networks import FeatureNetwork, load_features
from recon.types import CostVolume

__all__ = ["LearnedCost"]


@lru_cache(maxsize=4)
def _network(weights: str, device: torch.device) -> FeatureNetwork:
    """Load a network once for every device."""
    return load_features(weights, device)


@dataclass(frozen=True)
class LearnedCost:
    """C(x, d) = 1 - <f_L(x), f_R(x - d)>, in [0, 2], with f the vectors of a network.

    Vectors have length 1 at most; a shorter one leaves more to the pixels around it.

    Source: Zbontar & LeCun, Stereo Matching by Training a Convolutional Neural Network to Compare
    Image Patches, JMLR 17 2016, section 3.1 (the fast architecture).

    Attributes:
        weights: the name of weights that ship, or the path of a file.
    """

    weights: str = "fast"

    @property
    def margin_px(self) -> int:
        """Rows that the network sees up and down."""
        return _network(self.weights, torch.device("cpu")).margin_px

    @torch.inference_mode()
    def __call__(
        self, left: Tensor, right: Tensor, disparities: range, *, rows: slice = ALL_ROWS
    ) -> CostVolume:
        """Compare the descriptions of pixels."""
        network = _network(self.weights, left.device)
        of_left, of_right = (
            network(image.permute(2, 0, 1)[None])[0, :, rows] for image in (left, right)
        )
        return CostVolume(cosine_distances(of_left, of_right, disparities), disparities)
