"""Looking at a reconstruction in Rerun; nothing else in the program knows of it."""

from recon.viewer.drawing import Drawing, archetypes
from recon.viewer.observer import RerunObserver
from recon.viewer.serving import Page, open_recording, serve_recording
from recon.viewer.thinning import Limits

__all__ = [
    "Drawing",
    "Limits",
    "Page",
    "RerunObserver",
    "archetypes",
    "open_recording",
    "serve_recording",
]
