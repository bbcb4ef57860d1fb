"""Looking at a reconstruction in Rerun; nothing else in the program knows of it."""

from recon.viewer.drawing import Drawing, Limits, archetypes
from recon.viewer.observer import RerunObserver, open_recording

__all__ = ["Drawing", "Limits", "RerunObserver", "archetypes", "open_recording"]
