"""Procedural stereo scenes, and the network that is trained on them."""
