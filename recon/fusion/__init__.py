"""Many depth maps of one scene, averaged to one surface."""

from recon.fusion.averaging import Fusion, Volume
from recon.fusion.surface import FusedSurface
from recon.fusion.views import KINECT_NOISE, DepthNoise, DepthView, stereo_noise

__all__ = [
    "KINECT_NOISE",
    "DepthNoise",
    "DepthView",
    "FusedSurface",
    "Fusion",
    "Volume",
    "stereo_noise",
]
