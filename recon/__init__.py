"""From a rectified pair of photographs to metric surfaces."""

from recon.pairs import read_pair
from recon.pipeline import Reconstruction, reconstruct
from recon.settings import Preset, load_preset

__all__ = ["Preset", "Reconstruction", "load_preset", "read_pair", "reconstruct"]
