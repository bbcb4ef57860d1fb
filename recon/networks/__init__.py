"""Networks as plain modules, and their weights as checked files."""

from recon.networks.features import Architecture, FeatureNetwork
from recon.networks.regulariser import Regulariser, RegulariserShape
from recon.networks.weights import (
    load_features,
    load_regulariser,
    save_features,
    save_regulariser,
    shipped_weights,
    stored_regulariser,
)

__all__ = [
    "Architecture",
    "FeatureNetwork",
    "Regulariser",
    "RegulariserShape",
    "load_features",
    "load_regulariser",
    "save_features",
    "save_regulariser",
    "shipped_weights",
    "stored_regulariser",
]
