"""Networks as plain modules, and their weights as checked files."""

from recon.networks.architecture import STEP_REACH_PX
from recon.networks.features import LEAST_LENGTH, Architecture, FeatureNetwork, saturated_steps
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
    "LEAST_LENGTH",
    "STEP_REACH_PX",
    "Architecture",
    "FeatureNetwork",
    "Regulariser",
    "RegulariserShape",
    "load_features",
    "load_regulariser",
    "saturated_steps",
    "save_features",
    "save_regulariser",
    "shipped_weights",
    "stored_regulariser",
]
