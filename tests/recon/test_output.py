"""What a reconstruction leaves on disk: all of it, or nothing."""

import os
import stat
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rendered import QUICK, SEARCHED, still_life

from recon.files import read_cloud, read_pfm, read_ply
from recon.output import OUTPUTS, all_or_nothing, write_results
from recon.pipeline import reconstruct
from recon.settings import load_preset


@pytest.fixture
def result(tmp_path):
    (tmp_path / "quick.toml").write_text(QUICK)
    preset = load_preset(tmp_path / "quick.toml")
    (tmp_path / "quick.toml").unlink()
    return reconstruct(still_life().pair, preset, disparities=SEARCHED)


class TestAllOrNothing:
    def test_files_appear_when_the_block_ends_and_not_before(self, tmp_path):
        out = tmp_path / "a" / "b"

        with all_or_nothing(out) as folder:
            (folder / "run.json").write_text("{}")
            before = (out / "run.json").exists()

        assert not before
        assert [path.name for path in out.iterdir()] == ["run.json"]

    @pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
    def test_after_a_failure_nothing_is_there_not_even_new_parents(self, tmp_path, error):
        def fail():
            with all_or_nothing(tmp_path / "a" / "b") as folder:
                (folder / "run.json").write_text("{}")
                raise error

        with pytest.raises(error):
            fail()
        assert list(tmp_path.iterdir()) == []

    def test_after_a_failure_an_earlier_run_is_as_it_was(self, tmp_path):
        (tmp_path / "run.json").write_text("old")

        def fail():
            with all_or_nothing(tmp_path) as folder:
                (folder / "run.json").write_text("new")
                raise ValueError

        with pytest.raises(ValueError):  # noqa: PT011  raised right here
            fail()
        assert [path.name for path in tmp_path.iterdir()] == ["run.json"]
        assert (tmp_path / "run.json").read_text() == "old"

    def test_what_an_earlier_run_made_and_this_one_did_not_is_removed(self, tmp_path):
        for name in ("recording.rrd", "run.json", "notes.txt"):
            (tmp_path / name).write_text("old")

        with all_or_nothing(tmp_path) as folder:
            (folder / "run.json").write_text("new")

        assert sorted(path.name for path in tmp_path.iterdir()) == ["notes.txt", "run.json"]
        assert (tmp_path / "run.json").read_text() == "new"
        assert (tmp_path / "notes.txt").read_text() == "old"

    def test_the_folder_may_be_a_link_or_the_current_one(self, tmp_path, monkeypatch):
        (tmp_path / "real").mkdir()
        (tmp_path / "link").symlink_to(tmp_path / "real")
        monkeypatch.chdir(tmp_path / "real")

        for out in (tmp_path / "link", Path()):
            with all_or_nothing(out) as folder:
                (folder / "run.json").write_text(str(out))
            assert (tmp_path / "real" / "run.json").read_text() == str(out)

    def test_files_may_be_read_by_whom_the_umask_lets(self, tmp_path):
        before = os.umask(0o022)
        try:
            with all_or_nothing(tmp_path / "out") as folder:
                (folder / "run.json").write_text("{}")
        finally:
            os.umask(before)

        assert stat.S_IMODE((tmp_path / "out" / "run.json").stat().st_mode) == 0o644
        assert stat.S_IMODE((tmp_path / "out").stat().st_mode) == 0o755

    @pytest.mark.parametrize("below", ["", "deep", "deep/er"])
    def test_a_path_at_or_below_a_file_is_refused_before_the_block(self, tmp_path, below):
        (tmp_path / "file").write_text("mine")
        entered = []

        def run():
            with all_or_nothing(tmp_path / "file" / below):
                entered.append(True)

        with pytest.raises(ValueError, match=r"(is a file; give a folder|cannot write to .*; ch)"):
            run()
        assert not entered
        assert (tmp_path / "file").read_text() == "mine"

    def test_a_folder_without_permission_is_refused_and_its_new_parents_are_removed(
        self, tmp_path, monkeypatch
    ):
        def denied(**_):
            raise PermissionError(13, "Permission denied")

        monkeypatch.setattr(tempfile, "mkdtemp", denied)

        def run():
            with all_or_nothing(tmp_path / "a" / "b"):
                pass

        with pytest.raises(ValueError, match=r"cannot write to .*: Permission denied; choose"):
            run()
        assert list(tmp_path.iterdir()) == []

    def test_a_folder_in_the_place_of_a_result_is_refused_before_the_block(self, tmp_path):
        (tmp_path / "mesh.glb").mkdir()
        entered = []

        def run():
            with all_or_nothing(tmp_path):
                entered.append(True)

        with pytest.raises(ValueError, match=r"mesh\.glb is a folder; a file of this name"):
            run()
        assert not entered


def test_results_are_written_under_the_names_that_are_promised(tmp_path, result):
    write_results(tmp_path, result)

    made = {path.name for path in tmp_path.iterdir()}
    assert made == OUTPUTS.keys() - {"recording.rrd", "run.json"}
    values = read_pfm(tmp_path / "disparity.pfm")
    assert np.array_equal(values, result.disparity.values, equal_nan=True)
    assert np.array_equal(read_ply(tmp_path / "cloud.ply").points, result.cloud.points)


def test_the_cloud_is_written_in_the_formats_that_are_asked_for(tmp_path, result):
    write_results(tmp_path, result, clouds=["npz", "laz"])

    made = {path.name for path in tmp_path.iterdir()}
    assert made == {*OUTPUTS, "cloud.npz", "cloud.laz"} - {"recording.rrd", "run.json"}
    assert np.array_equal(read_cloud(tmp_path / "cloud.npz").points, result.cloud.points)


def test_a_cloud_that_was_not_asked_for_again_is_removed(tmp_path):
    (tmp_path / "cloud.las").write_text("of an earlier run")

    with all_or_nothing(tmp_path) as folder:
        (folder / "cloud.ply").write_text("of this one")

    assert [path.name for path in tmp_path.iterdir()] == ["cloud.ply"]


def test_what_the_filters_took_is_what_lies_between_pixels_and_points(result):
    left = int(result.disparity.valid.sum())
    for removal in result.removals:
        assert removal.of == left
        left -= removal.removed
    assert left == len(result.cloud)


def test_a_result_without_a_surface_is_refused(tmp_path, result):
    empty = replace(result, mesh=replace(result.mesh, faces=np.zeros((0, 3), np.int32)))

    with pytest.raises(ValueError, match=r"no surface was found: .* range 0 to 27 px fit it"):
        write_results(tmp_path, empty)
    assert list(tmp_path.iterdir()) == []
