"""Presets, and the settings laid over them."""

import json

import pytest

from recon.aggregation import AGGREGATIONS
from recon.filling import SurfaceFilling
from recon.matching_cost import MATCHING_COSTS, Census, SumOfAbsoluteDifferences
from recon.refinement import DomainTransform, Median
from recon.settings import (
    PRESETS,
    STAGES,
    load_preset,
    overrides_from,
    parse_override,
    preset_names,
    spelled_out,
)

SMALL = """
description = "quick"

[matching_cost]
method = "census"
rows_px = 5

[aggregation]
method = "box"
radius_px = 2

[[refinements]]
method = "median"
radius_px = 3
"""


@pytest.fixture
def small(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(SMALL)
    return path


def as_toml(table, name=""):
    """Return tables as the text of a TOML file; JSON's numbers, texts and lists are TOML's too."""
    plain = {key: value for key, value in table.items() if not isinstance(value, dict)}
    lists = {k: v for k, v in plain.items() if isinstance(v, list) and v and isinstance(v[0], dict)}
    lines = [f"{key} = {json.dumps(plain[key])}" for key in plain if key not in lists]
    for key, entries in lists.items():
        for entry in entries:
            lines += [f"[[{key}]]", as_toml(entry)]
    for key, value in table.items():
        if isinstance(value, dict):
            lines += [f"[{key}]", as_toml(value, key)]
    return "\n".join(lines)


def with_overrides(small, *texts):
    return load_preset(small, overrides_from(None, texts))


class TestPresets:
    @pytest.mark.parametrize("name", preset_names())
    def test_every_preset_that_ships_loads_and_says_what_it_does(self, name):
        preset = load_preset(name)

        assert preset.description
        assert preset.meshing.points == preset.triangulation

    @pytest.mark.parametrize("name", preset_names())
    def test_a_preset_spelled_out_is_the_same_preset(self, name, tmp_path):
        preset = load_preset(name)
        path = tmp_path / "again.toml"
        path.write_text(as_toml(spelled_out(preset)))

        assert repr(load_preset(path)) == repr(preset)

    @pytest.mark.parametrize("stage", [stage for stage in STAGES if stage != "refinements"])
    def test_every_method_of_every_stage_survives_spelling(self, stage, small, tmp_path):
        for method in STAGES[stage]:
            preset = with_overrides(small, f"{stage}.method={method}")
            path = tmp_path / "again.toml"
            path.write_text(as_toml(spelled_out(preset)))

            assert repr(load_preset(path)) == repr(preset)

    def test_paper_is_the_default_and_is_the_papers_method(self):
        matcher = load_preset().matcher

        assert repr(load_preset("paper").matcher) == repr(matcher)
        assert isinstance(matcher.matching_cost, MATCHING_COSTS["cnn"])
        assert isinstance(matcher.aggregation, AGGREGATIONS["bilateral"])
        assert [type(refinement) for refinement in matcher.refinements] == [DomainTransform]

    def test_an_unknown_preset_is_named_with_those_that_there_are(self):
        with pytest.raises(ValueError, match=r"unknown preset 'papre'; there are .*paper"):
            load_preset("papre")

    def test_presets_lie_in_the_package(self):
        assert sorted(path.stem for path in PRESETS.glob("*.toml")) == preset_names()


class TestOverrides:
    def test_a_setting_is_replaced_and_its_neighbours_stay(self, small):
        cost = with_overrides(small, "matching_cost.columns_px=7").matcher.matching_cost

        assert cost == Census(rows_px=5, columns_px=7)

    def test_another_method_starts_from_its_own_defaults(self, small):
        matcher = with_overrides(small, "matching_cost.method=sad").matcher

        assert matcher.matching_cost == SumOfAbsoluteDifferences()

    @pytest.mark.parametrize("order", [1, -1])
    def test_method_and_setting_may_come_in_any_order(self, small, order):
        texts = ["matching_cost.method=sad", "matching_cost.radius_px=7"][::order]

        cost = with_overrides(small, *texts).matcher.matching_cost

        assert cost == SumOfAbsoluteDifferences(radius_px=7)

    def test_a_stage_may_be_given_as_the_name_of_its_method(self, small):
        cost = with_overrides(small, "matching_cost=sad", "matching_cost.radius_px=6")

        assert cost.matcher.matching_cost == SumOfAbsoluteDifferences(radius_px=6)

    def test_an_entry_of_a_list_is_named_by_its_number(self, small):
        matcher = with_overrides(small, "refinements.0.radius_px=1").matcher

        assert matcher.refinements == (Median(1),)

    def test_another_method_of_an_entry_starts_from_its_own_defaults(self, small):
        matcher = with_overrides(small, "refinements.0.method=domain_transform").matcher

        assert matcher.refinements == (DomainTransform(),)

    def test_a_list_is_replaced_whole(self, small):
        matcher = with_overrides(small, "refinements=['domain_transform', 'median']").matcher

        assert matcher.refinements == (DomainTransform(), Median())

    def test_filling_can_be_switched_off_and_on(self, small):
        off = with_overrides(small, "filling=false")
        on = with_overrides(small, "filling=false", "filling=true")
        changed = with_overrides(small, "filling.confidence=0.5")

        assert off.matcher.filling is None
        assert on.matcher.filling == SurfaceFilling()
        assert changed.matcher.filling == SurfaceFilling(confidence=0.5)

    def test_the_command_line_wins_over_the_file_and_the_file_over_the_preset(
        self, small, tmp_path
    ):
        file = tmp_path / "mine.toml"
        file.write_text("left_right_tolerance_px = 2.5\naggregation.radius_px = 7\n")

        matcher = load_preset(
            small, overrides_from(file, ["aggregation.radius_px=1", "min_segment_px=9"])
        ).matcher

        assert matcher.left_right_tolerance_px == 2.5
        assert matcher.aggregation.radius_px == 1
        assert matcher.min_segment_px == 9

    def test_the_mesh_is_made_of_the_points_that_are_kept(self, small):
        preset = with_overrides(small, "triangulation.max_depth_m=5")

        assert preset.meshing.points.max_depth_m == 5

    def test_laying_settings_over_a_table_leaves_it_alone(self, small):
        overrides = {"refinements": {"0": {"radius_px": 1}}}

        load_preset(small, overrides)

        assert overrides == {"refinements": {"0": {"radius_px": 1}}}

    @pytest.mark.parametrize(
        ("text", "table"),
        [
            ("a.b=1", {"a": {"b": 1}}),
            ("a.b = 0.5", {"a": {"b": 0.5}}),
            ("a=word", {"a": "word"}),
            ("a='a = b'", {"a": "a = b"}),
            ("a.0.b=true", {"a": {"0": {"b": True}}}),
            ("a=[1, 2]", {"a": [1, 2]}),
            ("a=/path/of.weights", {"a": "/path/of.weights"}),
        ],
    )
    def test_a_value_is_written_as_in_toml_or_as_a_bare_word(self, text, table):
        assert parse_override(text) == table


class TestMistakes:
    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("agregation.radius_px=3", r"unknown stage or setting 'agregation'; a preset has "
             r"matching_cost, aggregation, .*triangulation, cloud, meshing, description"),
            ("matching_cost.method=mccnn", r"unknown method 'mccnn' for matching_cost; there are "
             r"absolute_difference, sad, .*census, ad_census, soft_census, cnn"),
            ("matching_cost.method=['sad']", r"unknown method \['sad'\] for matching_cost"),
            ("aggregation.radius=3", r"unknown setting 'radius' in aggregation box; it has "
             r"radius_px$"),
            ("refinements.0.radius=3", r"unknown setting 'radius' in refinements median; it has "
             r"radius_px$"),
            ("meshing.points=3", r"unknown setting 'points' in meshing; it has "
             r"min_component_faces, decimation_sigma, watertight"),
            ("aggregation.radius_px=big", r"^aggregation box radius_px: .*valid integer.*'big'$"),
            ("aggregation.radius_px=1.5", r"^aggregation box radius_px: .*valid integer.* 1.5$"),
            ("aggregation.radius_px='3'", r"^aggregation box radius_px: .*valid integer.*'3'$"),
            ("aggregation.radius_px=true", r"^aggregation box radius_px: .*valid integer.*True$"),
            ("aggregation.radius_px=-1", r"^aggregation box: radius_px must .*-1"),
            ("matching_cost.rows_px=4", r"^matching_cost census: .* odd .*4 x 9$"),
            ("left_right_tolerance_px=-1", r"^left_right_tolerance_px must not be negative"),
            ("left_right_tolerance_px=low", r"^left_right_tolerance_px: .*valid number.*'low'$"),
            ("filling=none", r"^unknown method 'none' for filling; .* background, surfaces$"),
            ("filling.confidence=2", r"^filling: confidence must be in \[0, 1\], got 2"),
            ("refinements=median", r"^refinements must be a list such as \['median'\], got "),
            ("refinements=5", r"^refinements must be a list such as \['median'\], got 5$"),
            ("refinements.1.radius_px=5", r"^unknown entry refinements\.1; the list holds "
             r"refinements\.0$"),
            ("refinements.x.radius_px=5", r"^unknown entry refinements\.x; "),
            ("matching_cost=5", r"^unknown method 5 for matching_cost"),
            ("triangulation.include=['matchd']", r"^triangulation: include has \['matchd'\]"),
            ("triangulation=1", r"^triangulation must be a table of settings, got 1$"),
        ],
    )  # fmt: skip
    def test_it_is_named_with_what_there_is(self, small, text, message):
        with pytest.raises(ValueError, match=message):
            with_overrides(small, text)

    @pytest.mark.parametrize("text", ["radius", "=3", ""])
    def test_a_text_that_sets_nothing_is_refused(self, text):
        with pytest.raises(ValueError, match=r"expected SETTING=VALUE such as .* got '"):
            parse_override(text)

    def test_a_preset_without_a_needed_stage_is_refused(self, tmp_path):
        path = tmp_path / "half.toml"
        path.write_text("[aggregation]\nmethod = 'box'\n")

        with pytest.raises(ValueError, match="the preset lacks matching_cost"):
            load_preset(path)

    def test_a_stage_without_a_method_is_refused(self, tmp_path):
        path = tmp_path / "half.toml"
        path.write_text("[aggregation]\nradius_px = 1\n")

        with pytest.raises(ValueError, match="aggregation lacks its method; there are bilateral,"):
            load_preset(path)

    @pytest.mark.parametrize("contents", [b"[matching_cost\n", b"a = \xff\n"])
    def test_a_file_that_is_not_toml_is_named(self, tmp_path, contents):
        path = tmp_path / "broken.toml"
        path.write_bytes(contents)

        with pytest.raises(ValueError, match=r"broken\.toml is not a TOML file: "):
            overrides_from(path, [])

    def test_a_settings_file_that_does_not_exist_is_named(self, tmp_path):
        with pytest.raises(FileNotFoundError, match=r"there is no settings file .*mine\.toml"):
            overrides_from(tmp_path / "mine.toml", [])
        with pytest.raises(ValueError, match="is a folder; give a TOML file"):
            overrides_from(tmp_path, [])
