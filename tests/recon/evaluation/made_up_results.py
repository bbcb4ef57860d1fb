"""Results of an evaluation that never was, with every figure different, and a reader of pages."""

import itertools
from html.parser import HTMLParser

from recon.evaluation.metrics import MEASURES
from recon.evaluation.protocols import OFFICIAL_WEIGHTS
from recon.evaluation.report import mean_coverage, summed_histogram, summed_reliability
from recon.evaluation.tables import whole_result

REGIONS = ("nonocc", "all", "occluded")
SHARES = [25.0, 50.0, 75.0, 100.0]
ALL_PAIRS = tuple(OFFICIAL_WEIGHTS)
BAD_AND_WRONG = tuple(name for name in MEASURES if name.startswith(("bad", "wrong")))


def numbers_from(start):
    """Count on in steps that change the second decimal."""
    return (start + 0.37 * step for step in itertools.count())


def figures(numbers, regions=REGIONS):
    """Return measures of every region, pixels as a whole number."""
    return {
        region: {
            measure: 100_000 if measure == "pixels" else 0.0 if measure == "invalid" else value
            for measure, value in zip(MEASURES, numbers, strict=False)
        }
        for region in regions
    }


def an_entry(method, scene, start, *, protocols=("official@Q",), regions=REGIONS, **changes):
    """Return what a method did on a scene; all figures count up from `start`."""
    numbers = numbers_from(start)
    entry = {
        "method": method,
        "dataset": "middlebury-v3/Q",
        "scene": scene,
        "size": [400, 300],
        "disparities": [0, 63],
        "protocols": {protocol: figures(numbers, regions) for protocol in protocols},
        "depth": {
            region: {
                "median_relative": next(numbers) / 100,
                "within_1%": next(numbers),
                "within_5%": next(numbers),
            }
            for region in regions
            if region in ("nonocc", "all")
        },
        "cloud": {
            f"{side}_{measure}": next(numbers)
            for side in ("accuracy", "completeness")
            for measure in ("median_m", "1%", "5%")
        }
        | {"chamfer_%": next(numbers)},
        "coverage": {
            "share": SHARES,
            "bad2.0": [1.0, 2.0, 4.0, start],
            "avgerr": [0.1, 0.2, 0.4, start],
            "auc": 2.0,
        },
        "reliability": {
            "pixels": [10.0, *([0.0] * 8), 90.0],
            "said": [0.5, *([0.0] * 8), 85.0],
            "right": [2.0, *([0.0] * 8), 81.0],
        },
        "histogram": {"edges": [-1.0, 0.0, 1.0], "counts": [10, 40, 30, 20]},
        "seconds": start / 10,
        "peak_mb": 100.0 * start,
        "scoring_seconds": 0.04,
    }
    return entry | changes


def a_failure(method, scene, reason="scene.png is empty (0 bytes); was the copy interrupted?"):
    return {"method": method, "dataset": "middlebury-v3/Q", "scene": scene, "error": reason}


def a_run(entries, *, protocols=("official",), command="reconstruct evaluate Q", problems=()):
    """Return the whole result of some entries."""
    kinds = {entry["method"]: {"kind": "preset", "settings": {"window_px": 9}} for entry in entries}
    return whole_result(
        entries,
        kinds,
        protocols=protocols,
        versions={"stereo-recon": "1.2.3", "numpy": "9.8.7"},
        command=command,
        problems=problems,
    )


def curves_of(entries):
    """Return the curves of every method, as the report takes them."""
    done = [entry for entry in entries if "error" not in entry]
    return {
        method: {
            "coverage": mean_coverage(e["coverage"] for e in done if e["method"] == method),
            "reliability": summed_reliability(
                e["reliability"] for e in done if e["method"] == method
            ),
            "histogram": summed_histogram(e["histogram"] for e in done if e["method"] == method),
        }
        for method in dict.fromkeys(entry["method"] for entry in entries)
    }


class Page(HTMLParser):
    """What a page says, by the elements that the tests ask for.

    Attributes:
        tables: every table as rows of cells, each the text inside with single blanks.
        classes: the same with the class of every cell.
        elements: pairs of a tag and its attributes.
        text: all text outside of style.
    """

    def __init__(self, page):
        super().__init__()
        self.tables, self.classes, self.elements, self.texts = [], [], [], []
        self.inside_cell = self.inside_style = False
        self.feed(page)

    @property
    def text(self):
        return " ".join(" ".join(self.texts).split())

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))
        self.inside_style = self.inside_style or tag == "style"
        if tag == "table":
            self.tables.append([])
            self.classes.append([])
        elif tag == "tr":
            self.tables[-1].append([])
            self.classes[-1].append([])
        elif tag in ("td", "th"):
            self.inside_cell = True
            self.tables[-1][-1].append("")
            self.classes[-1][-1].append((dict(attributes).get("class") or "").split())

    def handle_endtag(self, tag):
        self.inside_cell = self.inside_cell and tag not in ("td", "th")
        self.inside_style = self.inside_style and tag != "style"

    def handle_data(self, data):
        if self.inside_style:
            return
        self.texts.append(data)
        if self.inside_cell:
            cell = f"{self.tables[-1][-1][-1]} {data}"
            self.tables[-1][-1][-1] = " ".join(cell.split())

    def row(self, start, table=0):
        """Return the cells after the first of the row whose first cell begins with `start`."""
        (found,) = [row for row in self.tables[table] if row and row[0].startswith(start)]
        return found[1:]
