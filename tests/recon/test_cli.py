"""The command, run as a person runs it: every mistake has its message and leaves nothing."""

import json
import re
import signal
import socket
import subprocess
import sys
import tempfile
import urllib.request
from pathlib import Path

import cv2
import numpy as np
import pytest
from rendered import on_disk, still_life

import recon.cli.pair as cli_pair
from recon import choice
from recon.cli import main
from recon.files import read_image, read_pfm, write_image
from recon.output import OUTPUTS
from recon.viewer import RerunObserver

FILES_ALWAYS = OUTPUTS.keys() - {"recording.rrd"}


@pytest.fixture
def folder(tmp_path):
    return on_disk(tmp_path / "in", still_life().pair)


@pytest.fixture
def out(tmp_path):
    return tmp_path / "results" / "one"


def words(folder, out, *more, left="left.png", right="right.png", calib="rig.json"):
    """Return the command line for the pair of a folder, with quick settings and no recording."""
    pictures = [str(folder / name) for name in (left, right) if name]
    return [
        *("pair", *pictures, "--calib", str(folder / calib), "-o", str(out)),
        *("--preset", str(folder / "quick.toml"), "--recording", "none", "--device", "cpu", *more),
    ]


def message_of(arguments, capsys):
    """Run a command that must fail, and return its one message."""
    with pytest.raises(SystemExit) as end:
        main(arguments)

    printed = capsys.readouterr()
    assert end.value.code == 2
    assert "Traceback" not in printed.err + printed.out
    assert printed.err.startswith("error: ")
    assert printed.err.count("error:") == 1
    return printed.err.removeprefix("error: ").strip()


def nothing_left(tmp_path):
    return sorted(path.name for path in tmp_path.iterdir()) == ["in"]


class TestMistakes:
    @pytest.mark.parametrize("name", ["left", "right", "calib"])
    def test_a_missing_file_is_named(self, folder, out, capsys, tmp_path, name):
        message = message_of(words(folder, out, **{name: "gone.png"}), capsys)

        assert message.startswith("there is no ")
        assert "gone.png" in message
        assert nothing_left(tmp_path)

    def test_what_is_not_an_image_is_named(self, folder, out, capsys, tmp_path):
        message = message_of(words(folder, out, left="rig.json"), capsys)

        assert "rig.json is not an image: it begins with" in message
        assert nothing_left(tmp_path)

    def test_what_is_not_a_calibration_is_named(self, folder, out, capsys, tmp_path):
        message = message_of(words(folder, out, calib="quick.toml"), capsys)

        assert "quick.toml: unknown calibration format" in message
        assert nothing_left(tmp_path)

    def test_views_of_different_sizes(self, folder, out, capsys, tmp_path):
        write_image(folder / "right.png", still_life().pair.right[:, :-2])

        message = message_of(words(folder, out), capsys)

        assert "is 200 x 100 but right image" in message
        assert nothing_left(tmp_path)

    def test_a_calibration_of_another_size(self, folder, out, capsys, tmp_path):
        for name in ("left", "right"):
            write_image(folder / f"{name}.png", getattr(still_life().pair, name)[::2, ::2])

        message = message_of(words(folder, out), capsys)

        assert "the calibration is for 200 x 100 images but the images are 100 x 50" in message
        assert nothing_left(tmp_path)

    def test_swapped_cameras(self, folder, out, capsys, tmp_path):
        rig = json.loads((folder / "rig.json").read_text())
        rig["rectified"]["baseline_m"] *= -1
        (folder / "rig.json").write_text(json.dumps(rig))

        message = message_of(words(folder, out), capsys)

        assert message.endswith("got -0.2 m; are the left and right cameras swapped?")
        assert nothing_left(tmp_path)

    @pytest.mark.parametrize(("low", "high"), [(5, 5), (9, 2)])
    def test_an_empty_range(self, folder, out, capsys, tmp_path, low, high):
        limits = ("--min-disparity", str(low), "--max-disparity", str(high))

        message = message_of(words(folder, out, *limits), capsys)

        assert message.startswith(f"disparity range is empty: from {low} to {high} px")
        assert nothing_left(tmp_path)

    @pytest.mark.parametrize(("low", "high"), [(0, 200), (-200, 10), (900, 950)])
    def test_a_range_wider_than_the_image(self, folder, out, capsys, tmp_path, low, high):
        limits = ("--min-disparity", str(low), "--max-disparity", str(high))

        message = message_of(words(folder, out, *limits), capsys)

        assert message.startswith(f"disparities {low} to {high} px do not fit images that are 200")
        assert nothing_left(tmp_path)

    def test_an_all_black_pair(self, folder, out, capsys, tmp_path):
        for name in ("left", "right"):
            write_image(folder / f"{name}.png", np.zeros((100, 200, 3), np.uint8))

        message = message_of(words(folder, out), capsys)

        assert "left.png shows one colour only" in message
        assert nothing_left(tmp_path)

    def test_a_pair_that_does_not_match(self, folder, out, capsys, tmp_path):
        ramp = np.broadcast_to(np.linspace(0, 255, 200).astype(np.uint8)[:, None], (100, 200, 3))
        on_disk(folder, still_life().pair, disparities=None)
        for name in ("left", "right"):
            write_image(folder / f"{name}.png", ramp)

        message = message_of(words(folder, out), capsys)

        assert message.startswith("cannot estimate the disparity range: the views hardly match")
        assert nothing_left(tmp_path)

    def test_an_unwritable_out_ends_before_anything_is_read(self, folder, capsys, monkeypatch):
        monkeypatch.setattr(cli_pair, "_read", lambda *_: pytest.fail("read before OUT was tried"))

        message = message_of(words(folder, folder / "left.png" / "out"), capsys)

        assert message.startswith("cannot write to ")
        assert message.endswith("Not a directory; choose another folder with -o")

    def test_an_out_that_is_a_file(self, folder, capsys):
        message = message_of(words(folder, folder / "rig.json"), capsys)

        assert message.endswith("rig.json is a file; give a folder to write to")
        assert json.loads((folder / "rig.json").read_text())

    def test_an_out_without_permission(self, folder, out, capsys, tmp_path, monkeypatch):
        def denied(**_):
            raise PermissionError(13, "Permission denied")

        monkeypatch.setattr(tempfile, "mkdtemp", denied)

        message = message_of(words(folder, out), capsys)

        assert message == f"cannot write to {out}: Permission denied; choose another folder with -o"
        assert nothing_left(tmp_path)

    def test_an_unknown_preset_is_named_with_those_that_there_are(self, folder, out, capsys):
        message = message_of([*words(folder, out), "--preset", "papre"], capsys)

        assert message.startswith("unknown preset 'papre'; there are ")
        assert "paper" in message

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("aggregation.radius=3", "unknown setting 'radius' in aggregation box; it has ra"),
            ("aggregration.radius_px=3", "unknown stage or setting 'aggregration'; a preset has "),
            ("matching_cost.method=[/b]", "unknown method '[/b]' for matching_cost; there are "),
            ("radius", "expected SETTING=VALUE such as aggregation.radius_px=7, got 'radius'"),
        ],
    )  # fmt: skip
    def test_an_unknown_setting_is_named_with_the_known(
        self, folder, out, capsys, tmp_path, text, message
    ):
        assert message_of(words(folder, out, "--set", text), capsys).startswith(message)
        assert nothing_left(tmp_path)

    def test_a_settings_file_that_is_missing(self, folder, out, capsys):
        message = message_of(words(folder, out, "--settings", "gone.toml"), capsys)

        assert message == "there is no settings file gone.toml"

    def test_rectified_and_raw_at_once(self, folder, out, capsys):
        message = message_of(words(folder, out, "--raw", "--rectified"), capsys)

        assert message == "say --rectified or --raw, not both"

    def test_brackets_in_file_names_are_no_markup(self, folder, out, capsys):
        message = message_of(words(folder, out, left="[red]a[/].png"), capsys)

        assert "[red]a[/].png" in message

    @pytest.mark.skipif("__import__('torch').cuda.is_available()")
    def test_a_device_that_is_not_there(self, folder, out, capsys, tmp_path):
        message = message_of(words(folder, out, "--device", "cuda"), capsys)

        assert message.startswith("--device cuda: this machine has no CUDA device")
        assert nothing_left(tmp_path)

    def test_too_little_memory_is_said_and_not_traced(self, folder, out, capsys, monkeypatch):
        def too_large(*_):
            raise RuntimeError("DefaultCPUAllocator: can't allocate memory")

        monkeypatch.setattr(cli_pair, "_read", too_large)

        assert message_of(words(folder, out), capsys).endswith("smaller range of disparities")

    def test_a_mistake_of_the_program_is_traced(self, folder, out, monkeypatch, tmp_path):
        def broken(*_):
            raise RuntimeError("sizes differ")

        monkeypatch.setattr(cli_pair, "_read", broken)

        with pytest.raises(RuntimeError, match="sizes differ"):
            main(words(folder, out))
        assert nothing_left(tmp_path)

    def test_ctrl_c_leaves_nothing(self, folder, out, capsys, monkeypatch, tmp_path):
        def stopped(*_, **__):
            raise KeyboardInterrupt

        monkeypatch.setattr("recon.output.write_results", stopped)

        with pytest.raises(SystemExit) as end:
            main(words(folder, out))
        assert end.value.code == 130
        assert capsys.readouterr().err == "stopped; nothing was written\n"
        assert nothing_left(tmp_path)

    def test_an_option_that_there_is_not_is_refused(self, folder, out, capsys):
        with pytest.raises(SystemExit) as end:
            main(words(folder, out, "--presett", "paper"))
        assert end.value.code == 2
        assert "--presett" in capsys.readouterr().err


class TestSuccess:
    def test_every_file_is_written_and_the_report_is_true(self, folder, out, capsys):
        main(words(folder, out, "--set", "aggregation.radius_px=3", "--set", "min_segment_px=5"))

        assert {path.name for path in out.iterdir()} == FILES_ALWAYS
        assert [path.name for path in out.parent.iterdir()] == [out.name]
        report = json.loads((out / "run.json").read_text())
        assert report["settings"]["aggregation"] == {"method": "box", "radius_px": 3}
        assert report["settings"]["min_segment_px"] == 5
        assert report["disparities"] == {"from": 0, "to": 27}
        assert report["disparity range from"] == "the calibration"
        assert report["inputs"]["left"] == str(folder / "left.png")
        assert {"input/files", "matching_cost", "mesh", "write"} <= report["seconds"].keys()
        printed = capsys.readouterr()
        assert report["metric sanity"] in printed.out
        assert f"results lie in {out}\n" in printed.out
        assert printed.err == ""

    def test_settings_come_from_the_file_and_then_from_the_command_line(
        self, folder, out, tmp_path
    ):
        mine = tmp_path / "in" / "mine.toml"
        mine.write_text("min_segment_px = 7\n[matching_cost]\nmethod = 'sad'\n")
        more = ("--settings", str(mine), "--set", "matching_cost.radius_px=2")

        main(words(folder, out, *more))

        settings = json.loads((out / "run.json").read_text())["settings"]
        assert settings["matching_cost"] == {"method": "sad", "radius_px": 2}
        assert settings["min_segment_px"] == 7

    def test_what_is_unlikely_to_be_right_is_left_out_when_asked(self, folder, out):
        main(words(folder, out, "--min-confidence", "0.6"))

        report = json.loads((out / "run.json").read_text())
        assert report["settings"]["triangulation"]["min_confidence"] == 0.6

    def test_the_preset_that_fits_the_machine_is_chosen_and_said(
        self, folder, out, capsys, monkeypatch
    ):
        monkeypatch.setattr(choice, "CORE_SECONDS", {"census": choice.Pace(1.0)})

        main(words(folder, out, "--preset", "auto"))

        assert "preset census, about 1 s for " in capsys.readouterr().out
        report = json.loads((out / "run.json").read_text())
        assert report["settings"]["optimisation"]["method"] == "winner_takes_all"

    def test_negative_disparities_grey_and_sixteen_bits_are_taken(self, folder, out):
        scene = still_life().shifted(20, 0)
        on_disk(folder, scene.pair, disparities=None)
        write_image(folder / "left.png", scene.pair.left.mean(axis=2).round().astype(np.uint8))
        deep = scene.pair.right[..., ::-1].astype(np.uint16) * 257
        cv2.imwrite(str(folder / "right.png"), deep)

        main(words(folder, out, "--min-disparity", "-18", "--max-disparity", "4"))

        values = read_pfm(out / "disparity.pfm")
        good = np.abs(values - scene.disparity)[scene.visible] < 1
        assert good.mean() > 0.85
        report = json.loads((out / "run.json").read_text())
        assert report["disparities"] == {"from": -18, "to": 4}
        assert report["disparity range from"] == "the command line"

    def test_a_range_that_nobody_says_is_estimated(self, folder, out):
        on_disk(folder, still_life().pair, disparities=None)

        main(words(folder, out))

        report = json.loads((out / "run.json").read_text())
        assert report["disparity range from"] == "an estimate from the images"

    def test_both_views_in_one_picture_and_half_the_size(self, folder, out, tmp_path):
        pair = still_life().pair
        write_image(folder / "both.png", np.concatenate([pair.left, pair.right], axis=1))

        main(words(folder, out, "--scale", "0.5", left="both.png", right=None))

        assert read_image(out / "status.png").shape[1] >= 100
        assert read_pfm(out / "disparity.pfm").shape == (50, 100)

    def test_what_another_run_left_is_replaced_or_removed(self, folder, out):
        out.mkdir(parents=True)
        for name in ("recording.rrd", "run.json", "holiday.txt"):
            (out / name).write_text("old")

        main(words(folder, out))

        assert {path.name for path in out.iterdir()} == FILES_ALWAYS | {"holiday.txt"}
        assert json.loads((out / "run.json").read_text())["points"] > 10_000

    def test_a_mistake_leaves_an_earlier_result_alone(self, folder, out, capsys):
        main(words(folder, out))
        before = {path.name: path.read_bytes() for path in out.iterdir()}

        message_of(words(folder, out, "--max-disparity", "500"), capsys)

        assert {path.name: path.read_bytes() for path in out.iterdir()} == before

    def test_filters_and_formats_of_the_cloud_are_asked_for_by_name(self, folder, out, capsys):
        main(words(folder, out, "--cloud-format", "npz", "--set", "cloud.voxel_m=0.1"))

        report = json.loads((out / "run.json").read_text())
        taken = report["removed from the cloud"]
        assert [one["filter"] for one in taken][-1] == "merged in voxels"
        pixels = taken[0]["of"]
        assert pixels - sum(one["removed"] for one in taken) == report["points"]
        assert report["settings"]["cloud"]["voxel_m"] == 0.1
        with np.load(out / "cloud.npz") as archive:
            assert len(archive["points"]) == report["points"]
        assert "left out of the cloud: " in (said := capsys.readouterr().out)
        assert "merged in voxels" in said

    @pytest.mark.slow
    def test_the_recording_is_one_of_the_files(self, folder, out):
        main([*words(folder, out), "--recording", "save"])

        assert {path.name for path in out.iterdir()} == OUTPUTS.keys()
        assert (out / "recording.rrd").stat().st_size > 10_000

    def test_serving_waits_when_all_is_written_and_asks_for_no_keyboard(
        self, folder, out, capsys, monkeypatch
    ):
        there = []

        class Page:
            url = "http://127.0.0.1:9090"
            from_elsewhere = "ssh"

            def wait(self):
                there.append((out / "run.json").exists())

        class Observer:
            page = Page()

            def __init__(self, **how):
                assert how["show"] == "browser"
                assert how["port"] == 9100

            def __enter__(self):
                return self

            def __exit__(self, *_):
                there.append((out / "run.json").exists())

            def __call__(self, stage, result):
                pass

        monkeypatch.setattr("recon.viewer.RerunObserver", Observer)

        main([*words(folder, out), "--recording", "serve", "--port", "9100"])

        assert there == [False, True]
        said = capsys.readouterr().out
        assert "showing at http://127.0.0.1:9090\n" in said
        assert said.index("showing at") < said.index("matching_cost") < said.index("press Ctrl-C")

    @pytest.mark.parametrize(
        ("more", "said"),
        [
            (("--probe", "5,5"), "--probe is for the recording, but --recording none makes none"),
            (("--port", "9090"), "--port is of the page that --recording serve shows"),
            (("--recording", "save", "--probe", "5"), "--probe 5: expected a column and a row"),
            (
                ("--recording", "save", "--probe", "5000,3"),
                "probed pixel 5000,3 lies outside the rectified left picture of",
            ),
        ],
    )
    def test_what_the_recording_cannot_do_is_said(self, folder, out, capsys, more, said):
        assert message_of(words(folder, out, *more), capsys).startswith(said)
        assert not out.exists()

    def test_a_port_in_use_is_said(self, folder, out, capsys):
        with socket.socket() as taken:
            taken.bind(("", 0))
            taken.listen()
            port = taken.getsockname()[1]
            more = ("--recording", "serve", "--port", str(port))

            message = message_of(words(folder, out, *more), capsys)

        assert message.startswith(f"port {port} of this machine is in use")
        assert not out.exists()


class TestDemo:
    def test_it_is_the_sample_pair_with_the_settings_that_are_asked_for(
        self, monkeypatch, tmp_path
    ):
        on_disk(tmp_path / "in" / "workshop", still_life().pair)
        monkeypatch.setattr("recon.sample_pairs.sample_folder", lambda: tmp_path / "in")
        preset = tmp_path / "in" / "workshop" / "quick.toml"

        main(["demo", "-o", str(tmp_path / "out"), "--preset", str(preset), "--recording", "none"])

        assert {path.name for path in (tmp_path / "out").iterdir()} == FILES_ALWAYS

    def test_samples_that_are_not_installed_are_said(self, monkeypatch, tmp_path, capsys):
        monkeypatch.setattr("recon.sample_pairs.__file__", str(tmp_path / "recon" / "x.py"))

        message = message_of(["demo", "-o", str(tmp_path / "out")], capsys)

        assert message == "the sample pairs are not installed; reinstall stereo-recon"


class TestPresets:
    def test_each_is_listed_with_what_it_does(self, capsys):
        main(["presets"])

        assert "paper" in capsys.readouterr().out


class TestView:
    def test_a_folder_without_a_recording_is_refused(self, tmp_path, capsys):
        message = message_of(["view", str(tmp_path)], capsys)

        assert message.startswith(f"there is no recording {tmp_path}/recording.rrd; was it made")

    @pytest.mark.parametrize("name", ["", "recording.rrd"])
    def test_a_folder_or_a_file_is_opened(self, tmp_path, monkeypatch, name):
        (tmp_path / "recording.rrd").write_text("")
        opened = []
        monkeypatch.setattr("recon.viewer.open_recording", opened.append)

        main(["view", str(tmp_path / name)])

        assert opened == [tmp_path / "recording.rrd"]

    def test_a_browser_is_served_if_asked_for(self, tmp_path, monkeypatch, capsys):
        (tmp_path / "recording.rrd").write_text("")
        waited = []

        class Page:
            url, from_elsewhere = "http://here", "ssh -L 9100:localhost:9100 THIS_MACHINE"

            def wait(self):
                waited.append(True)

        served = []

        def serve(path, *, port):
            served.append((path, port))
            return Page()

        monkeypatch.setattr("recon.viewer.serve_recording", serve)

        main(["view", str(tmp_path), "--web", "--port", "9100"])

        assert served == [(tmp_path / "recording.rrd", 9100)]
        assert waited == [True]
        assert "from another machine: ssh -L 9100" in capsys.readouterr().out

    @pytest.mark.slow
    def test_ctrl_c_ends_the_page_without_a_word(self, tmp_path):
        with RerunObserver(save=tmp_path / "recording.rrd") as observe:
            observe("settings", "text")
        heard = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
        code = f"{heard}; from recon.cli import main; main()"  # a parent may ignore Ctrl-C
        served = subprocess.Popen(
            [sys.executable, "-c", code, "view", str(tmp_path), "--web"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        url = re.search(r"http://\S+", served.stdout.readline()).group()
        with urllib.request.urlopen(url, timeout=20) as page:
            assert b"<html" in page.read()
        served.stdout.readline()
        assert served.stdout.readline() == "press Ctrl-C to end the page\n"

        served.send_signal(signal.SIGINT)

        rest, complaints = served.communicate(timeout=20)
        assert (served.returncode, rest, complaints) == (0, "", "")

    def test_a_port_without_a_page_is_refused(self, tmp_path, capsys):
        (tmp_path / "recording.rrd").write_text("")

        message = message_of(["view", str(tmp_path), "--port", "9100"], capsys)

        assert message == "--port is of the page that --web serves; say --web too"


class TestHelp:
    def test_the_form_of_the_command_is_shown_without_none(self, capsys):
        with pytest.raises(SystemExit) as end:
            main(["pair", "--help"])

        shown = capsys.readouterr().out
        assert end.value.code == 0
        assert "LEFT [RIGHT]" in shown
        assert "-o PATH, --out PATH" in shown
        assert "{None}" not in shown

    def test_it_answers_without_loading_torch(self):
        code = (
            "import sys, contextlib; from recon.cli import main\n"
            "with contextlib.suppress(SystemExit): main(['pair', '--help'])\n"
            "assert not {'torch', 'rerun', 'numpy', 'numba'} & sys.modules.keys()"
        )

        root = Path(cli_pair.__file__).parents[2]
        subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, cwd=root)
