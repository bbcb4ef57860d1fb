"""The page of a report: every figure in its place, nothing loaded, nothing left to doubt."""

import io
import json
import re
import shutil
import subprocess

import numpy as np
import pytest
from made_up_results import ALL_PAIRS, Page, a_failure, a_run, an_entry, curves_of
from PIL import Image

from recon.evaluation.published import PUBLISHED, Published
from recon.evaluation.report import (
    mean_coverage,
    render_page,
    summed_histogram,
    summed_reliability,
)
from recon.evaluation.report.charts import (
    METHOD_COLOURS,
    coverage_chart,
    histogram_chart,
    method_colours,
    reliability_chart,
)
from recon.evaluation.report.curves import end_points
from recon.evaluation.report.numbers import MISSING, as_printed, fixed, two_digits
from recon.evaluation.report.page import error_legend
from recon.evaluation.report.pictures import ERROR_COLOURS, INVALID_COLOUR, UNKNOWN_COLOUR

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)


def no_pictures(*_):
    return None


def page_of(entries, *, published=(), pictures=no_pictures, links=None, **of_run):
    return render_page(
        a_run(entries, **of_run),
        pictures=pictures,
        published=published,
        curves=curves_of(entries),
        links=links,
    )


def two_methods(scenes=("Teddy", "Pipes"), **changes):
    return [
        an_entry(method, scene, start + 0.01 * number, **changes)
        for method, start in (("paper", 12.0), ("sgm", 31.0))
        for number, scene in enumerate(scenes)
    ]


def a_published(name="ELAS", value=7.65, **changes):
    fields = {
        "protocol": "official",
        "matched_at": "",
        "pairs": "training",
        "means": {"nonocc avgerr": value},
        "source": "Somebody, Table 2",
    }
    return Published(name, **(fields | changes))


# what is said of the run


def test_the_head_says_what_was_run_and_with_what():
    page = Page(page_of(two_methods(), command="reconstruct evaluate Q --jobs 2"))

    assert "2 methods, 2 scenes, scored as official@Q." in page.text
    assert "reconstruct evaluate Q --jobs 2" in page.text
    assert "stereo-recon 1.2.3" in page.text.replace("\N{NO-BREAK SPACE}", " ")
    assert '"window_px": 9' in page.text


def test_the_head_names_every_failure_with_its_reason():
    entries = [*two_methods(), a_failure("paper", "Vintage"), a_failure("sgm", "Vintage", "no <x>")]

    page = Page(page_of(entries, problems=["no scene in folder empty"]))

    assert "3 failed" in page.text
    assert "paper on Vintage : scene.png is empty (0 bytes); was the copy" in page.text
    assert "sgm on Vintage : no <x>" in page.text
    assert "no scene in folder empty" in page.text
    assert page.row("Vintage", table=2) == ["failed", "failed"]


def test_a_run_without_failures_says_nothing_of_them():
    assert "failed" not in Page(page_of(two_methods())).text


def test_the_head_names_the_best_of_the_run_under_every_protocol():
    entries = two_methods(protocols=("official@Q", "zs-all"), regions=("nonocc", "all"))

    text = Page(page_of(entries)).text

    best = a_run(entries)["methods"]["paper"]["protocol"]["official@Q"]["mean"]["nonocc"]["avgerr"]
    assert f"Lowest nonocc avgerr by official@Q: paper, {best:.2f} px" in text
    assert "Lowest nonocc bad2.0 by zs-all: paper," in text


# the main table


def test_the_main_table_holds_the_means_it_was_given():
    entries = two_methods()
    mean = a_run(entries)["methods"]["sgm"]["protocol"]["official@Q"]["mean"]

    page = Page(page_of(entries))

    measures = [
        *(f"{mean['nonocc'][name]:.2f}" for name in ("avgerr", "bad2.0", "bad4.0")),
        *(f"{mean['all'][name]:.2f}" for name in ("avgerr", "bad2.0", "invalid")),
    ]
    costs = [f"{mean['seconds']:.2f}", f"{mean['seconds_per_mp']:.2f}", f"{mean['peak_mb']:,.0f}"]
    assert page.row("sgm") == [*measures, *costs]
    assert [cell.split()[0] for cell in page.tables[0][1]] == [
        *("avgerr", "bad2.0", "bad4.0", "avgerr", "bad2.0", "invalid", "time", "per", "peak")
    ]


def test_every_mean_of_every_region_is_reachable_weighted_and_plain():
    entries = two_methods(scenes=("Teddy", "Vintage"))  # weights 1 and 1/2
    of_paper = a_run(entries)["methods"]["paper"]["protocol"]["official@Q"]
    assert of_paper["mean"] != of_paper["plain_mean"]

    page = Page(page_of(entries))

    for region in ("nonocc", "all", "occluded"):
        for measure, value in of_paper["mean"][region].items():
            row = page.row(f"{region} {measure}", table=1)
            decimals = 0 if measure == "pixels" else 2
            plain = of_paper["plain_mean"][region][measure]
            assert row[0] == f"{value:,.{decimals}f}"
            assert row[2] == f"{plain:,.{decimals}f}"
    assert (
        page.row("seconds_per_gdisp", table=1)[0] == f"{of_paper['mean']['seconds_per_gdisp']:.2f}"
    )


def test_rows_are_sorted_with_published_ones_between():
    entries = two_methods(scenes=ALL_PAIRS)
    (low, high) = sorted(
        a_run(entries)["methods"][name]["protocol"]["official@Q"]["mean"]["nonocc"]["avgerr"]
        for name in ("paper", "sgm")
    )
    published = [a_published("Worst", high + 1), a_published("Middle", (low + high) / 2)]

    page = Page(page_of(entries, published=published))

    names = [row[0].split()[0] for row in page.tables[0][2:]]
    assert names == ["paper", "Middle", "sgm", "Worst"]


def test_published_rows_carry_protocol_size_pairs_and_source_and_look_different():
    entries = two_methods(scenes=ALL_PAIRS)

    page = Page(page_of(entries, published=[a_published(), a_published("X", pairs="test")]))

    assert page.tables[0][2 + 0][0].startswith("ELAS")
    (own,) = [row[0] for row in page.tables[0] if row[0].startswith("paper")]
    (other,) = [row[0] for row in page.tables[0] if row[0].startswith("ELAS")]
    assert own == "paper official@Q, this run"
    assert other == "ELAS official, F truth, training pairs [1]"
    assert page.tables[1][-1][0] == "X official, F truth, test pairs [1]"
    rows = [attributes for tag, attributes in page.elements if tag == "tr"]
    assert sum(row.get("class") == "published" for row in rows) == 2
    assert ("li", {"id": "source-1"}) in page.elements
    assert "Somebody, Table 2" in page.text


def test_published_figures_keep_the_digits_they_were_printed_with():
    entries = two_methods(scenes=ALL_PAIRS)
    row = a_published(value=12.5, means={"nonocc avgerr": 12.5, "all avgerr": 13})

    page = Page(page_of(entries, published=[row]))

    cells = page.row("ELAS")
    assert cells[0] == "12.5"
    assert cells[3] == "13"
    assert set(cells[1:3] + cells[4:]) == {MISSING}
    (classes,) = [
        c for c, r in zip(page.classes[0], page.tables[0], strict=True) if r[0].startswith("ELAS")
    ]
    assert "narrower-1" in classes[1]  # so that the points of 12.5 and 12.34 stand in line
    assert "narrower-3" in classes[4]


def test_every_table_has_the_published_rows_of_its_own_protocol():
    entries = two_methods(scenes=ALL_PAIRS, protocols=("official@Q", "zs-all"))
    means = {"all avgerr": 9.0, "all bad2.0": 9.0}
    published = [
        a_published("Official", means=means),
        a_published("Zero", protocol="zs-all", matched_at="Q", means=means),
    ]

    page = Page(page_of(entries, published=published))

    of_protocols = [
        table for table in page.tables if table[0][0] == "Method" and "cost" in table[0]
    ]
    assert [{row[0].split()[0] for row in table[2:]} for table in of_protocols] == [
        {"paper", "sgm", "Official"},
        {"paper", "sgm", "Zero"},
    ]


@pytest.mark.parametrize(
    ("label", "scenes", "changes"),
    [
        ("official@Q", ALL_PAIRS, {"pairs": "test"}),
        ("official@Q", ALL_PAIRS[:14], {}),
        ("zs-all", ALL_PAIRS, {"matched_at": "H"}),
    ],
)
def test_published_rows_over_other_pairs_or_at_another_size_stand_apart(label, scenes, changes):
    fields = {"protocol": label.partition("@")[0], "means": {"all avgerr": 9.0}}
    published = [
        a_published("Same", matched_at="Q", **fields),
        a_published("Other", **fields, **changes),
    ]

    page = Page(page_of(two_methods(scenes=scenes, protocols=(label,)), published=published))

    names = [{row[0].split()[0] for row in table[2:]} for table in page.tables[:2]]
    if scenes == ALL_PAIRS:
        assert names == [{"paper", "sgm", "Same"}, {"Other"}]
    else:
        assert names == [{"paper", "sgm"}, {"Same", "Other"}]


def test_published_rows_without_a_figure_of_the_table_are_left_out():
    entries = two_methods(scenes=ALL_PAIRS, regions=("all",))

    page = page_of(entries, published=[a_published(means={"nonocc avgerr": 9.0})])

    assert "ELAS" not in Page(page).text


def test_rows_of_protocols_or_data_sets_that_were_not_run_are_left_out():
    other = [an_entry("paper", "Cones", 3.0, dataset="middlebury-2003")]

    of_other_scenes = page_of(other, published=PUBLISHED)
    of_other_protocol = page_of(two_methods(), published=[a_published(protocol="zs-noc")])

    assert "PSMNet" not in of_other_scenes
    assert "ELAS" not in of_other_protocol


def test_the_lowest_figures_of_this_run_are_bold_and_published_ones_never():
    page = Page(page_of(two_methods(scenes=ALL_PAIRS), published=[a_published(value=0.1)]))

    bold = {
        row[0].split()[0]: [number for number, names in enumerate(classes) if "best" in names]
        for row, classes in zip(page.tables[0][2:], page.classes[0][2:], strict=True)
    }
    assert bold == {"ELAS": [], "paper": [1, 2, 3, 4, 5, 7, 8, 9], "sgm": []}


def test_a_single_method_has_nothing_to_be_better_than():
    page = Page(page_of([an_entry("paper", "Teddy", 4.0)]))

    assert not any("best" in names for table in page.classes for row in table for names in row)
    assert "Lowest" not in page.text


def test_a_method_that_failed_somewhere_is_not_the_best_and_says_how_many_scenes_it_averages():
    entries = [*two_methods(), an_entry("sgm", "Vintage", 40.0), a_failure("paper", "Vintage")]

    page = Page(page_of(entries))

    assert "1 failed" in page.text
    assert "paper averages 2 of 3 scenes; the others average all 3 scenes." in page.text
    assert page.tables[0][2][0] == "paper official@Q, this run 2 of 3 scenes"
    assert not any("best" in names for row in page.classes[0] for names in row)
    assert "by official@Q: sgm," in page.text


def test_a_sparse_result_is_marked_and_not_the_best():
    entries = two_methods()
    for entry in entries[:2]:
        for region in entry["protocols"]["official@Q"].values():
            region["invalid"] = 30.0

    page = Page(page_of(entries))

    assert "no result at 30.0 % of the pixels" in page.tables[0][2][0]
    assert "by official@Q: sgm," in page.text
    bold = [number for number, names in enumerate(page.classes[0][3]) if "best" in names]
    assert bold == []  # nobody is left to compare with
    assert not any("best" in names for names in page.classes[0][2][1:7])


def test_the_mean_is_named():
    weighted = Page(page_of(two_methods(scenes=("Teddy", "Vintage"))))
    plain = Page(
        page_of(two_methods(protocols=("zs-all",), regions=("all",)), protocols=("zs-all",))
    )

    assert "Means weighted by scene as in the benchmark." in weighted.text
    assert "Plain means." in plain.text
    assert "Every row of this run averages all 2 scenes." in weighted.text


def test_quarter_size_truth_is_explained():
    assert "truth has quarter size, so errors are multiplied by 4" in page_of(two_methods())


# scene by scene, depth, pictures


def test_the_scene_table_holds_every_scene_and_marks_the_best():
    entries = two_methods()

    page = Page(page_of(entries))

    for scene in ("Teddy", "Pipes"):
        expected = [
            f"{entry['protocols']['official@Q']['nonocc']['avgerr']:.2f}"
            for entry in entries
            if entry["scene"] == scene
        ]
        assert page.row(scene, table=2) == expected
    assert all("best" in classes[1] and "best" not in classes[2] for classes in page.classes[2][1:])


def test_published_scenes_stand_beside_ours():
    row = a_published(scenes={"nonocc": {"Teddy": 2.24}, "all": {"Teddy": 3.0}})

    page = Page(page_of(two_methods(), published=[row]))

    tables = [table for table in page.tables if table[0][0] == "Scene"]
    assert tables[0][0][-1] == "ELAS F truth"
    assert {cells[0]: cells[-1] for cells in tables[0][1:]} == {"Teddy": "2.24", "Pipes": MISSING}


def test_depths_and_clouds_are_plain_means_over_calibrated_scenes():
    entries = [*two_methods(), an_entry("sgm", "Vintage", 1.0, depth=None, cloud=None)]
    of_paper = [entry for entry in entries if entry["method"] == "paper"]

    page = Page(page_of(entries))

    row = page.row("paper", table=3)
    medians = [entry["depth"]["nonocc"]["median_relative"] for entry in of_paper]
    chamfers = [entry["cloud"]["chamfer_%"] for entry in of_paper]
    assert row[0] == f"{100 * np.mean(medians):.2f}"
    assert row[-1] == f"{np.mean(chamfers):.2f}"
    assert "Plain means over the calibrated scenes, 2 in all." in page.text


def test_more_is_better_within_a_tolerance_and_less_is_in_distances():
    page = Page(page_of(two_methods()))

    best = {
        row[0]: ["best" in names for names in classes]
        for row, classes in zip(page.tables[3][2:], page.classes[3][2:], strict=True)
    }
    assert best["sgm"][1:4] == [False, True, True]
    assert best["paper"][-1]
    assert not best["sgm"][-1]


def test_without_calibration_there_is_no_depth():
    page = page_of(two_methods(depth=None, cloud=None))

    assert 'id="depth"' not in page
    assert 'href="#depth"' not in page


def test_pictures_are_asked_for_by_method_data_set_scene_and_name():
    asked = []

    page_of([an_entry("paper", "Teddy", 2.0)], pictures=lambda *names: asked.append(names))

    assert asked == [
        (None, "middlebury-v3/Q", "Teddy", "left.jpg"),
        (None, "middlebury-v3/Q", "Teddy", "truth.jpg"),
        ("paper", "middlebury-v3/Q", "Teddy", "disparity.jpg"),
        ("paper", "middlebury-v3/Q", "Teddy", "error.png"),
    ]


def test_two_scenes_of_one_name_are_told_apart():
    asked = set()
    entries = [
        an_entry("paper", "Teddy", 2.0),
        an_entry("paper", "Teddy", 3.0, dataset="middlebury-2003"),
    ]

    page = Page(page_of(entries, pictures=lambda *names: asked.add(names[1:3])))

    assert "Every row of this run averages all 2 scenes." in page.text
    assert "of 1 scenes" not in page.text
    assert asked == {("middlebury-v3/Q", "Teddy"), ("middlebury-2003", "Teddy")}


def test_pictures_lie_inside_the_page_with_their_figures():
    entry = an_entry("paper", "Teddy", 2.0)
    measures = entry["protocols"]["official@Q"]["nonocc"]

    page = Page(page_of([entry], pictures=a_picture))

    images = [attributes for tag, attributes in page.elements if tag == "img"]
    assert len(images) == 4
    assert all(image["src"].startswith("data:image/") for image in images)
    assert all((image["width"], image["height"]) == ("8", "6") for image in images)
    assert all(image["alt"].startswith("Teddy, ") for image in images)
    assert f"avgerr {measures['avgerr']:.2f} px · bad2.0 {measures['bad2.0']:.2f} %" in page.text
    assert "400 × 300 px, disparities 0 to 63" in page.text


def a_picture(_method, _dataset, _scene, name):
    contents = io.BytesIO()
    picture = np.full((6, 8, 3), 100, np.uint8)
    Image.fromarray(picture).save(contents, "PNG" if name.endswith("png") else "JPEG")
    return contents.getvalue()


def test_the_legend_has_the_colours_of_the_error_maps():
    legend = error_legend()

    expected = [
        "#{:02x}{:02x}{:02x}".format(*c) for c in (*ERROR_COLOURS, INVALID_COLOUR, UNKNOWN_COLOUR)
    ]
    assert [colour for colour, _, _ in legend] == expected
    assert [meaning for _, _, meaning in legend] == [
        *("up to 0.5 px", "0.5 to 1", "1 to 2", "2 to 4", "4 to 8", "8 to 16", "16 to 32"),
        *("above 32", "no result", "truth unknown"),
    ]
    page = page_of(two_methods())
    assert all(f"background:{colour}" in page for colour in expected)


# the page as a whole


def test_nothing_is_loaded_from_anywhere():
    page = Page(page_of(two_methods(), published=PUBLISHED, pictures=a_picture))
    style = page_of(two_methods()).partition("<style>")[2].partition("</style>")[0]

    assert not {"script", "link", "iframe", "object", "embed"} & {tag for tag, _ in page.elements}
    sources = [
        value
        for _, attributes in page.elements
        for name, value in attributes.items()
        if name in ("src", "srcset", "xlink:href", "data", "poster")
    ]
    assert all(source.startswith("data:image/") for source in sources)
    assert "url(" not in style
    assert "@import" not in style


def test_anchors_lead_somewhere():
    page = Page(page_of(two_methods(scenes=ALL_PAIRS), published=PUBLISHED))

    targets = [a["href"][1:] for tag, a in page.elements if tag == "a" and a["href"][0] == "#"]
    names = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert set(targets) <= set(names)
    assert len(names) == len(set(names))
    assert "scene-15" in targets


def test_sources_with_an_address_are_links_and_other_text_is_escaped():
    rows = [
        a_published("A", source="Hamid, doi 10.11591/ijeecs.v25.i1.pp223-231, Tables <1>"),
        a_published("B", source="toolbox (github.com/some/toolbox), README"),
    ]

    page = page_of(two_methods(scenes=ALL_PAIRS), published=rows)

    assert 'href="https://doi.org/10.11591/ijeecs.v25.i1.pp223-231"' in page
    assert 'href="https://github.com/some/toolbox"' in page
    assert "Tables &lt;1&gt;" in page


def test_links_to_the_figures_are_those_given():
    page = Page(page_of(two_methods(), links={"results.csv": "../results.csv"}))

    assert ("a", {"href": "../results.csv"}) in page.elements


def test_names_with_characters_of_html_are_escaped():
    name = '<script>alert("&")</script>'
    entries = [an_entry(name, "<b>Teddy</b>", 2.0), a_failure(name, "Pipes & Co", "<i>no</i>")]

    text = page_of(entries, pictures=a_picture, command="a <b> & c")

    assert not {"script", "i"} & {tag for tag, _ in Page(text).elements if tag == "script"}
    assert "<i>no</i>" not in text
    assert "<b>Teddy</b>" not in text
    page = Page(text)
    assert name in page.text
    assert "a <b> & c" in page.text
    assert page.tables[0][2][0].startswith(name)


def test_the_same_input_gives_the_same_page():
    entries = two_methods()

    assert page_of(entries, pictures=a_picture) == page_of(entries, pictures=a_picture)


def test_missing_figures_are_dashes():
    entry = an_entry("paper", "Teddy", 2.0, seconds=None, peak_mb=None)
    measures = entry["protocols"]["official@Q"]
    measures["nonocc"].update(avgerr=None, rms=float("nan"))
    entry["cloud"]["chamfer_%"] = None
    entries = [entry, an_entry("sgm", "Teddy", 3.0)]

    page = Page(page_of(entries))

    assert page.row("paper")[0] == MISSING
    assert page.row("paper")[-3:] == [MISSING] * 3
    assert page.row("paper", table=3)[-1] == MISSING
    assert not re.search(r"\b(None|nan|inf|null|Undefined)\b", page.text)


CASES = {
    "one scene and one method": [an_entry("paper", "Teddy", 2.0)],
    "no mask of visible pixels": two_methods(regions=("all",)),
    "no calibration": two_methods(depth=None, cloud=None),
    "no confidence": two_methods(coverage=None),
    "all failed": [a_failure("paper", "Teddy"), a_failure("sgm", "Teddy")],
    "one failed everywhere": [
        *two_methods(),
        a_failure("none", "Teddy"),
        a_failure("none", "Pipes"),
    ],
    "kitti": two_methods(protocols=("kitti",), dataset="kitti/2015"),
    "30 scenes": two_methods(scenes=[f"scene {number}" for number in range(30)]),
    "three protocols": two_methods(protocols=("official@Q", "zs-all", "own-size")),
}


@pytest.mark.parametrize("case", CASES)
def test_every_kind_of_run_has_a_page(case):
    entries = CASES[case]

    page = Page(page_of(entries, published=PUBLISHED, pictures=a_picture))

    assert not re.search(r"\b(None|nan|inf|null)\b", page.text.replace('"null"', ""))
    for method in {entry["method"] for entry in entries}:
        assert any(row[0].startswith(method) for row in page.tables[0])
    for row in (row for table in page.tables for row in table if row):
        assert row[0] or len(row) > 1


def test_without_visible_pixels_all_of_known_truth_decide():
    entries = two_methods(regions=("all",))

    page = Page(page_of(entries))

    assert "Lowest all avgerr by official@Q: paper," in page.text
    assert "Sorted by all avgerr" in page.text


def test_truth_of_full_size_is_claimed_only_where_something_was_scored():
    scored = Page(page_of(two_methods(protocols=("official",))))
    failed = Page(page_of([a_failure("paper", "Teddy"), a_failure("sgm", "Teddy")]))

    assert scored.tables[0][2][0] == "paper official, F truth, this run"
    assert failed.tables[0][1][0] == "paper official, this run 0 of 1 scenes"


def test_kitti_is_ranked_by_d1():
    page = Page(page_of(two_methods(protocols=("kitti",), dataset="kitti/2015")))

    assert page.tables[0][1][0] == "d1 %"
    assert "Sorted by nonocc d1" in page.text


def test_a_page_of_a_result_read_from_json_is_the_same():
    result = a_run(two_methods())
    again = json.loads(json.dumps(result))
    curves = curves_of(two_methods())

    pages = [
        render_page(each, pictures=no_pictures, published=(), curves=curves)
        for each in (result, again)
    ]

    assert pages[0] == pages[1]


# numbers


@pytest.mark.parametrize(
    ("write", "value", "text"),
    [
        (fixed, 1234.567, "1,234.57"),
        (fixed, 0.0, "0.00"),
        (fixed, None, MISSING),
        (fixed, float("nan"), MISSING),
        (fixed, float("inf"), MISSING),
        (fixed, "text", MISSING),
        (two_digits, 12.345, "12.35"),
        (two_digits, 0.0999, "0.10"),
        (two_digits, 0.01234, "0.012"),
        (two_digits, 0.0, "0.00"),
        (two_digits, None, MISSING),
        (as_printed, 12.5, "12.5"),
        (as_printed, 5.29, "5.29"),
        (as_printed, 13.0, "13"),
        (as_printed, None, MISSING),
    ],
)
def test_numbers_are_written_as_documented(write, value, text):
    assert write(value) == text


# curves


def test_mean_coverage_ends_where_the_first_scene_ends():
    long = {"share": [50.0, 100.0], "bad2.0": [1.0, 3.0], "avgerr": [0.1, 0.3]}
    short = {"share": [50.0, 100.0], "bad2.0": [5.0, None], "avgerr": [0.3, None]}

    mean = mean_coverage([long, None, short])

    assert mean == {
        "share": [50.0, 100.0],
        "bad2.0": [3.0, None],
        "avgerr": [pytest.approx(0.2), None],
        "scenes": 2,
    }


def test_no_confidence_means_no_coverage_curve():
    assert mean_coverage([None, None]) is None
    assert mean_coverage([]) is None
    assert summed_histogram([]) is None


def test_curves_over_different_shares_are_refused():
    curves = [{"share": [share], "bad2.0": [1.0], "avgerr": [1.0]} for share in (50.0, 100.0)]

    with pytest.raises(ValueError, match=r"same shares .* first has \[50.0\]"):
        mean_coverage(curves)


def test_histograms_are_added_bin_by_bin():
    one = {"edges": [-1, 0, 1], "counts": [1, 2, 3, 4]}
    other = {"edges": [-1, 0, 1], "counts": [10, 20, 30, 40]}

    assert summed_histogram([one, other]) == {"edges": [-1, 0, 1], "counts": [11, 22, 33, 44]}


def test_histograms_with_other_edges_are_refused():
    histograms = [{"edges": [0, edge], "counts": [0, 1, 0]} for edge in (1, 2)]

    with pytest.raises(ValueError, match=r"same edges .* first has \[0, 1\]"):
        summed_histogram(histograms)


def test_end_points_are_means_over_scenes_of_what_is_covered():
    entries = [an_entry("paper", "Teddy", 2.0), an_entry("paper", "Pipes", 2.0)]
    for entry, invalid in zip(entries, (0.0, 50.0), strict=True):
        entry["protocols"]["official@Q"]["nonocc"].update({"invalid": invalid, "wrong2.0": 10.0})

    ends = end_points(a_run(entries))

    assert ends == {"paper": (75.0, 15.0)}  # 10 of 100 and 10 of 50


def test_methods_keep_their_colours_and_the_eighth_gets_dashes():
    names = [f"method {number}" for number in range(9)]

    colours = method_colours(names)

    assert len(set(colours.values())) == 9
    assert colours["method 0"] == (METHOD_COLOURS[0], "")
    assert colours["method 7"] != (METHOD_COLOURS[0], "")
    assert colours["method 7"][0] == METHOD_COLOURS[0]
    page = page_of(two_methods())
    assert page.count(f'stroke="{METHOD_COLOURS[1]}"') >= 4


def points_of(line):
    return [tuple(float(part) for part in point.split(",")) for point in line.points.split()]


def test_a_coverage_line_lies_where_its_figures_say():
    curve = {"share": [50.0, 100.0], "bad2.0": [10.0, 20.0]}

    chart = coverage_chart({"a": curve, "b": None}, {"a": (100.0, 20.0), "b": (50.0, 10.0)})

    left, top, right, bottom = chart.box
    line, dot = chart.lines
    middle = (left + right) / 2
    assert chart.y_ticks[-1].text == "20"
    np.testing.assert_allclose(points_of(line), [(middle, (top + bottom) / 2), (right, top)])
    np.testing.assert_allclose(line.end, (right, top))
    assert dot.points == ""
    np.testing.assert_allclose(dot.end, (middle, (top + bottom) / 2))
    assert [tick.text for tick in chart.x_ticks] == ["0", "20", "40", "60", "80", "100"]


def test_reliabilities_of_scenes_are_added():
    one = {"pixels": [10, 0], "said": [2.0, 0.0], "right": [4, 0]}
    other = {"pixels": [10, 20], "said": [4.0, 18.0], "right": [1, 15]}

    total = summed_reliability([one, None, other])

    assert total == {"pixels": [20, 20], "said": [6.0, 18.0], "right": [5, 15], "gap": 4 / 40}
    assert summed_reliability([None]) is None


def test_what_comes_true_as_said_lies_on_the_diagonal():
    true = {"pixels": [0, 20], "said": [0.0, 18.0], "right": [0, 18], "gap": 0.0}
    bold = {"pixels": [10, 10], "said": [5.0, 10.0], "right": [0, 5], "gap": 0.5}

    chart = reliability_chart({"true": true, "none": None, "bold": bold})

    left, top, right, bottom = chart.box
    middle = (left + right) / 2
    assert [line.method for line in chart.lines] == ["true", "bold"]
    np.testing.assert_allclose(
        points_of(chart.lines[0]),
        [(left + 0.9 * (right - left), bottom + 0.9 * (top - bottom))],
    )
    np.testing.assert_allclose(
        points_of(chart.lines[1]), [(middle, bottom), (right, (top + bottom) / 2)]
    )
    assert chart.lines[1].summary == "50.0 points apart in the mean"
    assert reliability_chart({"none": None}) is None


def test_the_page_draws_lines_and_dots_in_the_colours_of_their_methods():
    entries = [
        *two_methods(),
        *(an_entry("last", s, 50.0, coverage=None) for s in ("Teddy", "Pipes")),
    ]
    colours = method_colours(["paper", "sgm", "last"])
    curves = {name: curve["coverage"] for name, curve in curves_of(entries).items()}
    chart = coverage_chart(curves, end_points(a_run(entries)))

    page = Page(page_of(entries))

    dots = [a for tag, a in page.elements if tag == "circle"]
    lines = [a for tag, a in page.elements if tag == "polyline"][:2]
    for line, dot in zip(chart.lines, dots, strict=True):
        assert (float(dot["cx"]), float(dot["cy"])) == line.end
        assert dot["fill"] == colours[line.method][0]
    for line, drawn in zip(chart.lines, lines, strict=False):
        assert drawn["points"] == line.points
        assert drawn["stroke"] == colours[line.method][0]
    assert "None" not in page.text


def test_a_coverage_line_stops_where_there_is_nothing_left():
    curve = {"share": [50.0, 100.0], "bad2.0": [10.0, None]}

    chart = coverage_chart({"a": curve}, {"a": None})

    assert len(points_of(chart.lines[0])) == 1


def test_there_is_no_chart_of_nothing():
    assert coverage_chart({"a": None}, {"a": None}) is None
    assert histogram_chart({"a": None}) is None
    assert histogram_chart({"a": {"edges": [0, 1], "counts": [0, 0, 0]}}) is None


def test_a_histogram_draws_densities_on_powers_of_ten_and_tells_its_tails():
    histogram = {"edges": [-2.0, -1.0, 2.0], "counts": [25, 10, 30, 35]}

    chart = histogram_chart({"a": histogram})

    left, _, right, bottom = chart.box
    (line,) = chart.lines
    assert [tick.text for tick in chart.y_ticks] == ["10", "100"]
    # 10 % in 1 px, then 30 % in 3 px: the same density
    assert points_of(line) == [
        (left, bottom),
        (left + (right - left) / 4, bottom),
        (left + (right - left) / 4, bottom),
        (right, bottom),
    ]
    assert line.summary == "25.00 % below −2 px, 35.00 % from 2 px"
    assert "25.00 % below −2 px, 35.00 % from 2 px" not in Page(page_of(two_methods())).text
    assert "10.00 % below −1 px, 20.00 % from 1 px" in Page(page_of(two_methods())).text


def test_empty_bins_lie_on_the_floor():
    histogram = {"edges": [-2.0, -1.0, 0.0, 2.0], "counts": [0, 0, 50, 50, 0]}

    chart = histogram_chart({"a": histogram})

    assert points_of(chart.lines[0])[0][1] == chart.box[3]
    assert max(y for _, y in points_of(chart.lines[0])) <= chart.box[3]


# as a browser shows it

TELL_WIDTH = "<script>parent.postMessage(document.documentElement.scrollWidth, '*')</script>"
FRAME = """<!DOCTYPE html><body style="margin:0">
<script>onmessage = message => document.body.dataset.width = message.data</script>
<iframe src="page.html" style="border:0;width:{width}px;height:{height}px"></iframe>"""
"""Windows have a least width, frames have not."""


def in_browser(folder, *options):
    """Open frame.html in a browser without a window and return what it prints."""
    command = [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
    command += [f"--user-data-dir={folder / 'profile'}", "--virtual-time-budget=5000", *options]
    address = (folder / "frame.html").as_uri()
    run = subprocess.run([*command, address], capture_output=True, timeout=120, check=True)
    return run.stdout.decode("utf-8", errors="replace")


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium")
@pytest.mark.parametrize("width", [390, 1280])
def test_the_page_fits_the_width_of_a_screen_and_is_not_blank(tmp_path, width):
    height = 900
    long_name = "a_method_with_a_name_that_has_no_place_to_break_it_at_all"
    entries = [
        *two_methods(scenes=ALL_PAIRS, protocols=("official@Q", "zs-all")),
        a_failure(long_name, "Teddy", f"/{long_name * 3}/left.png is empty"),
    ]
    page = page_of(entries, published=PUBLISHED, pictures=a_picture, command=long_name * 4)
    (tmp_path / "page.html").write_text(page + TELL_WIDTH, encoding="utf-8")
    (tmp_path / "frame.html").write_text(FRAME.format(width=width, height=height))

    document = in_browser(tmp_path, "--dump-dom")
    window = f"--window-size={max(width, 600)},{height}"
    in_browser(tmp_path, window, f"--screenshot={tmp_path / 'page.png'}")

    assert f'data-width="{width}"' in document
    picture = np.asarray(Image.open(tmp_path / "page.png").convert("L"))[:, :width]
    assert picture.shape == (height, width)
    assert 0.02 < (picture < 128).mean() < 0.5
