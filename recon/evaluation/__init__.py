"""How far matchers are from the truth: data sets, protocols, measures, reports."""

from recon.evaluation.layouts import LAYOUTS, find_scenes, read_scene
from recon.evaluation.methods import MapsOnDisk, MatcherOfOpenCv, MatcherOfPreset, Method
from recon.evaluation.opencv_matchers import OPENCV_MATCHERS
from recon.evaluation.protocols import PROTOCOLS
from recon.evaluation.results import write_results
from recon.evaluation.runner import SPARSE, Entry, Task, evaluate, suffixes
from recon.evaluation.scene import Scene, SceneFiles, Truth
from recon.evaluation.tables import failures, whole_result

__all__ = [
    "LAYOUTS",
    "OPENCV_MATCHERS",
    "PROTOCOLS",
    "SPARSE",
    "Entry",
    "MapsOnDisk",
    "MatcherOfOpenCv",
    "MatcherOfPreset",
    "Method",
    "Scene",
    "SceneFiles",
    "Task",
    "Truth",
    "evaluate",
    "failures",
    "find_scenes",
    "read_scene",
    "suffixes",
    "whole_result",
    "write_results",
]
