"""Pairs without a calibration: shapes up to scale, and said so."""

import json

import numpy as np
import pytest
from PIL import Image as Pictures
from rendered import QUICK
from turned import as_raw, workshop

from recon.cli import main
from recon.files import write_image
from recon.files.exif import focal_length_35mm
from recon.pairs import read_uncalibrated_pair


@pytest.fixture
def folder(tmp_path):
    pair = as_raw(workshop(), turn=(0.02, 0.01, -0.02))
    place = tmp_path / "in"
    place.mkdir()
    write_image(place / "left.png", pair.left)
    write_image(place / "right.png", pair.right)
    (place / "quick.toml").write_text(QUICK)
    return place


def with_lens(path, image, millimetres):
    """Write a JPEG with the note that a camera makes."""
    picture = Pictures.fromarray(image)
    exif = picture.getexif()
    exif.get_ifd(0x8769)[0xA405] = millimetres
    picture.save(path, exif=exif, quality=95)


def words(folder, out, *more):
    return [
        *("pair", str(folder / "left.png"), str(folder / "right.png"), "-o", str(out)),
        *("--preset", str(folder / "quick.toml"), "--recording", "none", "--device", "cpu", *more),
    ]


def message_of(arguments, capsys):
    with pytest.raises(SystemExit) as end:
        main(arguments)

    printed = capsys.readouterr()
    assert end.value.code == 2
    assert "Traceback" not in printed.err + printed.out
    return printed.err.removeprefix("error: ").strip()


def test_the_result_says_loudly_that_it_is_not_metric(folder, tmp_path, capsys):
    main(words(folder, tmp_path / "out", "--uncalibrated"))

    printed = capsys.readouterr()
    report = json.loads((tmp_path / "out" / "run.json").read_text())
    assert printed.err.count("warning: NOT METRIC: all lengths are in baselines") == 2
    assert report["units"].startswith("NOT METRIC")
    assert report["metric sanity"].startswith("NOT METRIC: f ")
    assert " baselines (1 to 99 %)" in report["metric sanity"]
    assert " m;" not in report["metric sanity"]
    assert report["inputs"]["calibration"].startswith("none: estimated from ")
    assert "px, from the matches" in report["inputs"]["focal length"]  # the truth is 380
    assert report["geometry"]["baseline_m"] == pytest.approx(1)
    assert report["rectification"]["vertical residual"]["mean_absolute_px"] < 0.3


def test_the_note_of_the_lens_is_used(folder):
    pair = as_raw(workshop())
    for name in ("left", "right"):
        with_lens(folder / f"{name}.jpg", getattr(pair, name), 36)

    source = read_uncalibrated_pair(folder / "left.jpg", folder / "right.jpg")

    expected = 36 * np.hypot(360, 270) / np.hypot(36, 24)
    assert source.pair.calibration.left.K[0, 0] == pytest.approx(expected)
    assert "from the EXIF note of a 36.0 mm lens" in source.inputs["focal length"]
    assert not source.metric


def test_a_focal_length_that_nothing_tells_is_called_a_guess(folder):
    write_image(folder / "left.png", workshop().left)
    write_image(folder / "right.png", workshop().right)

    source = read_uncalibrated_pair(folder / "left.png", folder / "right.png")

    assert "364 px, a guess, a 35 mm lens" in source.inputs["focal length"]
    assert "depth is stretched against width" in source.notes[0]


def test_a_scale_is_heeded(folder):
    source = read_uncalibrated_pair(folder / "left.png", folder / "right.png", scale=0.5)

    assert source.pair.left.shape == (135, 180, 3)


@pytest.mark.parametrize("noted", [0, None])
def test_a_lens_that_was_not_noted_is_none(tmp_path, noted):
    path = tmp_path / "a.jpg"
    if noted is None:
        write_image(path, workshop().left)
    else:
        with_lens(path, workshop().left, noted)

    assert focal_length_35mm(path) is None


def test_a_file_that_holds_no_note_is_none(tmp_path):
    (tmp_path / "a.jpg").write_bytes(b"\xff\xd8\xff damaged")

    assert focal_length_35mm(tmp_path / "a.jpg") is None
    assert focal_length_35mm(tmp_path / "gone.jpg") is None


@pytest.mark.parametrize(
    "other", [("--calib", "rig.json"), ("--raw",), ("--rectified",), ("--unit", "mm")]
)
def test_what_contradicts_it_is_refused(folder, tmp_path, capsys, other):
    message = message_of(words(folder, tmp_path / "out", "--uncalibrated", *other), capsys)

    assert message == "--uncalibrated goes without --calib, --rectified, --raw and --unit"


def test_no_calibration_at_all_asks_for_one_or_the_other(folder, tmp_path, capsys):
    message = message_of(words(folder, tmp_path / "out"), capsys)

    assert message.startswith("give the calibration with --calib, or say --uncalibrated")
    assert message.endswith("not in metres")


def test_pictures_that_tell_nothing_end_with_the_reason(folder, tmp_path, capsys):
    noise = np.random.default_rng(1).integers(0, 256, (270, 360, 3), dtype=np.uint8)
    write_image(folder / "right.png", noise)

    message = message_of(words(folder, tmp_path / "out", "--uncalibrated"), capsys)

    assert message.startswith("cannot estimate the cameras: only ")
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


def test_a_focal_length_that_is_known_is_taken(folder):
    pictures = folder / "left.png", folder / "right.png"

    source = read_uncalibrated_pair(*pictures, focal_px=380, scale=0.5)

    assert source.inputs["focal length"] == "380 px, as given"


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        (["--uncalibrated", "--focal-px", "35"], "35 px does not fit pictures 360 px wide"),
        (["--calib", "rig.json", "--focal-px", "380"], "--focal-px is for --uncalibrated"),
    ],
)
def test_a_focal_length_that_cannot_be_is_refused(folder, tmp_path, capsys, more, reason):
    assert reason in message_of(words(folder, tmp_path / "out", *more), capsys)
