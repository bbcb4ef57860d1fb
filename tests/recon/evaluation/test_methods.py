"""Maps of other programs: found by the name of the scene, read with their scale, or refused."""

import cv2
import numpy as np
import pytest

from calib.pair import RectifiedPair
from calib.rig import RectifiedGeometry
from recon.evaluation.methods import MapsOnDisk, MatcherOfOpenCv, MatcherOfPreset
from recon.evaluation.opencv_matchers import OPENCV_MATCHERS
from recon.evaluation.scene import Scene, Truth
from recon.files import write_pfm
from recon.settings import load_preset
from recon.types import PixelStatus

VALUES = np.array([[1.5, 2.25, np.nan], [0.5, 30.0, 7.0]], np.float32)


@pytest.fixture
def scene():
    image = np.zeros((2, 3, 3), np.uint8)
    geometry = RectifiedGeometry((3, 2), 3.0, (1.0, 0.5), (1.0, 0.5), 1.0)
    truth = Truth(np.ones((2, 3), np.float32), None)
    pair = RectifiedPair(image, image, geometry)
    return Scene("middlebury-v3/Q", "Teddy", pair, False, range(32), truth)


def as_png(path, values):
    stored = np.where(np.isnan(values), 0, values * 256).astype(np.uint16)
    cv2.imwrite(str(path), stored)


def as_npy(path, values):
    np.save(path, values)


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("Teddy.pfm", write_pfm),
        ("Teddy.png", as_png),
        ("Teddy.npy", as_npy),
        ("Teddy/disparity.pfm", write_pfm),
        ("Teddy/disp0ELAS.pfm", write_pfm),
        ("middlebury-v3/Q/Teddy.pfm", write_pfm),
        ("middlebury-v3/Q/Teddy/disparity.pfm", write_pfm),
    ],
)
def test_a_map_is_read_with_its_holes(scene, tmp_path, name, write):
    (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    write(tmp_path / name, VALUES)

    found = MapsOnDisk("other", tmp_path)(scene)

    np.testing.assert_array_equal(found.values, VALUES)
    np.testing.assert_array_equal(found.status == PixelStatus.MATCHED, ~np.isnan(VALUES))


def test_the_map_of_its_own_data_set_comes_first(scene, tmp_path):
    (tmp_path / scene.dataset).mkdir(parents=True)
    write_pfm(tmp_path / scene.dataset / "Teddy.pfm", VALUES)
    write_pfm(tmp_path / "Teddy.pfm", VALUES + 1)

    found = MapsOnDisk("other", tmp_path)(scene)

    assert found.values[0, 0] == VALUES[0, 0]


def test_the_truth_is_not_taken_for_a_result(scene, tmp_path):
    (tmp_path / "Teddy").mkdir()
    write_pfm(tmp_path / "Teddy" / "disp0GT.pfm", VALUES)

    with pytest.raises(FileNotFoundError, match=r"holds no map of Teddy; expected Teddy\.pfm"):
        MapsOnDisk("other", tmp_path)(scene)


def test_two_maps_of_one_scene_are_refused(scene, tmp_path):
    write_pfm(tmp_path / "Teddy.pfm", VALUES)
    as_png(tmp_path / "Teddy.png", VALUES)

    with pytest.raises(ValueError, match=r"2 maps of Teddy \(Teddy\.pfm, Teddy\.png\); keep one"):
        MapsOnDisk("other", tmp_path)(scene)


def test_eight_bits_are_refused(scene, tmp_path):
    cv2.imwrite(str(tmp_path / "Teddy.png"), np.full((2, 3), 9, np.uint8))

    with pytest.raises(ValueError, match=r"Teddy\.png is uint8 with 1 channels; disparities need"):
        MapsOnDisk("other", tmp_path)(scene)


def test_a_damaged_png_is_named(scene, tmp_path):
    (tmp_path / "Teddy.png").write_bytes(b"\x89PNG\r\n")

    with pytest.raises(ValueError, match=r"Teddy\.png cannot be read as a PNG"):
        MapsOnDisk("other", tmp_path)(scene)


def test_an_array_that_is_no_map_is_refused(scene, tmp_path):
    np.save(tmp_path / "Teddy.npy", np.zeros((2, 3, 3)))

    with pytest.raises(ValueError, match=r"is \(2, 3, 3\); expected a map"):
        MapsOnDisk("other", tmp_path)(scene)


def test_a_folder_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(ValueError, match="the disparities of other, is not a folder"):
        MapsOnDisk("other", tmp_path / "nowhere")


def test_a_changed_map_changes_the_settings(tmp_path):
    write_pfm(tmp_path / "Teddy.pfm", VALUES)
    before = MapsOnDisk("other", tmp_path).settings()
    write_pfm(tmp_path / "Teddy.pfm", VALUES[:1])

    assert MapsOnDisk("other", tmp_path).settings() != before


def test_what_matches_here_says_how():
    preset = MatcherOfPreset("census", load_preset("census")).settings()
    baseline = MatcherOfOpenCv("opencv-bm", OPENCV_MATCHERS["opencv-bm"]).settings()

    assert preset["matching_cost"]["method"] == "census"
    assert preset["device"] == "cpu"
    assert "opencv" in baseline
