"""Pairs with truth in the layouts of the data sets: what is found, and what is read."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import written_datasets as written
from written_datasets import HEIGHT, WIDTH, mask, pictures, seen, true_disparity

from recon.evaluation.layouts import LAYOUTS, find_scenes, read_scene
from recon.evaluation.layouts.lookup import dataset_name
from recon.evaluation.layouts.truths import seen_by_both
from recon.files import read_pfm, write_image, write_pfm
from recon.sample_pairs import sample_folder


def only_scene(folder, **how):
    """Find the one scene of a folder and read it."""
    (files,) = find_scenes(folder, **how)
    return read_scene(files)


def names(scenes):
    return [f"{files.dataset}/{files.name}" for files in scenes]


def same(actual, expected):
    return np.array_equal(actual, expected, equal_nan=actual.dtype.kind == "f")


class TestMiddleburyVersion3:
    def test_a_scene_is_read_whole(self, tmp_path):
        folder = written.middlebury_v3(tmp_path / "set" / "Shed", ndisp=8)

        scene = only_scene(folder)

        left, right = pictures()
        assert (scene.dataset, scene.name, scene.benchmark) == ("set", "Shed", "")
        assert same(scene.pair.left, left)
        assert same(scene.pair.right, right)
        assert same(scene.truth.disparity, true_disparity())
        assert same(scene.truth.visible, mask() == 255)
        assert scene.disparities == range(8)
        assert scene.calibrated
        assert scene.pair.geometry.focal_px == 30
        assert scene.pair.geometry.baseline_m == 0.16
        assert scene.pair.geometry.disparity_at_infinity == -4

    @pytest.mark.parametrize(("width", "full_px"), [(1388, 1), (694, 2), (347, 4)])
    def test_a_scene_of_the_benchmark_knows_its_size_by_its_width(self, width, full_px, tmp_path):
        scene = only_scene(written.middlebury_v3(tmp_path / "ArtL", width))

        assert scene.benchmark == "middlebury-v3"
        assert scene.truth.full_px_per_px == full_px

    @pytest.mark.parametrize(
        ("name", "width", "truth"),
        [
            ("ArtL", 300, "disp0GT.pfm"),
            ("ArtL", 347, "disp0.pfm"),
            ("Art-perfect", 347, "disp0GT.pfm"),
        ],
    )
    def test_other_sizes_names_and_data_sets_are_not_the_benchmark(
        self, name, width, truth, tmp_path
    ):
        scene = only_scene(written.middlebury_v3(tmp_path / name, width, truth=truth))

        assert scene.benchmark == ""
        assert scene.truth.full_px_per_px == 1
        assert same(scene.truth.disparity, true_disparity(width))

    @pytest.mark.parametrize("isint", [0, 1])
    def test_an_integer_truth_is_told_by_the_calibration(self, isint, tmp_path):
        scene = only_scene(written.middlebury_v3(tmp_path / "Shed", isint=isint))

        assert scene.truth.integer == bool(isint)

    @pytest.mark.parametrize("truth", ["disp1GT.pfm", "disp1.pfm"])
    def test_without_a_mask_the_two_truths_tell_what_both_cameras_see(self, truth, tmp_path):
        folder = written.middlebury_v3(tmp_path / "Shed")
        (folder / "mask0nocc.png").unlink()
        write_pfm(folder / truth, true_disparity(of_right=True))

        scene = only_scene(folder)

        assert same(scene.truth.visible, seen())

    def test_with_neither_nobody_says(self, tmp_path):
        folder = written.middlebury_v3(tmp_path / "Shed")
        (folder / "mask0nocc.png").unlink()

        assert only_scene(folder).truth.visible is None

    def test_eth3d_keeps_its_truth_in_a_folder_beside(self, tmp_path):
        images = tmp_path / "ETH3D" / "two_view_training" / "forest_1s"
        written.write_pair(images / "im0.png", images / "im1.png")
        written.write_calib_txt(images, baseline=59.9696, ndisp=WIDTH)
        written.truth_of_v3(tmp_path / "ETH3D" / "two_view_training_gt" / "forest_1s")

        scene = only_scene(tmp_path)

        assert scene.dataset == "ETH3D/two_view_training"
        assert same(scene.truth.disparity, true_disparity())
        assert same(scene.truth.visible, mask() == 255)
        assert scene.pair.geometry.baseline_m == pytest.approx(0.0599696)

    def test_as_many_disparities_as_columns_bound_nothing_and_a_quarter_is_taken(self, tmp_path):
        scene = only_scene(written.middlebury_v3(tmp_path / "Shed", width=101, ndisp=101))

        assert scene.disparities == range(26)

    def test_a_mask_of_another_size_is_refused(self, tmp_path):
        folder = written.middlebury_v3(tmp_path / "Shed")
        write_image(folder / "mask0nocc.png", mask(WIDTH + 1))

        with pytest.raises(ValueError, match=r"mask0nocc\.png is 13 x 4 pixels, expected 12 x 4"):
            only_scene(folder)

    def test_a_right_truth_of_another_size_is_refused(self, tmp_path):
        folder = written.middlebury_v3(tmp_path / "Shed")
        (folder / "mask0nocc.png").unlink()
        write_pfm(folder / "disp1GT.pfm", true_disparity(WIDTH, HEIGHT + 1, of_right=True))

        with pytest.raises(ValueError, match=r"disp1GT\.pfm is 12 x 5 pixels, expected 12 x 4"):
            only_scene(folder)

    def test_a_truth_of_another_size_is_refused(self, tmp_path):
        folder = written.middlebury_v3(tmp_path / "Shed")
        write_pfm(folder / "disp0GT.pfm", true_disparity(2 * WIDTH, 2 * HEIGHT))

        with pytest.raises(ValueError, match=r"disp0GT\.pfm is 24 x 8 .*expected 12 x 4 .*resolut"):
            only_scene(folder)

    def test_a_truth_that_was_cut_off_is_refused(self, tmp_path):
        folder = written.middlebury_v3(tmp_path / "Shed")
        path = folder / "disp0GT.pfm"
        path.write_bytes(path.read_bytes()[:-1])

        with pytest.raises(ValueError, match=r"disp0GT\.pfm ends too early.*copy interrupted"):
            only_scene(folder)

    def test_a_calibration_that_is_missing_is_named(self, tmp_path):
        folder = written.middlebury_v3(tmp_path / "Shed")
        (folder / "calib.txt").unlink()

        with pytest.raises(FileNotFoundError, match=r"no calibration file .*Shed/calib\.txt"):
            only_scene(folder)


class TestMiddleburyOf2001And2003:
    @pytest.mark.parametrize(
        ("name", "width", "scale"),
        [
            ("venus", WIDTH, 8),
            ("barn1", WIDTH, 8),
            ("tsukuba", WIDTH, 16),
            ("cones", 450, 4),
            ("teddyH", 900, 2),
            ("conesF", 1800, 1),
        ],
    )
    def test_the_scale_goes_by_the_name_and_the_width(self, name, width, scale, tmp_path):
        scene = only_scene(written.middlebury_2001(tmp_path / "set" / name, width, scale=scale))

        assert same(scene.truth.disparity, true_disparity(width))
        assert scene.disparities == range(256 // scale)
        assert (scene.dataset, scene.name) == ("set", name)
        assert not scene.calibrated
        assert scene.pair.geometry.size == (width, HEIGHT)
        assert scene.benchmark == ""

    def test_the_portable_formats_are_read_too(self, tmp_path):
        folder = written.middlebury_2001(tmp_path / "bull", image="ppm", map_="pgm")

        scene = only_scene(folder)

        assert same(scene.pair.right, pictures()[1])
        assert same(scene.truth.disparity, true_disparity())

    def test_the_published_mask_comes_before_the_two_truths(self, tmp_path):
        folder = written.middlebury_2001(tmp_path / "venus")
        without = only_scene(folder)
        write_image(folder / "nonocc.png", mask())

        scene = only_scene(folder)

        assert same(without.truth.visible, seen())
        assert same(scene.truth.visible, mask() == 255)

    def test_one_truth_alone_does_not_say_what_both_cameras_see(self, tmp_path):
        folder = written.middlebury_2001(tmp_path / "venus")
        (folder / "disp6.png").unlink()

        assert only_scene(folder).truth.visible is None

    def test_a_truth_of_three_equal_channels_is_one_of_grey_levels(self, tmp_path):
        folder = written.middlebury_2001(tmp_path / "venus")
        levels = cv2.imread(str(folder / "disp2.png"), cv2.IMREAD_COLOR)
        cv2.imwrite(str(folder / "disp2.png"), levels)

        assert same(only_scene(folder).truth.disparity, true_disparity())

    def test_a_scene_of_unknown_scale_is_refused(self, tmp_path):
        folder = written.middlebury_2001(tmp_path / "saturn")

        with pytest.raises(ValueError, match=r"scene called saturn; expected barn1, .*renamed"):
            only_scene(folder)

    def test_a_scene_of_2003_of_another_width_is_refused(self, tmp_path):
        folder = written.middlebury_2001(tmp_path / "teddy", 449)

        with pytest.raises(ValueError, match=r"teddy: .* 450, 900, 1800 pixels wide, got 449"):
            only_scene(folder)

    def test_a_picture_in_colours_is_no_truth(self, tmp_path):
        folder = written.middlebury_2001(tmp_path / "venus")
        write_image(folder / "disp2.png", pictures()[0])

        with pytest.raises(ValueError, match=r"disp2\.png shows colours, expected grey levels"):
            only_scene(folder)

    def test_a_truth_of_sixteen_bits_is_refused(self, tmp_path):
        folder = written.middlebury_2001(tmp_path / "venus")
        write_image(folder / "disp2.png", np.full((HEIGHT, WIDTH), 800, np.uint16))

        with pytest.raises(ValueError, match=r"disp2\.png has 16 bits a pixel, expected 8"):
            only_scene(folder)

    def test_a_truth_that_was_cut_off_is_refused(self, tmp_path):
        folder = written.middlebury_2001(tmp_path / "venus")
        path = folder / "disp2.png"
        path.write_bytes(path.read_bytes()[:-60])

        with pytest.raises(ValueError, match=r"disp2\.png cannot be read: .*interrupted"):
            only_scene(folder)


class TestMiddleburyOf2005And2006:
    @pytest.mark.parametrize(
        ("height", "scale", "disparities"),
        [(1110, 1, range(256)), (555, 2, range(128)), (370, 3, range(86))],
    )
    def test_the_scale_goes_by_the_height(self, height, scale, disparities, tmp_path):
        folder = written.middlebury_2005(tmp_path / "set" / "Art", height=height, scale=scale)

        scene = only_scene(folder)

        assert same(scene.truth.disparity, true_disparity(height=height))
        assert same(scene.truth.visible, seen(height=height))
        assert scene.disparities == disparities
        assert not scene.calibrated

    def test_a_height_of_no_size_is_refused(self, tmp_path):
        folder = written.middlebury_2005(tmp_path / "Art", height=371)

        with pytest.raises(ValueError, match=r"Art: .* 1110, 555, 370 pixels high, got 371"):
            only_scene(folder)

    @pytest.mark.parametrize(("height", "scale"), [(1110, 1), (370, 3)])
    def test_with_dmin_depths_are_metric(self, height, scale, tmp_path):
        folder = written.middlebury_2005(tmp_path / "Art", height=height, scale=scale)
        (folder / "dmin.txt").write_text("200\n")

        scene = only_scene(folder)

        geometry = scene.pair.geometry
        assert scene.calibrated
        assert geometry.focal_px == pytest.approx(3740 / scale)
        assert geometry.baseline_m == 0.16
        assert geometry.disparity_at_infinity == pytest.approx(-200 / scale)

    def test_a_dmin_that_is_no_number_is_refused(self, tmp_path):
        folder = written.middlebury_2005(tmp_path / "Art")
        (folder / "dmin.txt").write_text("<html>")

        with pytest.raises(ValueError, match=r"dmin\.txt must hold one number .*'<html>'"):
            only_scene(folder)

    def test_the_two_truths_come_before_a_mask_which_is_not_of_the_release(self, tmp_path):
        folder = written.middlebury_2005(tmp_path / "Art")
        write_image(folder / "nonocc.png", mask(height=370))
        with_both = only_scene(folder)
        (folder / "disp5.png").unlink()

        with_mask_alone = only_scene(folder)

        assert same(with_both.truth.visible, seen(height=370))
        assert same(with_mask_alone.truth.visible, mask(height=370) == 255)


class TestKitti:
    def test_frames_of_2015_are_read(self, tmp_path):
        folder = written.kitti(tmp_path / "KITTI" / "training", ("000003", "000002"))
        written.kitti_calibration(folder / "calib_cam_to_cam" / "000002.txt")

        found = find_scenes(folder)

        with_calibration, without = map(read_scene, found)
        assert names(found) == ["KITTI/training/000002_10", "KITTI/training/000003_10"]
        assert same(with_calibration.pair.left, pictures()[0])
        assert same(with_calibration.truth.disparity, true_disparity())
        assert same(with_calibration.truth.visible, seen() & np.isfinite(true_disparity()))
        assert with_calibration.disparities == range(192)
        assert with_calibration.benchmark == without.benchmark == "kitti"
        assert with_calibration.calibrated
        assert not without.calibrated
        assert with_calibration.pair.geometry.baseline_m == pytest.approx(0.53)

    @pytest.mark.parametrize("folder", ["calib_cam_to_cam", "calib_cam", "calib"])
    def test_the_calibration_may_lie_in_any_of_three_folders(self, folder, tmp_path):
        written.kitti(tmp_path)
        written.kitti_calibration(tmp_path / folder / "000002.txt")

        assert only_scene(tmp_path).calibrated

    @pytest.mark.parametrize(
        ("left", "right", "baseline_m"),
        [("colored_0", "colored_1", 0.53), ("image_0", "image_1", 0.54)],
    )
    def test_frames_of_2012_have_the_baseline_of_their_cameras(
        self, left, right, baseline_m, tmp_path
    ):
        written.kitti(tmp_path, left=left, right=right, ending="")
        written.kitti_calibration(tmp_path / "calib" / "000002.txt")

        scene = only_scene(tmp_path)

        assert same(scene.truth.disparity, true_disparity())
        assert scene.pair.geometry.baseline_m == pytest.approx(baseline_m)

    def test_only_the_frames_that_may_have_truth_are_found(self, tmp_path):
        folder = written.kitti(tmp_path / "2015")
        written.write_pair(
            folder / "image_2" / "000002_11.png", folder / "image_3" / "000002_11.png"
        )

        assert [files.name for files in find_scenes(folder)] == ["000002_10"]

    def test_without_the_second_truth_nobody_says_what_both_cameras_see(self, tmp_path):
        written.kitti(tmp_path)
        (tmp_path / "disp_noc_0" / "000002_10.png").unlink()

        assert only_scene(tmp_path).truth.visible is None

    def test_a_frame_without_truth_is_found_and_refused_when_it_is_read(self, tmp_path):
        written.kitti(tmp_path, ("000002", "000003"))
        (tmp_path / "disp_occ_0" / "000003_10.png").unlink()

        with_truth, without = find_scenes(tmp_path)

        assert read_scene(with_truth).name == "000002_10"
        with pytest.raises(
            FileNotFoundError, match=r"000003_10\.png has no truth: expected .*disp_occ_0"
        ):
            read_scene(without)

    def test_frames_without_any_truth_are_one_error(self, tmp_path):
        written.write_pair(tmp_path / "image_2" / "000001_10.png", tmp_path / "image_3" / "_.png")

        with pytest.raises(ValueError, match=r"1 frames but no truth: expected .*disp_occ_0"):
            find_scenes(tmp_path)

    def test_the_testing_frames_do_not_stand_in_the_way_of_the_others(self, tmp_path):
        written.kitti(tmp_path / "training")
        testing = tmp_path / "testing"
        written.write_pair(testing / "image_2" / "000001_10.png", testing / "image_3" / "_.png")

        assert [files.name for files in find_scenes(tmp_path)] == ["000002_10"]

    def test_a_truth_of_eight_bits_is_refused(self, tmp_path):
        written.kitti(tmp_path)
        write_image(tmp_path / "disp_occ_0" / "000002_10.png", np.ones((HEIGHT, WIDTH), np.uint8))

        with pytest.raises(ValueError, match=r"000002_10\.png has 8 bits a pixel, expected 16"):
            only_scene(tmp_path)


class TestSceneFlow:
    @pytest.mark.parametrize("sign", [1.0, -1.0])
    def test_the_sign_of_the_release_does_not_matter(self, sign, tmp_path):
        scene = only_scene(written.sceneflow(tmp_path / "set" / "pair", sign=sign))

        assert same(scene.truth.disparity, true_disparity())
        assert scene.truth.visible is None
        assert scene.disparities == range(192)
        assert not scene.calibrated
        assert (scene.dataset, scene.name, scene.benchmark) == ("set", "pair", "")

    def test_the_picture_of_occlusions_comes_before_the_two_truths(self, tmp_path):
        folder = written.sceneflow(tmp_path / "pair")
        write_pfm(folder / "disp_right.pfm", -true_disparity(of_right=True))
        from_truths = only_scene(folder)
        write_image(folder / "occ_left.png", np.where(mask() == 255, 0, 255).astype(np.uint8))

        from_picture = only_scene(folder)

        assert same(from_truths.truth.visible, seen())
        assert same(from_picture.truth.visible, mask() == 255)

    @pytest.mark.parametrize("start", ["", "frames_cleanpass", "frames_cleanpass/TRAIN/B"])
    def test_the_published_tree_is_read_from_any_folder_in_it(self, start, tmp_path):
        root = written.sceneflow_tree(
            tmp_path / "Things", ["TRAIN/B/0001", "TRAIN/B/0000"], frames="frames_cleanpass"
        )

        found = find_scenes(root / start)

        scene = read_scene(found[0])
        assert names(found) == [
            "Things/frames_cleanpass/TRAIN-B-0000-0006",
            "Things/frames_cleanpass/TRAIN-B-0001-0006",
        ]
        assert same(scene.pair.right, pictures()[1])
        assert same(scene.truth.disparity, true_disparity())
        assert same(scene.truth.visible, seen())
        assert scene.disparities == range(192)

    def test_both_passes_are_found_under_two_names(self, tmp_path):
        written.sceneflow_tree(tmp_path / "Monkaa", ["a_rain"])
        written.sceneflow_tree(tmp_path / "Monkaa", ["a_rain"], frames="frames_cleanpass")

        assert names(find_scenes(tmp_path)) == [
            "Monkaa/frames_cleanpass/a_rain-0006",
            "Monkaa/frames_finalpass/a_rain-0006",
        ]

    def test_a_tree_without_disparities_is_one_error(self, tmp_path):
        frames = tmp_path / "frames_finalpass" / "funny"
        written.write_pair(frames / "left" / "0001.png", frames / "right" / "0001.png")

        with pytest.raises(ValueError, match=r"1 pairs but no truth: expected .*/disparity;"):
            find_scenes(tmp_path)


class TestGeneratedPairs:
    def test_a_sample_pair_is_read_whole(self, tmp_path):
        scene = only_scene(written.generated(tmp_path / "data" / "hall"))

        assert (scene.dataset, scene.name) == ("data", "hall")
        assert same(scene.truth.disparity, true_disparity())
        assert same(scene.truth.visible, seen())
        assert scene.disparities == range(9)
        assert scene.calibrated
        assert scene.pair.geometry.baseline_m == 0.14

    def test_the_sample_pairs_of_the_project_are_found(self):
        found = find_scenes(sample_folder())

        scene = read_scene(found[0])
        assert [files.name for files in found] == ["reading_corner", "workshop"]
        assert scene.truth.visible is not None
        assert 0.7 < scene.truth.visible.mean() < 1
        assert np.nanmax(scene.truth.disparity) < scene.disparities.stop

    def test_a_raw_calibration_is_refused(self, tmp_path):
        folder = written.generated(tmp_path / "hall")
        written.raw_calibration(folder / "rig.json")

        with pytest.raises(ValueError, match=r"rig\.json describes raw images"):
            only_scene(folder)

    def test_a_pool_for_training_is_a_folder_of_scenes(self, tmp_path):
        folder = written.pool(tmp_path / "pool", (7, 2))
        (folder / "pair_000009.part.npz").write_bytes(b"")

        found = find_scenes(folder)

        scene = read_scene(found[0])
        assert names(found) == ["pool/pair_000002", "pool/pair_000007"]
        assert same(scene.pair.left, pictures()[0])
        assert same(scene.truth.disparity, true_disparity())
        assert same(scene.truth.visible, seen())
        assert scene.disparities == range(4)  # 0.3 of 12 columns, rounded up
        assert not scene.calibrated

    def test_a_pair_of_a_pool_that_lacks_something_is_refused(self, tmp_path):
        folder = written.pool(tmp_path / "pool", visible=None)

        with pytest.raises(ValueError, match=r"pair_000001\.npz has no visible; expected left"):
            only_scene(folder)

    def test_a_pair_of_a_pool_that_was_cut_off_is_refused(self, tmp_path):
        path = written.pool(tmp_path / "pool") / "pair_000001.npz"
        path.write_bytes(path.read_bytes()[:500])

        with pytest.raises(ValueError, match=r"pair_000001\.npz cannot be read: .*in full"):
            only_scene(tmp_path)

    def test_a_pair_of_a_pool_with_a_truth_of_another_size_is_refused(self, tmp_path):
        written.pool(tmp_path / "pool", disparity=true_disparity(WIDTH, HEIGHT + 1))

        with pytest.raises(ValueError, match=r"pair_000001\.npz is 12 x 5 pixels, expected 12 x 4"):
            only_scene(tmp_path)


def scene_without_truth(folder):
    written.middlebury_v3(folder / "v3")
    written.middlebury_2001(folder / "venus")
    written.middlebury_2005(folder / "view")
    written.sceneflow(folder / "flow")
    written.generated(folder / "made")
    for path in folder.rglob("*"):
        if path.name.startswith(("disp0", "disp1", "disp2", "disp_left", "disparity_truth")):
            path.unlink()


class TestFinding:
    def test_every_layout_is_called_by_its_key(self):
        assert all(layout.name == key for key, layout in LAYOUTS.items())

    def test_all_layouts_are_found_below_one_folder_in_order(self, tmp_path):
        written.middlebury_v3(tmp_path / "MiddEval3" / "trainingQ" / "Shed")
        written.middlebury_v3(tmp_path / "MiddEval3" / "trainingQ" / "Barn")
        written.middlebury_2001(tmp_path / "2001" / "venus")
        written.middlebury_2005(tmp_path / "middlebury-2005" / "Art")
        written.kitti(tmp_path / "kitti" / "2015")
        written.sceneflow(tmp_path / "other" / "pair")
        written.sceneflow_tree(tmp_path / "SceneFlow" / "Things")
        written.generated(tmp_path / "data" / "hall")
        written.pool(tmp_path / "pools" / "first")

        found = find_scenes(tmp_path)

        assert {files.layout for files in found} == set(LAYOUTS)
        assert names(found) == [
            "MiddEval3/trainingQ/Barn",
            "MiddEval3/trainingQ/Shed",
            "Things/frames_finalpass/TRAIN-A-0000-0006",
            "data/hall",
            "first/pair_000001",
            "kitti/2015/000002_10",
            "middlebury-2005/Art",
            "other/pair",
            f"{tmp_path.name}/2001/venus",
        ]

    @pytest.mark.parametrize("name", ["v3", "venus", "view", "flow", "made"])
    def test_a_scene_without_truth_is_found_and_refused_when_it_is_read(self, name, tmp_path):
        scene_without_truth(tmp_path)

        found = {files.name: files for files in find_scenes(tmp_path)}

        with pytest.raises(FileNotFoundError, match=rf"/{name} has no truth: expected disp"):
            read_scene(found[name])

    def test_the_message_names_both_spellings_of_the_truth(self, tmp_path):
        folder = written.middlebury_v3(tmp_path / "Shed")
        (folder / "disp0GT.pfm").unlink()

        with pytest.raises(FileNotFoundError, match=r"expected disp0GT\.pfm or disp0\.pfm; is it"):
            only_scene(folder)

    def test_a_scene_is_not_searched_for_others(self, tmp_path):
        folder = written.middlebury_v3(tmp_path / "Shed")
        written.middlebury_v3(folder / "ambient" / "L1")

        assert [files.name for files in find_scenes(tmp_path)] == ["Shed"]

    def test_hidden_folders_are_left_out(self, tmp_path):
        written.middlebury_v3(tmp_path / "set" / "Shed")
        written.middlebury_v3(tmp_path / ".trash" / "Barn")

        assert [files.name for files in find_scenes(tmp_path)] == ["Shed"]

    def test_a_scene_may_lie_four_folders_down_and_no_further(self, tmp_path):
        written.middlebury_v3(tmp_path / "1" / "2" / "3" / "Shed")
        written.middlebury_v3(tmp_path / "1" / "2" / "3" / "4" / "Barn")

        assert [files.name for files in find_scenes(tmp_path)] == ["Shed"]

    def test_a_relative_path_gives_the_same_names(self, tmp_path, monkeypatch):
        folder = written.middlebury_v3(tmp_path / "set" / "Shed")
        monkeypatch.chdir(folder)

        assert find_scenes(".") == find_scenes(folder)
        assert names(find_scenes(".")) == ["set/Shed"]

    def test_two_scenes_of_one_name_are_refused(self, tmp_path):
        for disc in ("one", "two"):
            written.middlebury_v3(tmp_path / disc / "set" / "Shed")

        with pytest.raises(ValueError, match=r"one/set/Shed and .*two/set/Shed would both be cal"):
            find_scenes(tmp_path)

    def test_what_is_not_recognised_is_told_with_what_was_expected(self, tmp_path):
        for number in range(9):
            (tmp_path / f"{number}.jpg").touch()

        with pytest.raises(ValueError, match=r"holds 0\.jpg, 1\.jpg, .*7\.jpg, \.\.\.") as caught:
            find_scenes(tmp_path)

        assert all(layout.looks_like in str(caught.value) for layout in LAYOUTS.values())

    def test_an_empty_folder_holds_nothing(self, tmp_path):
        with pytest.raises(ValueError, match="which holds nothing; expected folders of"):
            find_scenes(tmp_path)

    def test_a_folder_that_is_not_there_is_named(self, tmp_path):
        with pytest.raises(ValueError, match=r"there is no folder .*nowhere"):
            find_scenes(tmp_path / "nowhere")

    def test_a_file_is_not_a_folder(self, tmp_path):
        (tmp_path / "im0.png").touch()

        with pytest.raises(ValueError, match=r"im0\.png is a file; give the folder of a scene"):
            find_scenes(tmp_path / "im0.png")

    @pytest.mark.parametrize(
        ("folder", "name"),
        [
            ("/d/middlebury-v3/Q", "middlebury-v3/Q"),
            ("/d/MiddEval3/trainingQ", "MiddEval3/trainingQ"),
            ("/d/middlebury-2005", "middlebury-2005"),
            ("/d/kitti/2015", "kitti/2015"),
            ("/d/KITTI_2012/training", "KITTI_2012/training"),
            ("/d/2006/ThirdSize", "2006/ThirdSize"),
            ("/d/data", "data"),
            ("/Q", "Q"),
        ],
    )
    def test_a_data_set_is_called_by_its_folder_and_the_one_above_if_need_be(self, folder, name):
        assert dataset_name(Path(folder)) == name


class TestTruthOfAnotherRoot:
    @pytest.mark.parametrize("start", ["", "trainingQ", "trainingQ/Teddy"])
    def test_full_size_truth_is_found_from_any_folder(self, start, tmp_path):
        written.middlebury_v3(tmp_path / "trainingQ" / "Teddy", 450)
        written.truth_of_v3(tmp_path / "elsewhere" / "trainingF" / "Teddy", 1800, 4 * HEIGHT)

        scenes = find_scenes(tmp_path / start, truth=tmp_path / "elsewhere" / "trainingF")

        scene = next(read_scene(files) for files in scenes if files.name == "Teddy")
        assert scene.pair.geometry.size == (450, HEIGHT)
        assert scene.disparities == range(8)
        assert scene.dataset.endswith("/trainingQ")
        assert same(scene.truth.disparity, true_disparity(1800, 4 * HEIGHT))
        assert same(scene.truth.visible, mask(1800, 4 * HEIGHT) == 255)
        assert scene.truth.full_px_per_px == 1
        assert scene.benchmark == "middlebury-v3"
        assert scene.truth.integer  # Teddy is, at full size, and there is no calib.txt to say so

    def test_the_same_place_comes_before_the_same_name(self, tmp_path):
        written.middlebury_v3(tmp_path / "images" / "a" / "Shed")
        written.truth_of_v3(tmp_path / "truth" / "a" / "Shed")
        written.truth_of_v3(tmp_path / "truth" / "Shed")

        (files,) = find_scenes(tmp_path / "images", truth=tmp_path / "truth")

        assert files.truth_folder == tmp_path / "truth" / "a" / "Shed"

    def test_one_scene_may_be_given_with_the_folder_of_its_truth(self, tmp_path):
        folder = written.middlebury_v3(tmp_path / "Q" / "Shed")
        truth = written.truth_of_v3(tmp_path / "H" / "Shed", 2 * WIDTH, 2 * HEIGHT)

        scene = only_scene(folder, truth=truth)

        assert scene.truth.disparity.shape == (2 * HEIGHT, 2 * WIDTH)

    @pytest.mark.parametrize(
        "size", [(3 * WIDTH, 3 * HEIGHT), (WIDTH // 2, HEIGHT // 2), (2 * WIDTH + 1, 2 * HEIGHT)]
    )
    def test_a_truth_that_is_not_one_two_or_four_times_as_large_is_refused(self, size, tmp_path):
        folder = written.middlebury_v3(tmp_path / "Q" / "Shed")
        written.truth_of_v3(tmp_path / "F" / "Shed", *size, disparity=np.ones(size[::-1]))

        with pytest.raises(ValueError, match="expected 12 x 4 or 24 x 8 or 48 x 16"):
            only_scene(folder, truth=tmp_path / "F")

    def test_a_scene_that_the_root_lacks_is_refused_when_it_is_read(self, tmp_path):
        for name in ("Shed", "Barn"):
            written.middlebury_v3(tmp_path / "Q" / name)
        written.truth_of_v3(tmp_path / "F" / "Shed")

        barn, shed = find_scenes(tmp_path / "Q", truth=tmp_path / "F")

        assert read_scene(shed).name == "Shed"
        with pytest.raises(FileNotFoundError, match=r"F/Barn has no truth"):
            read_scene(barn)

    def test_a_root_of_other_scenes_is_refused(self, tmp_path):
        written.middlebury_v3(tmp_path / "Q" / "Shed")
        written.truth_of_v3(tmp_path / "F" / "Barn")

        with pytest.raises(ValueError, match=r"F has no folder .* such as Shed; it holds Barn"):
            find_scenes(tmp_path / "Q", truth=tmp_path / "F")

    def test_a_root_that_is_not_there_is_named(self, tmp_path):
        written.middlebury_v3(tmp_path / "Q" / "Shed")

        with pytest.raises(ValueError, match=r"there is no folder .*/F"):
            find_scenes(tmp_path / "Q", truth=tmp_path / "F")

    def test_frames_that_share_a_folder_have_no_truth_elsewhere(self, tmp_path):
        written.kitti(tmp_path / "kitti")

        with pytest.raises(ValueError, match=r"kitti/000002_10 has no folder of its own"):
            find_scenes(tmp_path, truth=tmp_path)


class TestWhatBothCamerasSee:
    def test_a_pixel_must_agree_with_the_one_it_leads_to(self):
        visible = seen_by_both(true_disparity(), true_disparity(of_right=True))

        assert same(visible, seen())

    def test_one_pixel_of_difference_is_agreement_also_in_thirds(self):
        left = np.full((1, 9), 7 / 3, np.float32)

        agreed = seen_by_both(left, np.full_like(left, 10 / 3))
        beyond = seen_by_both(left, np.full_like(left, 11 / 3))

        assert same(agreed, np.array([[False] * 2 + [True] * 7]))
        assert not beyond.any()

    def test_an_unknown_disparity_of_either_view_confirms_nothing(self):
        left, right = np.ones((1, 6), np.float32), np.ones((1, 6), np.float32)
        left[0, 3] = right[0, 4] = np.nan

        visible = seen_by_both(left, right)

        assert same(visible, np.array([[False, True, True, False, True, False]]))

    def test_negative_disparities_may_lead_beyond_the_right_border(self):
        left = np.full((1, 4), -2.0, np.float32)

        assert same(seen_by_both(left, left), np.array([[True, True, False, False]]))


COUNTS = {
    "middlebury-v3/Q": 15,
    "middlebury-2001": 7,
    "middlebury-2003": 2,
    "middlebury-2005": 4,
    "middlebury-2006": 13,
    "kitti": 2,
    "other/sceneflow": 2,
}


def difference_of_warped(scene, shift_px):
    """Return the mean absolute difference of the left image and the right one moved onto it."""
    disparity = scene.truth.disparity
    rows, columns = np.indices(disparity.shape)
    known = np.isfinite(disparity) & (scene.truth.visible is None or scene.truth.visible)
    partner = columns - np.where(known, disparity, 0)
    compared = known & (partner >= 6) & (partner < disparity.shape[1] - 6)
    moved = np.rint(partner - shift_px).astype(int).clip(0, disparity.shape[1] - 1)
    warped = scene.pair.right[rows, moved].astype(np.int16)
    return np.abs(warped - scene.pair.left)[compared].mean()


@pytest.mark.parametrize("name", COUNTS)
def test_the_real_scenes_are_counted(name, datasets):
    found = find_scenes(datasets / name)

    assert len(found) == COUNTS[name]


@pytest.mark.slow
@pytest.mark.parametrize("name", COUNTS)
def test_the_truth_of_real_scenes_moves_the_right_image_onto_the_left(name, datasets):
    for files in find_scenes(datasets / name):
        scene = read_scene(files)

        difference = difference_of_warped(scene, 0)

        assert difference < difference_of_warped(scene, 6), files
        assert difference < difference_of_warped(scene, -6), files


def test_real_quarter_size_scenes_belong_to_the_benchmark(datasets):
    scenes = [read_scene(files) for files in find_scenes(datasets / "middlebury-v3" / "Q")]

    assert {scene.benchmark for scene in scenes} == {"middlebury-v3"}
    assert {scene.truth.full_px_per_px for scene in scenes} == {4}
    assert all(np.nanmax(scene.truth.disparity) < scene.disparities.stop for scene in scenes)


def test_the_two_truths_of_motorcycle_give_its_published_mask(datasets):
    folder = datasets / "middlebury-v3" / "Q" / "Motorcycle"

    visible = seen_by_both(read_pfm(folder / "disp0GT.pfm"), read_pfm(folder / "disp1GT.pfm"))

    assert same(visible, cv2.imread(str(folder / "mask0nocc.png"), cv2.IMREAD_GRAYSCALE) == 255)
