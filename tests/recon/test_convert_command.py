"""`reconstruct convert`: a calibration in another format."""

import numpy as np
import pytest

from calib.boards.generated import random_rig
from calib.formats import read_calibration, write_calibration
from recon.cli import main

SIZE = (400, 300)


@pytest.fixture
def rig(tmp_path):
    write_calibration(tmp_path / "rig.json", random_rig(SIZE, seed=1))
    return tmp_path / "rig.json"


def convert(*words):
    main(["convert", *(str(word) for word in words)])


@pytest.mark.parametrize(
    ("format_name", "name"), [("kalibr", "camchain.yaml"), ("ros", "left.yaml"), (None, "rig.yml")]
)
def test_a_rig_is_the_same_in_another_format(rig, tmp_path, capsys, format_name, name):
    out = tmp_path / name

    convert(rig, "-o", out, *(() if format_name is None else ("--format", format_name)))

    ours, theirs = (read_calibration(path, image_size=SIZE).raw for path in (rig, out))
    assert np.allclose(ours.right_from_left.t, theirs.right_from_left.t)
    assert np.allclose(ours.left.K, theirs.left.K)
    assert name in capsys.readouterr().out.replace("\n", "")


def test_a_format_that_cannot_hold_it_is_refused_and_nothing_is_written(rig, tmp_path, capsys):
    with pytest.raises(SystemExit):
        convert(rig, "-o", tmp_path / "calib.txt")

    assert "rectified" in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["rig.json"]


def test_what_a_file_does_not_say_can_be_said(tmp_path):
    (tmp_path / "K.txt").write_text("500 0 200 0 500 150 0 0 1\n0.12\n", encoding="utf-8")

    convert(tmp_path / "K.txt", "-o", tmp_path / "k.json", "--image-size", 400, 300)

    assert read_calibration(tmp_path / "k.json").rectified.size == SIZE
