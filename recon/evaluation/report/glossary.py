"""Sentences that explain protocols and measures where they are printed."""

from __future__ import annotations

from collections.abc import Iterable

from recon.evaluation.protocols import PROTOCOLS

__all__ = [
    "FULL_SIZE",
    "MEASURES",
    "TRUTH_SIZES",
    "family",
    "main_measure",
    "scored_on",
    "sentence",
    "size_letter",
    "told",
]

FULL_SIZE = "F"
TRUTH_SIZES = {"H": ("half", 2), "Q": ("quarter", 4)}

MEASURES = (
    ("badT", "share of the counted pixels whose error exceeds T px; no result counts as bad"),
    ("wrongT", "the same, but only pixels with a result count as wrong"),
    ("avgerr, rms", "mean and root mean square of the errors of pixels with a result"),
    ("A50 to A99", "error that so many percent of the pixels with a result do not exceed"),
    ("invalid", "share of the counted pixels without a result"),
    ("d1", "share of the counted pixels that err by more than 3 px and 5 %, or have no result"),
    ("nonocc, all", "pixels that both cameras see; every pixel of known truth"),
    ("occluded", "pixels of known truth that the right camera does not see"),
    ("edges, textureless", "pixels near jumps in depth; pixels without change along the row"),
    ("s, s/MP, s/Gdisp", "seconds a scene, per 10⁶ pixels, per 10⁹ candidates tried"),
    ("peak MB", "most memory that the process held, of all scenes"),
    ("kept", "pixels in the order of their confidence, the surest first"),
)
"""Pairs of a measure and what it means."""


def family(label: str) -> str:
    """Return a label without the size of the truth, official for official@Q."""
    return label.partition("@")[0]


def size_letter(label: str) -> str:
    """Return the size of truth in a label, Q for official@Q; "" where it says none."""
    return label.partition("@")[2]


def scored_on(label: str, size: str) -> str:
    """Return a label with the size of the truth, which decides what a figure is worth.

    Args:
        label: of a protocol.
        size: a letter of the benchmark; anything else says nothing.
    """
    says_it_already = size_letter(label) != ""
    known = size == FULL_SIZE or size in TRUTH_SIZES
    return f"{label}, {size} truth" if known and not says_it_already else label


def main_measure(label: str) -> str:
    """Return the measure by which tables of a protocol are ranked."""
    return {"official": "avgerr", "kitti": "d1", "own-size": "avgerr"}.get(family(label), "bad2.0")


def told(label: str) -> str:
    """Say what a protocol means.

    Args:
        label: as in the results, such as official@Q.
    """
    protocol = PROTOCOLS.get(family(label))
    text = protocol.description if protocol else ""
    letter = size_letter(label)
    if letter in TRUTH_SIZES:
        name, factor = TRUTH_SIZES[letter]
        text += (
            f" Here the truth has {name} size, so errors are multiplied by {factor}: a close "
            "stand-in for the official avgerr, but bad0.5 and bad1.0 look better than with the "
            "truth of full size, which alone makes a figure official."
        )
    return text


def sentence(names: Iterable[str]) -> str:
    """Join names as in a sentence: a, b and c."""
    *first, last = list(names) or [""]
    return f"{', '.join(first)} and {last}" if first else last
