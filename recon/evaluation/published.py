"""What others reached, as data with sources, so that a report can print ours between theirs.

Nothing here was measured by this project. Rows of two protocols cannot be compared, nor rows of
one protocol matched at different sizes, nor training with test pairs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

__all__ = ["PUBLISHED", "Published"]


@dataclass(frozen=True)
class Published:
    """One row of somebody's table.

    Attributes:
        name: of the method.
        protocol: official, zs-all, zs-noc or zs-noc192; rows of two protocols cannot be compared.
        matched_at: size at which the images were matched and scored: F, H, Q, or "" if not said.
        pairs: training or test.
        means: averages over the pairs as printed, such as {"nonocc avgerr": 5.29}.
        source: publication and table.
        scenes: region -> scene -> avgerr in full-size pixels, where the table lists scenes.
        note: what a reader must know to compare.
    """

    name: str
    protocol: str
    matched_at: str
    pairs: str
    means: Mapping[str, float]
    source: str
    scenes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    note: str = ""


HAMID = (
    "Hamid et al., A new function of stereo matching algorithm based on hybrid convolutional "
    "neural network, IJEECS 25(1) 2022, Tables 1 to 3"
)
HAMID_NOTE = (
    "truth of full size; printed there as %, but the values are average errors in full-size "
    "pixels: the mean of the 15 values of Table 1 with the official weights is 6.71"
)
THIRTEEN = (
    "Adirondack", "ArtL", "Jadeplant", "Motorcycle", "Piano", "Pipes", "Playroom", "Playtable",
    "PlaytableP", "Recycle", "Shelves", "Teddy", "Vintage",
)  # fmt: skip
"""The columns of Tables 2 and 3, which leave MotorcycleE and PianoL out."""

HAMID_TABLES = {
    "SGM": (
        (5.29, 1.85, 4.25, 14.6, 2.76, 3.61, 5.63, 4.24, 15.7, 2.67, 2.31, 7.78, 1.50, 13.9),
        (8.51, 2.46, 7.83, 32.1, 5.17, 5.12, 11.3, 6.15, 18.5, 3.59, 2.84, 8.35, 2.53, 15.5),
    ),
    "Hamid et al. (the paper)": (
        (6.71, 4.04, 8.05, 22.1, 4.43, 4.22, 8.14, 5.53, 5.02, 4.49, 2.93, 12.1, 3.16, 6.88),
        (12.5, 8.08, 13.1, 53.4, 9.00, 5.56, 16.2, 8.92, 9.50, 7.47, 5.76, 13.3, 4.79, 10.0),
    ),
    "ELAS": (
        (7.65, 5.66, 3.15, 29.1, 3.15, 4.41, 6.07, 6.37, 16.9, 2.70, 5.82, 10.7, 2.24, 16.7),
        (10.9, 6.68, 5.30, 51.2, 5.36, 4.99, 11.1, 8.97, 18.7, 3.56, 6.43, 11.1, 2.99, 17.1),
    ),
    "PSMNet_ROB": (
        (9.60, 7.32, 9.69, 44.5, 5.55, 5.01, 9.86, 7.33, 4.40, 4.43, 3.73, 11.1, 3.44, 8.07),
        (13.3, 8.83, 13.9, 68.4, 8.26, 5.89, 14.4, 9.38, 5.54, 5.52, 4.98, 11.6, 3.87, 9.66),
    ),
    "BSM": (
        (13.4, 7.27, 11.4, 30.5, 6.67, 10.8, 10.5, 12.5, 24.4, 12.8, 7.42, 16.4, 4.88, 32.8),
        (23.5, 12.7, 28.7, 58.7, 14.8, 16.0, 24.5, 29.4, 31.0, 20.2, 12.1, 19.2, 14.3, 39.3),
    ),
}
"""Average, then the 13 pairs; NON-OCC (Table 2), then ALL (Table 3)."""

HAMID_TABLE_1_ONLY = {"MotorcycleE": 4.43, "PianoL": 6.23}
"""NON-OCC of the paper's own method; ALL is not printed for these two."""

LIPSON = "Lipson, Teed & Deng, RAFT-Stereo, 3DV 2021"
LIPSON_TEST = {
    # method: avgerr, A50, bad0.5, bad1.0, bad2.0, bad4.0
    "EdgeStereo": (2.68, 0.72, 55.6, 32.4, 18.7, 10.8),
    "HSM": (2.07, 0.56, 50.7, 24.6, 10.2, 4.83),
    "LEAStereo": (1.43, 0.53, 49.5, 20.8, 7.15, 2.75),
    "MC-CNN variant": (2.63, 0.44, 40.1, 16.1, 6.35, 3.81),
    "HITNet": (1.71, 0.40, 34.2, 13.3, 6.46, 3.81),
    "CRLE": (2.25, 0.42, 38.1, 13.4, 5.75, 3.90),
    "LocalExp": (2.24, 0.43, 38.7, 13.9, 5.43, 3.69),
    "NOSS-ROB": (2.08, 0.42, 38.2, 13.2, 5.01, 3.46),
    "RAFT-Stereo (fine-tuned)": (1.27, 0.26, 27.7, 9.37, 4.74, 2.75),
}
LIPSON_ZERO_SHOT = {
    # method: all bad2.0 at F, H, Q
    "HD3": (50.3, 37.9, 20.3),
    "GwcNet": (47.1, 34.2, 18.1),
    "PSMNet": (39.5, 25.1, 14.2),
    "GANet": (32.2, 20.3, 11.2),
    "DSMNet": (21.8, 13.8, 8.1),
    "RAFT-Stereo": (18.3, 12.6, 9.4),
}
WEN = "Wen et al., FoundationStereo, CVPR 2025, supplement"
WEN_ZERO_SHOT = {
    # method: nonocc bad2.0 at F, H, Q, trained on SceneFlow
    "Selective-IGEV": (12.9, 9.2, 7.0),
    "IGEV": (13.1, 8.8, 6.4),
    "IGEV++": (12.7, 7.8, 6.3),
    "NMRF": (35.3, 10.9, 5.0),
}
TOOLBOX = "stereo_toolbox (github.com/xxxupeng/stereo_toolbox), README at 6af8685"
TOOLBOX_ZERO_SHOT = {
    # method: nonocc bad2.0 at H, d < 192
    "PSMNet": 30.2,
    "GwcNet": 20.4,
    "CFNet": 16.3,
    "ACVNet": 22.1,
    "PCWNet": 12.2,
    "RAFT-Stereo": 9.06,
    "IGEV": 7.25,
    "NerfStereo-RAFT": 6.79,
    "Selective-RAFT": 7.58,
    "Selective-IGEV": 6.73,
    "MonSter": 5.86,
    "DEFOM-Stereo S": 6.06,
    "DEFOM-Stereo L": 4.39,
    "ZeroStereo-RAFT": 4.62,
    "ZeroStereo-IGEV": 4.90,
    "StereoAnywhere": 5.39,
    "FoundationStereo S": 1.31,
    "FoundationStereo L": 1.12,
}
LIGHT = "tables of Lite Any Stereo and Lite Any Stereo 2"
LIGHT_ZERO_SHOT = {
    # method: nonocc bad2.0 at H
    "LightStereo-S": 19.6,
    "LightStereo-M": 17.7,
    "LightStereo-H": 14.3,
    "IINet": 19.6,
    "Lite Any Stereo": 13.1,
    "LAS2-S (mixed data)": 8.87,
    "LAS2-M (mixed data)": 5.47,
    "LAS2-H (mixed data)": 3.71,
}


def _of_hamid(name: str) -> Published:
    nonocc, everywhere = HAMID_TABLES[name]
    scenes = {
        "nonocc": dict(zip(THIRTEEN, nonocc[1:], strict=True)),
        "all": dict(zip(THIRTEEN, everywhere[1:], strict=True)),
    }
    if name.startswith("Hamid"):
        scenes["nonocc"] |= HAMID_TABLE_1_ONLY
    means = {"nonocc avgerr": nonocc[0], "all avgerr": everywhere[0]}
    return Published(name, "official", "", "training", means, HAMID, scenes, HAMID_NOTE)


def _of_lipson_test(name: str) -> Published:
    columns = ("avgerr", "A50", "bad0.5", "bad1.0", "bad2.0", "bad4.0")
    figures = zip(columns, LIPSON_TEST[name], strict=True)
    means = {f"nonocc {column}": figure for column, figure in figures}
    return Published(name, "official", "", "test", means, f"{LIPSON}, Table 4")


def _zero_shot(
    name: str, protocol: str, size: str, bad2: float, source: str, note: str = ""
) -> Published:
    region = "all" if protocol == "zs-all" else "nonocc"
    return Published(
        name, protocol, size, "training", {f"{region} bad2.0": bad2}, source, note=note
    )


PUBLISHED: tuple[Published, ...] = (
    *(_of_hamid(name) for name in HAMID_TABLES),
    *(_of_lipson_test(name) for name in LIPSON_TEST),
    *(
        _zero_shot(
            name,
            "zs-all",
            size,
            figure,
            f"{LIPSON}, Table 1",
            "captioned as non-occluded, but the released code counts every known pixel",
        )
        for name, figures in LIPSON_ZERO_SHOT.items()
        for size, figure in zip("FHQ", figures, strict=True)
    ),
    *(
        _zero_shot(
            name,
            "zs-noc192",
            size,
            figure,
            WEN,
            "protocol as in the code that its authors gave out",
        )
        for name, figures in WEN_ZERO_SHOT.items()
        for size, figure in zip("FHQ", figures, strict=True)
    ),
    *(
        _zero_shot(name, "zs-noc192", "H", figure, TOOLBOX)
        for name, figure in TOOLBOX_ZERO_SHOT.items()
    ),
    *(
        _zero_shot(name, "zs-noc192", "H", figure, LIGHT, "protocol as far as known")
        for name, figure in LIGHT_ZERO_SHOT.items()
    ),
)
