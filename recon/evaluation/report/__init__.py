"""The report of an evaluation: pictures of each scene, curves, and the page that holds them."""

from recon.evaluation.report.curves import mean_coverage, summed_histogram, summed_reliability
from recon.evaluation.report.page import render_page
from recon.evaluation.report.pictures import result_pictures, scene_pictures

__all__ = [
    "mean_coverage",
    "render_page",
    "result_pictures",
    "scene_pictures",
    "summed_histogram",
    "summed_reliability",
]
