"""What a run says of itself."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from rendered import QUICK, SEARCHED, still_life

from recon.files import write_json
from recon.pipeline import reconstruct
from recon.report import run_report, sanity_line, status_counts, versions
from recon.settings import load_preset
from recon.types import PixelStatus

GEOMETRY = still_life().pair.geometry


def test_the_report_holds_what_is_needed_to_make_the_result_again(tmp_path):
    (tmp_path / "quick.toml").write_text(QUICK)
    preset = load_preset(tmp_path / "quick.toml", {"filling": False})
    result = reconstruct(still_life().pair, preset, disparities=SEARCHED)

    write_json(tmp_path / "run.json", run_report(result, preset, device="cpu", seconds={"a": 1.0}))

    report = json.loads((tmp_path / "run.json").read_text())
    again = load_preset(tmp_path / "quick.toml", report["settings"])
    assert repr(again) == repr(preset)
    assert report["disparities"] == {"from": 0, "to": 27}
    assert report["points"] == len(result.cloud)
    assert report["triangles"] == len(result.mesh.faces)
    assert report["seconds"] == {"a": 1.0}
    assert report["device"] == "cpu"
    assert report["geometry"]["baseline_m"] == 0.2
    assert sum(report["pixels per status"].values()) == result.depth.size
    assert report["versions"]["torch"] == torch.__version__


def test_every_state_is_counted_also_if_there_is_none():
    status = np.array([[PixelStatus.MATCHED, PixelStatus.OCCLUDED], [PixelStatus.MATCHED] * 2])

    counts = status_counts(status)

    assert counts.pop("matched") == 3
    assert counts.pop("occluded") == 1
    assert counts == {"outside": 0, "mismatched": 0, "filled_occlusion": 0, "filled_mismatch": 0}


def test_the_sanity_line_has_the_numbers_of_the_formula():
    depth = np.full((10, 10), 2.0)
    depth[0, 0] = np.nan

    line = sanity_line(replace(GEOMETRY, baseline_m=0.1), depth, 0.5)

    assert "f 160.0 px, baseline 0.1000 m, disparity at infinity 0.00 px" in line
    assert "depth 2.00 to 2.00 m" in line
    assert "sigma_z there 125.0 mm (0.5 px)" in line  # 2^2 / (160 * 0.1) * 0.5


@pytest.mark.filterwarnings("error")
def test_the_sanity_line_of_nothing_says_so():
    assert sanity_line(GEOMETRY, np.full((3, 3), np.nan), 0.5).endswith("; no depth")


def test_a_package_that_is_missing_is_named(monkeypatch):
    monkeypatch.setattr("recon.report.PACKAGES", ("no-such-package",))

    assert versions()["no-such-package"] == "not installed"
