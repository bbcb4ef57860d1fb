"""`reconstruct evaluate`, run as a person runs it."""

import json
import shutil

import cv2
import numpy as np
import pytest
from rendered import on_disk, still_life

from recon.cli import main
from recon.files import write_pfm


@pytest.fixture
def scenes(tmp_path):
    """A data set of one generated pair, and maps of it with and without an error of 3 px."""
    folder = on_disk(tmp_path / "generated" / "still_life", still_life().pair)
    truth = (still_life().disparity * 256).round().astype(np.uint16)
    cv2.imwrite(str(folder / "disparity_truth.png"), truth)
    cv2.imwrite(str(folder / "visible.png"), 255 * still_life().visible.astype(np.uint8))
    for name, error in (("perfect", 0.0), ("poor", 3.0)):
        (tmp_path / name).mkdir()
        write_pfm(tmp_path / name / "still_life.pfm", still_life().disparity + np.float32(error))
    return tmp_path / "generated"


def words(scenes, *more, maps=("perfect",)):
    """Return the command line that scores maps on the data set."""
    given = [f"--disparities={name}={scenes.parent / name}" for name in maps]
    return ["evaluate", str(scenes), *given, "-o", str(scenes.parent / "out"), *map(str, more)]


def message_of(arguments, capsys):
    """Run a command that must fail at once, and return its one message."""
    with pytest.raises(SystemExit) as end:
        main(arguments)

    printed = capsys.readouterr()
    assert end.value.code == 2
    assert "Traceback" not in printed.err + printed.out
    return printed.err.removeprefix("error: ").strip()


class TestMistakes:
    def test_no_data_set(self, capsys):
        assert "folder of pairs with truth" in message_of(["evaluate"], capsys)

    def test_an_unknown_preset(self, scenes, capsys):
        message = message_of(words(scenes, "--preset", "papre"), capsys)

        assert "unknown preset 'papre'; there are best, census, context, fast, paper" in message

    def test_an_unknown_baseline(self, scenes, capsys):
        message = message_of(words(scenes, "--baseline", "sgbm"), capsys)

        assert "unknown baseline 'sgbm'; there are opencv-bm, opencv-sgbm" in message

    def test_an_unknown_protocol(self, scenes, capsys):
        message = message_of(words(scenes, "--protocol", "offical"), capsys)

        assert "unknown protocol offical; there are official, zs-all" in message

    def test_an_unknown_scene(self, scenes, capsys):
        message = message_of(words(scenes, "--scenes", "Teddy"), capsys)

        assert "there is no scene Teddy; there are still_life" in message

    def test_maps_without_a_name(self, scenes, capsys):
        message = message_of(["evaluate", str(scenes), "--disparities", str(scenes)], capsys)

        assert "expected --disparities NAME=DIR" in message

    def test_maps_that_are_not_there(self, scenes, capsys):
        message = message_of(words(scenes, maps=("nowhere",)), capsys)

        assert "the disparities of nowhere, is not a folder" in message

    def test_a_variant_without_a_preset(self, scenes, capsys):
        message = message_of(words(scenes, "--variant", "no filter"), capsys)

        assert "expected --variant 'NAME=PRESET SETTING=VALUE ...'" in message

    def test_a_variant_with_an_unknown_setting(self, scenes, capsys):
        message = message_of(words(scenes, "--variant", "x=paper aggregation.radius=7"), capsys)

        assert "unknown setting 'radius' in aggregation bilateral" in message

    def test_two_rows_of_one_name(self, scenes, capsys):
        message = message_of(words(scenes, maps=("perfect", "perfect")), capsys)

        assert "two methods are named 'perfect'" in message

    def test_two_scenes_that_would_share_their_results(self, scenes, tmp_path, capsys):
        shutil.copytree(scenes, tmp_path / "elsewhere" / "generated")

        message = message_of(["evaluate", str(tmp_path / "elsewhere"), *words(scenes)[1:]], capsys)

        assert "would both be called generated/still_life" in message

    def test_a_range_without_candidates(self, scenes, capsys):
        message = message_of(words(scenes, "--max-disparity", "0"), capsys)

        assert "--max-disparity must be at least 1 px, got 0" in message

    def test_no_process_at_all(self, scenes, capsys):
        assert "--jobs must be at least 1" in message_of(words(scenes, "--jobs", "0"), capsys)

    def test_only_folders_that_hold_nothing(self, tmp_path, capsys):
        (tmp_path / "empty").mkdir()

        assert str(tmp_path / "empty") in message_of(["evaluate", str(tmp_path / "empty")], capsys)


@pytest.mark.slow
class TestRuns:
    def test_figures_table_and_report_are_written(self, scenes, capsys):
        main(words(scenes, maps=("perfect", "poor")))

        out = scenes.parent / "out"
        methods = json.loads((out / "results.json").read_text())["methods"]
        means = {
            name: method["protocol"]["own-size"]["mean"]["nonocc"]["avgerr"]
            for name, method in methods.items()
        }
        assert means["perfect"] < 0.01
        assert means["poor"] == pytest.approx(3, abs=0.01)
        assert (out / "results.csv").read_text().startswith("method,protocol,scene,region")
        assert (out / "report.html").read_text().count("still_life") > 1
        assert "own-size" in capsys.readouterr().out

    def test_files_go_where_they_are_asked_to(self, scenes):
        places = {
            kind: scenes.parent / "there" / f"result.{kind}" for kind in ("json", "html", "csv")
        }

        main(words(scenes, *(w for kind, path in places.items() for w in (f"--{kind}", path))))

        assert all(path.stat().st_size > 500 for path in places.values())
        assert not (scenes.parent / "out" / "results.json").exists()

    def test_presets_variants_and_baselines_are_rows(self, scenes):
        cheap = "matching_cost.method=census aggregation.method=none refinements=['median']"

        main(["evaluate", str(scenes), "-o", str(scenes.parent / "out"), "--preset", "census",
              "--variant", f"plain=paper {cheap}", "--baseline", "opencv-sgbm", "--sparse",
              "--set", "min_segment_px=20"])  # fmt: skip

        methods = json.loads((scenes.parent / "out" / "results.json").read_text())["methods"]
        assert list(methods) == [
            name + suffix
            for name in ("census", "plain", "opencv-sgbm")
            for suffix in ("", " (sparse)")
        ]
        assert methods["plain"]["settings"]["aggregation"] == {"method": "none"}
        assert methods["plain"]["settings"]["refinements"][0]["method"] == "median"
        assert methods["census"]["settings"]["min_segment_px"] == 20
        nonocc = methods["census"]["protocol"]["own-size"]["mean"]["nonocc"]
        assert nonocc["avgerr"] < 1.5

    def test_what_is_wrong_is_named_and_the_rest_goes_on(self, scenes, tmp_path, capsys):
        """A cut truth, a mask of another size, no truth, no map, a folder that is no data set."""
        good = scenes / "still_life"
        for name in ("cut", "masked", "blind", "unmatched"):
            shutil.copytree(good, scenes / name)
            if name != "unmatched":
                shutil.copy(
                    tmp_path / "perfect" / "still_life.pfm", tmp_path / f"perfect/{name}.pfm"
                )
        cut = (good / "disparity_truth.png").read_bytes()
        (scenes / "cut" / "disparity_truth.png").write_bytes(cut[: len(cut) // 2])
        cv2.imwrite(str(scenes / "masked" / "visible.png"), np.full((9, 9), 255, np.uint8))
        (scenes / "blind" / "disparity_truth.png").unlink()
        (tmp_path / "empty").mkdir()

        with pytest.raises(SystemExit) as end:
            main(["evaluate", str(tmp_path / "empty"), *words(scenes)[1:]])

        assert end.value.code == 1
        said = capsys.readouterr().err
        assert "cut/disparity_truth.png" in said
        assert "masked/visible.png is 9 x 9" in said
        assert "blind has no truth" in said
        assert "holds no map of unmatched" in said
        assert str(tmp_path / "empty") in said
        assert "5 of 6 failed" in said
        result = json.loads((tmp_path / "out" / "results.json").read_text())
        found = result["methods"]["perfect"]["protocol"]["own-size"]
        assert found["mean"]["all"]["avgerr"] < 0.01
        assert (found["scenes_counted"], found["scenes_failed"]) == (1, 4)
        assert len(result["problems"]) == 1

    def test_two_processes_find_what_one_finds(self, scenes):
        shutil.copytree(scenes / "still_life", scenes / "again")
        shutil.copy(scenes.parent / "poor" / "still_life.pfm", scenes.parent / "poor" / "again.pfm")
        found = []
        for jobs in (1, 2):
            main(words(scenes, "--jobs", jobs, maps=("poor",)))
            result = json.loads((scenes.parent / "out" / "results.json").read_text())
            found.append(result["methods"]["poor"]["protocol"]["own-size"]["mean"]["nonocc"])

        assert found[0] == found[1]

    def test_after_ctrl_c_it_says_how_to_go_on(self, scenes, monkeypatch, capsys):
        def stopped(*_, **__):
            raise KeyboardInterrupt

        monkeypatch.setattr("recon.evaluation.evaluate", stopped)

        with pytest.raises(SystemExit) as end:
            main(words(scenes))

        assert end.value.code == 130
        assert "--resume" in capsys.readouterr().err
