"""The contact sheet."""

import numpy as np

from recon.training import contact_sheet as sheets
from recon.training.contact_sheet import contact_sheet
from recon.training.pool import draw_pair


def test_the_sheet_shows_left_images_over_disparities_row_by_row():
    sheet = contact_sheet(range(5, 9), 2, (24, 16))

    assert sheet.shape == (2 * 2 * 16, 2 * 24, 3)
    assert np.array_equal(sheet[:16, 24:], draw_pair(6, (24, 16))["left"])
    assert np.array_equal(sheet[32:48, :24], draw_pair(7, (24, 16))["left"])
    below = sheet[16:32, :24].reshape(-1, 3)
    assert len(np.unique(below, axis=0)) > 10


def test_it_is_written_as_a_small_jpeg(tmp_path, monkeypatch):
    monkeypatch.setattr(sheets, "ROWS", 1)
    monkeypatch.setattr(sheets, "COLUMNS", 2)
    monkeypatch.setattr(sheets, "SIZE", (24, 16))

    sheets.main(tmp_path / "sheet.jpg")

    contents = (tmp_path / "sheet.jpg").read_bytes()
    assert contents[:2] == b"\xff\xd8"
    assert len(contents) < 30_000
