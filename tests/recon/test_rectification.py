"""Pairs whose rows do not agree are noticed, said and mended."""

import json

import cv2
import numpy as np
import pytest
from rendered import QUICK, on_disk, still_life
from turned import as_raw, warped, with_right_turned, workshop

from calib import RectifiedPair, Rectifier, write_calibration
from recon.cli import main
from recon.files import read_image, write_image
from recon.output import OUTPUTS, RECTIFIED_OUTPUTS
from recon.pairs import read_pair
from recon.pipeline import reconstruct
from recon.rectification import check_rectification, in_words, rectify_and_check
from recon.settings import load_preset

RANGE = range(48)


def shifted_down(pair, rows):
    right = warped(pair.right, np.array([[1, 0, 0], [0, 1, rows], [0, 0, 1.0]]))
    return RectifiedPair(pair.left, right, pair.geometry)


def swapped(pair):
    return RectifiedPair(pair.right, pair.left, pair.geometry)


class TestCheck:
    def test_of_a_good_pair_there_is_only_the_figure(self):
        check = check_rectification(workshop())

        assert check.note.startswith("rows differ by 0.0")
        assert check.warnings == ()
        assert check.error is None

    def test_a_drift_is_warned_of_with_its_size_cause_and_advice(self):
        check = check_rectification(shifted_down(workshop(), 1.3))

        (warning,) = check.warnings
        assert "disagree by 1.3" in warning
        assert "median -1.3" in warning
        assert "as after a camera was knocked" in warning
        assert "calibrate again, or try --refine-rectification" in warning
        assert check.error is None

    def test_half_a_pixel_is_where_it_begins(self):
        assert not check_rectification(shifted_down(workshop(), 0.4)).warnings
        assert check_rectification(shifted_down(workshop(), 0.6)).warnings

    def test_a_roll_has_another_cause(self):
        check = check_rectification(with_right_turned(workshop(), 0, 0, 0.012))

        assert "differently in different places" in check.warnings[0]

    @pytest.mark.parametrize("rows", [2.3, -30])
    def test_too_much_of_it_is_an_error_that_says_how_much(self, rows):
        check = check_rectification(shifted_down(workshop(), rows))

        assert f"median {-rows:+.1f}" in check.error
        assert "Beyond 2.0 px matching along rows is meaningless" in check.error
        assert check.warnings == ()

    def test_large_pictures_bear_more(self):
        pair = shifted_down(workshop(), 1.0).resized((1440, 1080))

        check = check_rectification(pair)

        assert check.error is None
        assert "disagree by 4.0" in check.warnings[0]

    def test_swapped_views_are_an_error(self):
        check = check_rectification(swapped(workshop()))

        assert "matches lie behind infinity (x_left - x_right below 0.0 px)" in check.error
        assert "left and right are swapped or both mirrored: exchange them" in check.error

    def test_infinity_that_is_elsewhere_is_heeded(self):
        pair = workshop().resized((180, 135))
        geometry = pair.geometry
        left, right = pair.left[:, 20:], pair.right[:, :-20]
        moved = RectifiedPair(
            left.copy(),
            right.copy(),
            type(geometry)(
                (160, 135),
                geometry.focal_px,
                (geometry.centre_left[0] - 20, geometry.centre_left[1]),
                geometry.centre_right,
                geometry.baseline_m,
            ),
        )

        check = check_rectification(moved)

        assert check.residual.reliable
        assert check.error is None
        assert check.warnings == ()

    def test_one_mirrored_view_is_said(self):
        mirrored = np.ascontiguousarray(workshop().right[:, ::-1])

        check = check_rectification(RectifiedPair(workshop().left, mirrored, workshop().geometry))

        assert check.note.startswith("whether the rows agree is unknown: only ")
        assert check.warnings == (
            "the views match if one of them is mirrored: flip that picture left to right",
        )

    def test_where_nothing_matches_nothing_is_claimed(self):
        noise = np.random.default_rng(0).integers(0, 256, workshop().left.shape, dtype=np.uint8)

        check = check_rectification(RectifiedPair(workshop().left, noise, workshop().geometry))

        assert "is unknown: only" in check.note
        assert check.warnings == ()
        assert check.error is None

    def test_a_view_upside_down_is_said(self):
        turned = np.ascontiguousarray(workshop().right[::-1, ::-1])

        check = check_rectification(RectifiedPair(workshop().left, turned, workshop().geometry))

        assert "is one of the pictures upside down" in check.error


class TestRefining:
    def test_a_rectified_pair_is_warped(self):
        checked = rectify_and_check(with_right_turned(workshop(), 0.015, 0, -0.01), refine=True)

        assert checked.check.residual.mean_absolute_px < 0.25
        assert checked.check.warnings == ()
        assert checked.calibration is None
        words = in_words(checked.correction)
        assert "right camera was turned by -0.8" in words
        assert "px before; the yaw" in words

    def test_a_raw_pair_gets_another_calibration(self):
        pair = as_raw(workshop(), turn=(0.015, 0, -0.01), common=(0.02, 0.01, 0))

        as_stated, checked = (rectify_and_check(pair, refine=refine) for refine in (False, True))

        assert as_stated.check.residual.mean_absolute_px > 3
        assert as_stated.calibration is pair.calibration
        assert checked.check.residual.mean_absolute_px < 0.25
        assert checked.calibration is not pair.calibration
        again = Rectifier(checked.calibration).geometry
        assert checked.pair.geometry == again

    def test_a_good_pair_stays_exactly_as_it_is_and_that_is_said(self):
        checked = rectify_and_check(workshop(), refine=True)

        assert checked.pair is workshop()
        assert in_words(checked.correction).startswith("the rectification was left as it is")

    def test_what_cannot_be_mended_is_not_advised_to_be_refined_again(self):
        rows, columns = np.indices(workshop().right.shape[:2]).astype(np.float32)
        bent = cv2.remap(
            workshop().right, columns, rows + 1.5 * np.sin(columns / 15), cv2.INTER_LINEAR
        )

        checked = rectify_and_check(
            RectifiedPair(workshop().left, bent, workshop().geometry), refine=True
        )

        assert "calibrate again" in checked.check.warnings[0]
        assert "--refine" not in checked.check.warnings[0]


@pytest.fixture
def folder(tmp_path):
    on_disk(tmp_path / "in", shifted_down(workshop(), 5), disparities=RANGE)
    return tmp_path / "in"


def words(command, folder, out, *more):
    return [
        *(command, str(folder / "left.png"), str(folder / "right.png")),
        *("--calib", str(folder / "rig.json"), "-o", str(out), *more),
    ]


def pair_words(folder, out, *more):
    quick = ("--preset", str(folder / "quick.toml"), "--recording", "none", "--device", "cpu")
    return words("pair", folder, out, *quick, *more)


def message_of(arguments, capsys):
    with pytest.raises(SystemExit) as end:
        main(arguments)

    printed = capsys.readouterr()
    assert end.value.code == 2
    assert "Traceback" not in printed.err + printed.out
    return printed.err.removeprefix("error: ").strip()


class TestPairCommand:
    def test_meaningless_rows_end_it_with_what_to_do(self, folder, tmp_path, capsys):
        message = message_of(pair_words(folder, tmp_path / "out"), capsys)

        assert message.startswith("the rows of the views disagree by 5.0")
        assert message.endswith("; --ignore-rectification goes on regardless")
        assert [path.name for path in tmp_path.iterdir()] == ["in"]

    def test_they_can_be_ignored_and_are_on_record(self, folder, tmp_path, capsys):
        main(pair_words(folder, tmp_path / "out", "--ignore-rectification"))

        assert capsys.readouterr().err.startswith("warning: the rows of the views disagree by 5.0")
        report = json.loads((tmp_path / "out" / "run.json").read_text())["rectification"]
        assert report["vertical residual"]["median_px"] == pytest.approx(-5, abs=0.1)
        assert "disagree by 5.0" in report["error that was ignored"]
        assert report["refinement"] is None

    def test_they_can_be_mended_and_that_is_said(self, folder, tmp_path, capsys):
        main(pair_words(folder, tmp_path / "out", "--refine-rectification"))

        printed = capsys.readouterr()
        assert printed.err == ""
        assert "the right camera was turned by" in printed.out
        report = json.loads((tmp_path / "out" / "run.json").read_text())["rectification"]
        assert report["vertical residual"]["mean_absolute_px"] < 0.25
        assert report["refinement"]["radians and pixels"]["before_px"] == pytest.approx(5, abs=0.1)

    def test_a_good_pair_has_the_figure_in_its_report(self, tmp_path, capsys):
        on_disk(tmp_path / "in", workshop(), disparities=RANGE)

        main(pair_words(tmp_path / "in", tmp_path / "out"))

        printed = capsys.readouterr()
        report = json.loads((tmp_path / "out" / "run.json").read_text())
        assert report["rectification"]["note"] in printed.out
        assert report["rectification"]["vertical residual"]["count"] > 300
        assert report["units"] == "metres"
        assert "rectification" in report["seconds"]
        assert printed.err == ""


@pytest.fixture
def raw_folder(tmp_path):
    pair = as_raw(workshop(), turn=(0.02, -0.02, 0.01), believed=(0.02, -0.02, 0.01))
    folder = tmp_path / "in"
    folder.mkdir()
    write_image(folder / "left.png", pair.left)
    write_image(folder / "right.png", pair.right)
    write_calibration(folder / "rig.json", pair.calibration)
    (folder / "quick.toml").write_text(QUICK)
    return folder


class TestRectifyCommand:
    @pytest.mark.parametrize(
        ("options", "settings"),
        [
            ((), {}),
            (("--alpha", "0.4", "--no-common-centre"), {"alpha": 0.4, "common_centre": False}),
            (("--alpha", "keep", "--scale", "0.8"), {"alpha": None, "scale": 0.8}),
            (("--size", "300", "250"), {"size": (300, 250)}),
        ],
    )
    def test_what_it_writes_is_what_the_rectifier_makes(
        self, raw_folder, tmp_path, options, settings
    ):
        out = tmp_path / "out"
        raw = read_pair(*(raw_folder / name for name in RECTIFIED_OUTPUTS)).pair

        main(words("rectify", raw_folder, out, *options))

        source = read_pair(*(out / name for name in RECTIFIED_OUTPUTS))
        expected = Rectifier(raw.calibration, **settings)(raw)
        assert source.inputs["taken as"] == "rectified"
        assert source.pair.geometry == expected.geometry
        assert np.array_equal(source.pair.left, expected.left)
        assert np.array_equal(source.pair.right, expected.right)

    def test_what_it_writes_reconstructs_to_the_same_cloud(self, raw_folder, tmp_path):
        out = tmp_path / "out"

        main(words("rectify", raw_folder, out, "--scale", "0.5", "--no-common-centre"))

        raw = read_pair(*(raw_folder / name for name in RECTIFIED_OUTPUTS)).pair
        preset = load_preset(raw_folder / "quick.toml")
        once, again = (
            reconstruct(pair, preset, disparities=RANGE).cloud
            for pair in (
                Rectifier(raw.calibration, scale=0.5, common_centre=False)(raw),
                read_pair(*(out / name for name in RECTIFIED_OUTPUTS)).pair,
            )
        )
        assert len(once) > 10_000
        assert np.array_equal(once.points, again.points)
        assert np.array_equal(once.colours, again.colours)

    def test_it_says_what_was_gained_and_what_is_seen(self, raw_folder, tmp_path, capsys):
        main(words("rectify", raw_folder, tmp_path / "out", "--alpha", "1"))

        printed = capsys.readouterr()
        assert printed.err == ""
        before, after = (
            float(line.split("rows differ by ")[1].split(" px")[0])
            for line in printed.out.splitlines()
            if "rows differ by" in line
        )
        assert before > 3
        assert after < 0.25
        assert "degrees on 360 x 270 px, focal length" in printed.out
        assert "100% of the left view" not in printed.out

    def test_it_can_be_refined(self, raw_folder, tmp_path, capsys):
        drifted = as_raw(workshop(), turn=(0.01, 0, 0))
        write_image(raw_folder / "right.png", drifted.right)
        write_calibration(raw_folder / "rig.json", drifted.calibration)

        main(words("rectify", raw_folder, tmp_path / "out", "--refine-rectification"))

        out = tmp_path / "out"
        pair = read_pair(*(out / name for name in RECTIFIED_OUTPUTS)).pair
        assert check_rectification(pair).residual.mean_absolute_px < 0.25
        assert "right camera was turned by -0.57" in capsys.readouterr().out

    def test_files_beside_its_own_are_left_alone(self, raw_folder, tmp_path):
        out = tmp_path / "out"
        out.mkdir()
        for name in ("run.json", "left.png"):
            (out / name).write_text("old")

        main(words("rectify", raw_folder, out))

        assert {path.name for path in out.iterdir()} == {*RECTIFIED_OUTPUTS, "run.json"}
        assert (out / "run.json").read_text() == "old"
        assert read_image(out / "left.png").shape == (270, 360, 3)
        assert not set(RECTIFIED_OUTPUTS) & OUTPUTS.keys()

    def test_what_it_reads_is_not_overwritten(self, raw_folder, capsys):
        before = (raw_folder / "left.png").read_bytes()

        message = message_of(words("rectify", raw_folder, raw_folder), capsys)

        assert message.endswith("left.png would be overwritten; choose another folder with -o")
        assert (raw_folder / "left.png").read_bytes() == before

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            (("--alpha", "2"), "alpha must be None or from 0 to 1, got 2"),
            (("--scale", "2", "--size", "9", "9"), "give size or scale, not both: got (9, 9) and"),
        ],
    )
    def test_settings_that_cannot_be_are_said(self, raw_folder, tmp_path, capsys, options, message):
        said = message_of(words("rectify", raw_folder, tmp_path / "out", *options), capsys)

        assert message in said
        assert [path.name for path in tmp_path.iterdir()] == ["in"]

    def test_a_pair_that_is_rectified_already_is_refused(self, tmp_path, capsys):
        folder = on_disk(tmp_path / "in", still_life().pair)

        message = message_of(words("rectify", folder, tmp_path / "out"), capsys)

        assert "describes rectified images of this size only" in message
