"""Pairs with truth as the data sets store them: one module a layout, and the table of all."""

from recon.evaluation.layouts.protocol import Layout
from recon.evaluation.layouts.tables import LAYOUTS, find_scenes, read_scene

__all__ = ["LAYOUTS", "Layout", "find_scenes", "read_scene"]
