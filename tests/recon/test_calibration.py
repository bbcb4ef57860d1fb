"""`reconstruct calibrate`: from photographs on disk to a rig and its report."""

import json
from pathlib import Path

import numpy as np
import pytest

from calib.boards import board_named
from calib.boards.generated import (
    photograph,
    photograph_room,
    poses_for_one,
    random_poses,
    random_rig,
)
from calib.epipolar import match_views, vertical_residual
from calib.formats import read_calibration
from recon.calibration import calibrate
from recon.calibration.photographs import pair_by_name, photographs
from recon.cli import main
from recon.files import read_image, write_image

BOARD = "chessboard:7x5:30mm"
SIZE = (400, 300)


@pytest.fixture(scope="module")
def rig():
    return random_rig(SIZE, seed=3)


@pytest.fixture(scope="module")
def folder(rig, tmp_path_factory):
    """Photographs of eight views, left and right in a folder each."""
    poses = random_poses(board_named(BOARD), rig, 8, seed=1)
    return photographed(tmp_path_factory.mktemp("photographs"), rig, poses)


def photographed(place, rig, poses):
    """Write photographs of the board in all poses, and return the folder."""
    for side in ("left", "right"):
        (place / side).mkdir()
    for number, pose in enumerate(poses):
        views = (rig.left, pose), (rig.right, rig.right_from_left @ pose)
        for side, (camera, at) in zip(("left", "right"), views, strict=True):
            image = photograph(board_named(BOARD), camera, at, seed=number)
            write_image(place / side / f"{side}{number:02d}.png", image)
    return place


def run(*words):
    main([str(word) for word in words])


def refused(capsys, *words):
    with pytest.raises(SystemExit) as ended:
        run(*words)
    assert ended.value.code == 2
    return capsys.readouterr().err.replace("\n", " ")


@pytest.mark.slow
def test_photographs_become_a_rig_with_a_report(folder, rig, tmp_path, capsys):
    out = tmp_path / "rig.json"

    run("calibrate", folder / "left", folder / "right", "--board", BOARD, "-o", out)

    found = read_calibration(out).raw
    assert found.baseline_m == pytest.approx(rig.baseline_m, rel=0.01)
    assert found.left.K[0, 0] == pytest.approx(rig.left.K[0, 0], rel=0.01)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        *("rig.json", "rig_report.html", "rig_report.json", "rig_report.rrd"),
    ]
    report = json.loads((tmp_path / "rig_report.json").read_text())
    assert report["rms_px"] < 0.2
    assert len(report["views"]) == 8
    assert report["centre_of_right_m"][0] == pytest.approx(rig.baseline_m, rel=0.01)
    for at in report["depths"]:
        disparity = found.left.K[0, 0] * found.baseline_m / at["depth_m"]
        nearer = at["depth_m"] - found.left.K[0, 0] * found.baseline_m / (
            disparity + report["disparity_sigma_px"]
        )
        assert at["sigma_m"] == pytest.approx(nearer, rel=0.2)
    for camera in report["cameras"].values():
        assert 50 < camera["field_of_view_deg"][1] * 4 / 3 < camera["field_of_view_deg"][0] * 1.2
    assert 0.1 < report["board_distance_m"][0] < report["board_distance_m"][1] < 1
    page = (tmp_path / "rig_report.html").read_text()
    assert page.count("data:image/jpeg") == 17
    assert "http" not in page.replace("http://www.w3.org", "")
    said = capsys.readouterr().out
    assert f"grade {report['grade']}" in said
    assert "8 views" in said


@pytest.mark.slow
@pytest.mark.parametrize("lens", ["rational", "fisheye"])
def test_rows_agree_after_strong_distortion(lens, tmp_path):
    bent, board = random_rig(SIZE, lens, seed=2), board_named(BOARD)
    poses = random_poses(board, bent, 8, seed=1) + poses_for_one(board, bent, 4, seed=2)
    photographed(tmp_path, bent, poses)
    raw, calib, out = photograph_room(bent), tmp_path / "rig.json", tmp_path / "rectified"
    write_image(tmp_path / "a.png", raw.left)
    write_image(tmp_path / "b.png", raw.right)

    run(
        *("calibrate", tmp_path / "left", tmp_path / "right", "--board", BOARD),
        *("-o", calib, "--model", lens, "--recording", "none"),
    )
    run("rectify", tmp_path / "a.png", tmp_path / "b.png", "--calib", calib, "-o", out)

    residual = vertical_residual(
        match_views(read_image(out / "left.png"), read_image(out / "right.png"))
    )
    assert residual.count > 500
    assert residual.mean_absolute_px < 0.1
    assert residual.p95_px < 0.25


@pytest.mark.slow
def test_photographs_with_both_views_side_by_side_give_the_same_rig(folder, tmp_path):
    (tmp_path / "both").mkdir()
    for number in range(8):
        views = [
            read_image(folder / side / f"{side}{number:02d}.png") for side in ("left", "right")
        ]
        write_image(tmp_path / "both" / f"{number:02d}.png", np.concatenate(views, axis=1))

    apart = calibrate(str(folder / "left"), str(folder / "right"), BOARD)
    together = calibrate(str(tmp_path / "both"), None, BOARD)

    ours, theirs = (each.estimate.calibration for each in (apart, together))
    assert np.array_equal(ours.right_from_left.t, theirs.right_from_left.t)


@pytest.mark.slow
def test_swapped_sides_are_named_and_nothing_is_written(folder, tmp_path, capsys):
    said = refused(
        capsys,
        "calibrate",
        folder / "right",
        folder / "left",
        "--board",
        BOARD,
        "-o",
        tmp_path / "rig.json",
    )

    assert "other order" in said
    assert not list(tmp_path.iterdir())


def test_another_board_is_named_and_nothing_is_written(folder, tmp_path, capsys):
    said = refused(
        capsys,
        *("calibrate", folder / "left", folder / "right"),
        *("--board", "chessboard:8x6:30mm", "-o", tmp_path / "rig.json"),
    )

    assert "7 x 5" in said
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere/*.png", "nowhere", "--board", BOARD], "no picture matches"),
        (["{}/left", "--board", BOARD], "--side-by-side"),
        (["{}/left", "{}/right", "--board", BOARD, "--side-by-side"], "--side-by-side"),
        (["{}/left", "{}/right", "--board", "chess:9x6:25mm"], "known forms"),
        (["{}/left", "{}/left", "--board", BOARD], "both patterns match one folder"),
    ],
)
def test_mistakes_are_named(folder, tmp_path, capsys, words, message):
    words = [word.format(folder) for word in words]

    assert message in refused(capsys, "calibrate", *words, "-o", tmp_path / "rig.json")
    assert not list(tmp_path.iterdir())


def test_an_unknown_ending_is_refused_before_hours_of_work(tmp_path, capsys):
    words = ("calibrate", "no/photographs", "no/others", "--board", BOARD)

    assert "ends in" in refused(capsys, *words, "-o", tmp_path / "rig.txt2")
    assert "no folder" in refused(capsys, *words, "-o", tmp_path / "there" / "rig.json")


NAMES = {
    "numbers": (
        ["left01.png", "left02.png", "left10.png"],
        ["right01.png", "right02.png", "right10.png"],
    ),
    "letters": (["IMG_L_7.jpg", "IMG_L_8.jpg"], ["IMG_R_7.jpg", "IMG_R_8.jpg"]),
    "times": (["cam0_1630.5.png", "cam0_1631.5.png"], ["cam1_1630.5.png", "cam1_1631.5.png"]),
    "equal": (["a.png", "b.png"], ["a.png", "b.png"]),
    "only one": (["left_3.png"], ["right_3.png"]),
}


@pytest.mark.parametrize("names", NAMES.values(), ids=NAMES)
def test_names_that_differ_by_the_side_belong_together(names):
    left, right = (
        [Path(side) / name for name in each] for side, each in zip("lr", names, strict=True)
    )

    paired = pair_by_name(left, right)

    assert [(pair.left, pair.right) for pair in paired.pairs] == list(zip(left, right, strict=True))
    assert paired.alone == ()


def test_photographs_without_a_partner_are_told_apart():
    left = [Path(f"l/left{n:02d}.png") for n in (1, 2, 3, 12)]
    right = [Path(f"r/right{n:02d}.png") for n in (1, 3, 4)]

    paired = pair_by_name(left, right)

    assert [pair.left for pair in paired.pairs] == [left[0], left[2]]
    assert set(paired.alone) == {left[1], left[3], right[2]}


def test_names_that_do_not_agree_are_refused():
    with pytest.raises(ValueError, match="no names agree"):
        pair_by_name([Path("a1.png"), Path("a2.png")], [Path("b3.png"), Path("b4.png")])
    with pytest.raises(ValueError, match="same number"):
        pair_by_name([Path("1.png"), Path("1.jpg")], [Path("1.png"), Path("2.png")])


def test_a_folder_stands_for_its_pictures(tmp_path):
    for name in ("b.png", "a.JPG", "notes.txt"):
        (tmp_path / name).write_bytes(b"x")

    assert [path.name for path in photographs(str(tmp_path))] == ["a.JPG", "b.png"]
    assert [path.name for path in photographs(f"{tmp_path}/*.png")] == ["b.png"]
