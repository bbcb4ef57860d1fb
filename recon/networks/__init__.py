"""Networks as plain modules, and their weights as checked files."""

from recon.networks.features import Architecture, FeatureNetwork
from recon.networks.weights import load_features, save_features, shipped_weights

__all__ = ["Architecture", "FeatureNetwork", "load_features", "save_features", "shipped_weights"]
