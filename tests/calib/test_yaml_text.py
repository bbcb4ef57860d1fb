import pytest

from calib.formats.yaml_text import load_yaml

TEXTS = {
    "scalars": (
        "a: 1\nb: -2.5e-3\nc: 1.\nd: .5\ne: 1e-05\nf: word\ng: 'it''s'\nh: \"a\\tb\"\ni:\nj: ~\n",
        {
            "a": 1,
            "b": -2.5e-3,
            "c": 1.0,
            "d": 0.5,
            "e": 1e-5,
            "f": "word",
            "g": "it's",
            "h": "a\tb",
            "i": None,
            "j": None,
        },
    ),
    "truth": ("do_rectify: False\nother: true\n", {"do_rectify": False, "other": True}),
    "nested": ("a:\n  b:\n    c: 1\n  d: 2\ne: 3\n", {"a": {"b": {"c": 1}, "d": 2}, "e": 3}),
    "list_below": ("d:\n  - 1\n  - 2\ne: 3\n", {"d": [1, 2], "e": 3}),
    "list_as_far_left": ("d:\n- 1\n- 2\ne: 3\n", {"d": [1, 2], "e": 3}),
    "lists_in_lists": ("T:\n- - 1\n  - 2\n- - 3\n  - 4\n", {"T": [[1, 2], [3, 4]]}),
    "rows": ("T:\n- [1, 2]\n- [3, 4]\n", {"T": [[1, 2], [3, 4]]}),
    "mappings_in_lists": ("- a: 1\n  b: 2\n- a: 3\n", [{"a": 1, "b": 2}, {"a": 3}]),
    "flow": ("m: {n: 2, data: [1, [2, 3]], o: []}", {"m": {"n": 2, "data": [1, [2, 3]], "o": []}}),
    "over_lines": ("d: [1,\n   2, # two\n3]\ne: 4\n", {"d": [1, 2, 3], "e": 4}),
    "comments": ("# don't\na: 1 # [\nb: 'x # y'\nc: x#y\n", {"a": 1, "b": "x # y", "c": "x#y"}),
    "brackets_in_quotes": ("a: '['\nb: [\"]\", 1]\n", {"a": "[", "b": ["]", 1]}),
    "topics": ("t: /cam0/raw\nu: a://x\nv: it's\n", {"t": "/cam0/raw", "u": "a://x", "v": "it's"}),
    "tags": ("m: !!opencv-matrix\n  rows: 3\n", {"m": {"rows": 3}}),
    "first_document": ("%YAML 1.2\n---\na: 1\n---\na: 2\n", {"a": 1}),
    "windows": ("a: 1\r\nb:\r\n  c: 2\r\n", {"a": 1, "b": {"c": 2}}),
    "aliases": ("a: &x [1]\nb: *x\n", {"a": [1], "b": [1]}),
    "nothing": ("# only a comment\n", None),
}  # fmt: skip


@pytest.mark.parametrize(("text", "expected"), TEXTS.values(), ids=TEXTS)
def test_what_calibration_tools_write_is_read(text, expected):
    assert load_yaml(text) == expected


ERRORS = {
    "open_bracket": ("a: 1\nb: [1,\n2", "line 3: .*cut off"),
    "tab": ("a:\n\tb: 1\n", "line 2: .*token"),
    "twice": ("a: 1\na: 2\n", "line 2: a is there twice"),
    "no_key": ("a: 1\nword\n", "line 3: .*':'"),
    "half_indented": ("a:\n    b: 1\n  c: 2\n", "line 3: "),
    "value_and_block": ("a: 1\n  b: 2\n", "line 2: "),
    "no_such_alias": ("b: *x\n", "line 1: .*alias"),
    "wrong_bracket": ("a: [1, 2}\n", "line 1: .*got '}'"),
    "item_in_mapping": ("- 1\nb: 2\n", "line 2: "),
    "control": ("a: \x01\n", "it is not YAML"),
}


@pytest.mark.parametrize(("text", "message"), ERRORS.values(), ids=ERRORS)
def test_what_is_no_yaml_is_refused_with_its_line(text, message):
    with pytest.raises(ValueError, match=message):
        load_yaml(text)
