"""One method on one scene, and what is taken from an earlier run."""

import json
from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from rendered import on_disk, still_life

from recon.evaluation.layouts import find_scenes
from recon.evaluation.methods import MapsOnDisk
from recon.evaluation.runner import (
    SPARSE,
    Task,
    _scene_of,
    evaluate,
    evaluate_one,
    pictures_folder,
)
from recon.evaluation.scene import SceneFiles
from recon.files import read_pfm, write_pfm
from recon.types import DisparityMap, PixelStatus


@dataclass(frozen=True)
class Oracle:
    """Knows the truth, errs by a constant, and gives its left part as filled in."""

    name: str = "oracle"
    error_px: float = 0.0
    kind: str = "preset"
    measured: bool = True
    confident: bool = True

    def settings(self):
        return {"error_px": self.error_px}

    def __call__(self, scene):
        if self.error_px < 0:
            raise ValueError("no negative errors")
        if scene.truth.disparity.shape != scene.pair.left.shape[:2]:
            raise ValueError("too small for me")  # the crop on which methods are warmed up
        status = np.full(scene.truth.disparity.shape, PixelStatus.MATCHED, np.uint8)
        status[:, : status.shape[1] // 4] = PixelStatus.FILLED_MISMATCH
        values = (scene.truth.disparity + self.error_px).astype(np.float32)
        return DisparityMap(values, status, np.ones_like(values))


@pytest.fixture
def files(tmp_path):
    folder = on_disk(tmp_path / "generated" / "still_life", still_life().pair)
    truth = (still_life().disparity * 256).round().astype(np.uint16)
    cv2.imwrite(str(folder / "disparity_truth.png"), truth)
    cv2.imwrite(str(folder / "visible.png"), 255 * still_life().visible.astype(np.uint8))
    return find_scenes(tmp_path / "generated")[0]


@pytest.fixture
def task(files, tmp_path):
    return Task(Oracle(), files, ("official", "zs-all"), tmp_path / "out")


def with_method(task, method, **more):
    return Task(method, task.files, task.protocols, task.out, **more)


def test_the_truth_has_no_error_in_any_figure(task):
    (entry,) = evaluate_one(task)

    own = entry["protocols"]["own-size"]
    assert own["all"]["avgerr"] == own["nonocc"]["bad0.5"] == own["all"]["invalid"] == 0
    assert entry["protocols"]["zs-all"]["all"]["bad2.0"] == 0
    assert entry["depth"]["nonocc"]["within_1%"] == 100
    assert entry["cloud"]["accuracy_1%"] == 100
    assert sum(entry["histogram"]["counts"]) == still_life().visible.sum()
    assert entry["coverage"]["bad2.0"][-1] == 0
    assert sum(entry["reliability"]["right"]) == sum(entry["reliability"]["pixels"]) > 0
    assert entry["seconds"] > 0
    assert 100 < entry["peak_mb"] < 10_000


def test_a_constant_error_is_what_is_found(task):
    (entry,) = evaluate_one(with_method(task, Oracle(error_px=0.75)))

    nonocc = entry["protocols"]["own-size"]["nonocc"]
    assert nonocc["avgerr"] == pytest.approx(0.75, abs=1e-2)
    assert (nonocc["bad0.5"], nonocc["bad1.0"]) == (100, 0)


def test_the_sparse_row_leaves_out_what_was_filled(task):
    dense, sparse = evaluate_one(with_method(task, Oracle(), sparse=True))

    assert sparse["method"] == "oracle" + SPARSE
    assert dense["protocols"]["zs-all"]["all"]["invalid"] == 0
    assert sparse["protocols"]["zs-all"]["all"]["invalid"] == pytest.approx(25)
    assert sparse["protocols"]["zs-all"]["all"]["avgerr"] == 0
    assert np.isnan(read_pfm(sparse_folder(task) / "disparity.pfm")[:, 0]).all()


def sparse_folder(task):
    return pictures_folder(task.out, "oracle" + SPARSE, task.files.dataset, task.files.name)


def test_map_and_pictures_lie_on_disk(task):
    evaluate_one(task)

    np.testing.assert_array_equal(
        read_pfm(task.folder() / "disparity.pfm"), np.round(still_life().disparity * 256) / 256
    )
    pictures = [path.name for path in task.folder().iterdir() if path.suffix in (".png", ".jpg")]
    assert len(pictures) == 2
    of_scene = pictures_folder(task.out, None, task.files.dataset, task.files.name)
    assert len(list(of_scene.iterdir())) == 2


def test_maps_of_others_have_no_time(task, tmp_path):
    (tmp_path / "maps").mkdir()
    write_pfm(tmp_path / "maps" / "still_life.pfm", still_life().disparity)

    (entry,) = evaluate_one(with_method(task, MapsOnDisk("other", tmp_path / "maps")))

    assert entry["seconds"] is None
    assert entry["peak_mb"] is None
    assert entry["coverage"] is entry["reliability"] is None
    assert entry["protocols"]["own-size"]["all"]["avgerr"] < 0.01


def test_half_size_maps_are_enlarged(task, tmp_path):
    (tmp_path / "maps").mkdir()
    write_pfm(tmp_path / "maps" / "still_life.pfm", still_life().disparity[::2, ::2] / 2)

    (entry,) = evaluate_one(with_method(task, MapsOnDisk("other", tmp_path / "maps")))

    assert entry["protocols"]["own-size"]["nonocc"]["bad4.0"] < 10


def test_a_range_of_ones_own_replaces_that_of_the_data_set(task):
    (entry,) = evaluate_one(with_method(task, Oracle(), most_candidates=40))

    assert entry["disparities"] == [0, 39]


@pytest.mark.slow
class TestProcesses:
    def test_a_method_that_fails_is_an_entry_that_says_why(self, task):
        tasks = [with_method(task, Oracle("bad", error_px=-1)), task]

        bad, good = (entry for entries in evaluate(tasks) for entry in entries)

        assert bad["error"] == "no negative errors"
        assert "protocols" in good

    def test_resuming_runs_only_what_is_missing_failed_or_changed(self, task, monkeypatch):
        tasks = [task, with_method(task, Oracle("other"))]
        list(evaluate(tasks))
        kept = json.loads((task.folder() / "entry.json").read_text())
        kept["seconds"] = 12345.0  # to know it again
        (task.folder() / "entry.json").write_text(json.dumps(kept))
        changed = with_method(task, Oracle("other", error_px=2.0))

        again, other = (e for entries in evaluate([task, changed], resume=True) for e in entries)

        assert again["seconds"] == 12345.0
        assert "fingerprint" not in again
        assert other["protocols"]["zs-all"]["all"]["avgerr"] == pytest.approx(2, abs=1e-3)

    def test_without_resuming_everything_is_run(self, task):
        list(evaluate([task]))
        (task.folder() / "entry.json").write_text("{}")

        ((entry,),) = evaluate([task])

        assert "protocols" in entry


def test_a_changed_truth_changes_the_fingerprint(task):
    before = task.fingerprint()
    (task.files.folder / "visible.png").touch()

    assert task.fingerprint() != before


def test_files_in_folders_that_scenes_share_change_only_their_own_fingerprint(tmp_path):
    root = tmp_path / "kitti" / "2015"
    for folder in ("image_2", "disp_occ_0"):
        (root / folder).mkdir(parents=True)
        for frame in ("000002_10", "000003_10"):
            (root / folder / f"{frame}.png").write_bytes(b"1")
    (root / "calib_cam").mkdir()
    (root / "calib_cam" / "000002.txt").write_bytes(b"1")
    tasks = [
        Task(Oracle(), SceneFiles("kitti", "kitti/2015", name, root, root), (), tmp_path)
        for name in ("000002_10", "000003_10")
    ]
    for changed in ("disp_occ_0/000002_10.png", "calib_cam/000002.txt"):
        before = [task.fingerprint() for task in tasks]
        (root / changed).write_bytes(b"22")

        same = [task.fingerprint() == old for task, old in zip(tasks, before, strict=True)]

        assert same == [False, True]


def test_pictures_that_are_missing_or_of_another_truth_are_drawn_again(task):
    evaluate_one(task)
    of_scene = pictures_folder(task.out, None, task.files.dataset, task.files.name)
    drawn = {path: path.read_bytes() for path in of_scene.iterdir()}
    for path in drawn:
        path.write_bytes(b"of another scene")
    _scene_of.cache_clear()  # as a new process

    evaluate_one(task)

    assert {path: path.read_bytes() for path in of_scene.iterdir()} == drawn
