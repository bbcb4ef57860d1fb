"""Photographs and calibrations from disk, and the range a person asks for."""

import json

import cv2
import numpy as np
import pytest
from rendered import on_disk, still_life

from calib import Camera, Pose, StereoCalibration, write_calibration
from calib.formats import CalibrationRecord
from calib.pair import RectifiedPair, StereoPair
from recon.files import write_image
from recon.pairs import RangeRequest, read_pair


@pytest.fixture
def folder(tmp_path):
    return on_disk(tmp_path, still_life().pair)


def read(folder, **how):
    return read_pair(folder / "left.png", folder / "right.png", folder / "rig.json", **how)


def raw_rig(size, *, swapped=False):
    camera = Camera(size, np.array([[160.0, 0, 99.5], [0, 160, 49.5], [0, 0, 1]]), np.zeros(5))
    side = 1.0 if swapped else -1.0
    return StereoCalibration(camera, camera, Pose(np.eye(3), np.array([0.2 * side, 0, 0])))


class TestPhotographs:
    def test_what_was_written_is_read(self, folder):
        source = read(folder)

        pair = still_life().pair
        assert isinstance(source.pair, RectifiedPair)
        assert np.array_equal(source.pair.left, pair.left)
        assert np.array_equal(source.pair.right, pair.right)
        assert source.pair.geometry == pair.geometry
        assert source.disparities == range(28)
        assert source.inputs["taken as"] == "rectified"
        assert source.notes == ()

    def test_grey_and_colour_may_be_mixed(self, folder):
        grey = still_life().pair.right.mean(axis=2).round().astype(np.uint8)
        write_image(folder / "right.png", grey)

        source = read(folder)

        assert np.array_equal(source.pair.right, np.repeat(grey[..., None], 3, axis=2))

    def test_sixteen_bits_become_eight(self, folder):
        left, right = still_life().pair.left, still_life().pair.right
        for name, image in (("left", left), ("right", right)):
            deep = image[..., ::-1].astype(np.uint16) * 257
            cv2.imwrite(str(folder / f"{name}.png"), deep)

        source = read(folder)

        assert left.max() >= 64  # else it would be taken as 14 bits
        assert np.array_equal(source.pair.left, left)
        assert np.array_equal(source.pair.right, right)

    def test_one_picture_may_show_both_views(self, folder):
        pair = still_life().pair
        write_image(folder / "both.png", np.concatenate([pair.left, pair.right], axis=1))

        source = read_pair(folder / "both.png", None, folder / "rig.json")

        assert np.array_equal(source.pair.left, pair.left)
        assert np.array_equal(source.pair.right, pair.right)
        assert source.inputs["left"] == source.inputs["right"] == str(folder / "both.png")

    @pytest.mark.parametrize("name", ["left", "right"])
    def test_a_picture_of_one_colour_is_refused_by_name(self, folder, name):
        write_image(folder / f"{name}.png", np.zeros((100, 200, 3), np.uint8))

        with pytest.raises(ValueError, match=rf"{name}\.png shows one colour only .*lens covered"):
            read(folder)

    def test_a_dark_picture_with_something_on_it_is_taken(self, folder):
        for name in ("left", "right"):
            image = getattr(still_life().pair, name)
            write_image(folder / f"{name}.png", image // 16)

        assert read(folder).pair.left.max() < 16

    def test_views_of_different_sizes_are_refused(self, folder):
        write_image(folder / "right.png", still_life().pair.right[:, :-2])

        with pytest.raises(ValueError, match=r"is 200 x 100 but right image .* is 198 x 100"):
            read(folder)

    def test_a_calibration_of_another_size_is_refused(self, folder):
        for name in ("left", "right"):
            image = getattr(still_life().pair, name)
            write_image(folder / f"{name}.png", image[::2, ::2])

        with pytest.raises(ValueError, match=r"rig\.json: .* for 200 x 100 images but .* 100 x 50"):
            read(folder)

    def test_a_person_may_say_the_unit(self, folder):
        rig = raw_rig(still_life().pair.geometry.size)
        storage = f"%YAML:1.0\n---\nimageSize: [{rig.left.size[0]}, {rig.left.size[1]}]\n"
        for name, matrix in (
            *(("M1", rig.left.K), ("M2", rig.right.K), ("R", np.eye(3))),
            ("T", np.array([[-8.0], [0], [0]])),
        ):
            rows, columns = matrix.shape
            storage += (
                f"{name}: !!opencv-matrix\n  rows: {rows}\n  cols: {columns}\n  dt: d\n"
                f"  data: {matrix.ravel().tolist()}\n"
            )
        (folder / "rig.json").write_text(storage, encoding="utf-8")

        assert read(folder).pair.calibration.baseline_m == 8.0  # up to 10 it is taken as metres
        assert read(folder, unit="cm").pair.calibration.baseline_m == pytest.approx(0.08)

    def test_swapped_cameras_are_refused(self, folder):
        contents = json.loads((folder / "rig.json").read_text())
        contents["rectified"]["baseline_m"] = -0.2
        (folder / "rig.json").write_text(json.dumps(contents))

        with pytest.raises(ValueError, match=r"rig\.json.*-0\.2 m; are the .* cameras swapped"):
            read(folder)


class TestRawOrRectified:
    @pytest.fixture
    def both(self, folder):
        geometry = still_life().pair.geometry
        record = CalibrationRecord(raw_rig(geometry.size), geometry, folder / "x", "json")
        write_calibration(folder / "rig.json", record)
        return folder

    def test_raw_is_assumed_and_said_if_the_calibration_has_both(self, both):
        source = read(both)

        assert isinstance(source.pair, StereoPair)
        assert source.inputs["taken as"] == "raw"
        assert any("say --rectified" in note for note in source.notes)

    def test_a_person_may_say_which(self, both):
        rectified, raw = read(both, rectified=True), read(both, rectified=False)

        assert isinstance(rectified.pair, RectifiedPair)
        assert isinstance(raw.pair, StereoPair)
        assert rectified.notes == raw.notes == ()

    def test_what_the_calibration_lacks_is_refused(self, folder):
        with pytest.raises(ValueError, match=r"describes rectified images .* nothing to rectify; "):
            read(folder, rectified=False)
        write_calibration(folder / "rig.json", raw_rig((200, 100)))
        with pytest.raises(ValueError, match=r"describes raw images .* said to be rectified; "):
            read(folder, rectified=True)


class TestScale:
    @pytest.mark.parametrize("scale", [0.5, 0.37, 1.5])
    def test_geometry_and_range_are_resized_with_the_images(self, folder, scale):
        source = read(folder, scale=scale)

        pair, geometry = source.pair, still_life().pair.geometry
        height, width, _ = pair.left.shape
        assert (width, height) == (round(200 * scale), round(100 * scale)) == pair.geometry.size
        factor = width / 200
        assert pair.geometry.focal_px == pytest.approx(geometry.focal_px * factor)
        assert source.disparities.start == 0
        assert 27 * factor <= source.disparities[-1] < 27 * factor + 1
        assert source.inputs["scale"] == str(scale)

    def test_a_raw_pair_is_rectified_before_it_is_resized(self, folder):
        write_calibration(folder / "rig.json", raw_rig((200, 100)))

        source = read(folder, scale=0.5)

        assert isinstance(source.pair, RectifiedPair)
        assert source.pair.left.shape == (50, 100, 3)

    @pytest.mark.parametrize("scale", [0.0, -1.0, 5.0, float("nan")])
    def test_a_scale_that_cannot_be_is_refused(self, folder, scale):
        with pytest.raises(ValueError, match="scale must lie between 0 and 4, got"):
            read(folder, scale=scale)


class TestRangeRequest:
    @pytest.mark.parametrize(
        ("low", "high", "scale", "suggested", "searched"),
        [
            (None, None, 1.0, None, None),
            (None, None, 0.5, range(3, 9), range(3, 9)),
            (2, 7, 1.0, None, range(2, 8)),
            (2, 7, 1.0, range(3, 90), range(2, 8)),
            (-7, -2, 1.0, None, range(-7, -1)),
            (None, 7, 1.0, range(3, 90), range(3, 8)),
            (4, None, 1.0, range(3, 90), range(4, 90)),
            (3, 7, 0.5, None, range(1, 5)),
            (-3, 3, 0.5, None, range(-2, 3)),
            (3, None, 0.5, range(1, 20), range(1, 20)),
        ],
    )
    def test_a_person_wins_over_the_calibration(self, low, high, scale, suggested, searched):
        assert RangeRequest(low, high, scale).applied_to(suggested) == searched

    @pytest.mark.parametrize(("low", "high"), [(5, 5), (9, 2), (28, None), (None, -1)])
    def test_an_empty_range_is_refused(self, low, high):
        with pytest.raises(ValueError, match=r"range is empty: from \S+ to \S+ px.* lie above"):
            RangeRequest(low, high).applied_to(range(28))

    @pytest.mark.parametrize(("low", "high"), [(5, None), (None, 5)])
    def test_one_end_alone_is_refused_if_nothing_says_the_other(self, low, high):
        with pytest.raises(ValueError, match="--min-disparity and --max-disparity both"):
            RangeRequest(low, high).applied_to(None)

    def test_the_report_says_where_the_range_came_from(self):
        assert RangeRequest().origin(None) == "an estimate from the images"
        assert RangeRequest().origin(range(3)) == "the calibration"
        assert RangeRequest(low=0).origin(range(3)) == "the command line"
