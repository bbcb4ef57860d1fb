"""Who may import whom, read from the source without running it."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from recon.open3d_library import loaded_open3d

ROOT = Path(__file__).parent.parent

ROWS = (
    (
        "recon.kernels",
        "recon.networks",
        "recon.observer",
        "recon.open3d_library",
        "recon.precision",
        "calib.pose",
        "calib.camera",
    ),
    ("calib.rig", "recon.types", "recon.strips"),
    ("calib.pair", "recon.confidence", "recon.disparity_noise"),
    (
        "calib.rectify",
        "calib.boards",
        "calib.epipolar",
        "recon.matching_cost",
        "recon.aggregation",
        "recon.optimisation",
        "recon.consistency",
        "recon.filling",
        "recon.refinement",
        "recon.colours",
    ),
    (
        "calib.row_alignment",
        "calib.row_correction",
        "calib.estimation",
        "recon.coarse_to_fine",
        "recon.enlargement",
    ),
    ("calib.uncalibrated",),
    ("recon.tiles",),
    ("recon.matcher", "recon.normals", "recon.cloud_filters"),
    ("recon.triangulation",),
    ("recon.meshing",),
    ("recon.fusion",),
    ("recon.settings", "recon.disparity_range", "recon.choice"),
    ("recon.pipeline",),
    ("calib.formats", "recon.files"),
    ("calib.trajectories",),
    ("calib",),  # the names that the package gives to others
    (
        "recon.pairs",
        "recon.rectification",
        "recon.output",
        "recon.report",
        "recon.timing",
        "recon.sample_pairs",
        "recon.viewer",
        "recon.training",
    ),
    ("recon.evaluation", "recon.calibration"),
    ("recon.sequence", "recon.comparison"),
    ("recon",),
    ("recon.cli",),
)
"""A module imports from rows above its own and from its own folder, and from nothing else here."""

ONLY_IN = {
    "rerun": ("recon.viewer",),
    "rich": ("recon.cli",),
    "tyro": ("recon.cli",),
    "pydantic": ("recon.settings",),
    "trimesh": ("recon.files",),
    "laspy": ("recon.files",),
    "safetensors": ("recon.networks",),
    "yaml": ("calib.formats",),
    "jinja2": ("recon.evaluation", "recon.calibration", "recon.comparison"),
}
NEVER_IN = {
    "cv2": (
        "recon.kernels",
        "recon.networks",
        "recon.matching_cost",
        "recon.aggregation",
        "recon.optimisation",
        "recon.filling",
        "recon.refinement",
        "recon.matcher",
    ),
}
NOT_AT_THE_TOP = ("open3d",)
"""Slow to import, or in need of system libraries."""

MAY_SAY_CUDA = ("recon.cli", "recon.timing", "recon.report")
WORDS_OF_STEREO = {"left", "right", "disparity", "disparities", "camera", "baseline"}


def module_name(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = {
    module_name(path): path
    for package in ("calib", "recon")
    for path in sorted((ROOT / package).rglob("*.py"))
}
TREES = {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in FILES.items()}
PACKAGES = [name for name, path in FILES.items() if path.name == "__init__.py"]


def inside(name, units):
    return any(name == unit or name.startswith(f"{unit}.") for unit in units)


def unit_of(name):
    """Return the entry of ROWS that a module belongs to; a package's own __init__ is an entry."""
    entries = [entry for row in ROWS for entry in row]
    if name in ("calib", "recon"):
        return name
    found = [entry for entry in entries if "." in entry and inside(name, (entry,))]
    return max(found, key=len, default=None)


def row_of(name):
    return next(number for number, row in enumerate(ROWS) if unit_of(name) in row)


def imported_modules(nodes):
    """Return the absolute names that import statements name, modules of this project whole."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative import"
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                yield whole if whole in FILES else node.module


def all_imports(name):
    return set(imported_modules(ast.walk(TREES[name])))


def imports_when_loaded(name):
    """Return what is imported outside functions and outside `if TYPE_CHECKING`."""
    pending, found = list(TREES[name].body), []
    while pending:
        node = pending.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            pending += node.orelse
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            found.append(node)
            pending += ast.iter_child_nodes(node)
    return set(imported_modules(found))


def own(names):
    return {name for name in names if name.split(".")[0] in ("calib", "recon")}


@pytest.mark.parametrize("name", FILES)
def test_every_module_has_a_row(name):
    assert unit_of(name) is not None, f"add {name} to ROWS, and to ARCHITECTURE.md"


def test_every_row_is_of_modules_that_exist():
    missing = {entry for row in ROWS for entry in row} - FILES.keys()

    assert not missing


@pytest.mark.parametrize("name", FILES)
def test_a_module_imports_only_from_rows_above_or_its_own_folder(name):
    wrong = {
        other
        for other in own(all_imports(name))
        if unit_of(other) != unit_of(name) and row_of(other) >= row_of(name)
    }

    assert not wrong, f"{name} (row {row_of(name)}) imports {sorted(wrong)}"


def test_cameras_know_nothing_of_reconstruction():
    wrong = {n: all_imports(n) for n in FILES if n.startswith("calib")}

    assert not {name for name, others in wrong.items() if inside("recon", others)}
    assert not [o for others in wrong.values() for o in others if o.split(".")[0] == "recon"]


def test_cameras_need_numpy_opencv_and_yaml_only():
    roots = {
        other.split(".")[0]
        for name in FILES
        if name.split(".")[0] == "calib"
        for other in all_imports(name)
    }

    assert roots - sys.stdlib_module_names == {"calib", "numpy", "cv2", "yaml"}


def test_no_module_imports_itself_by_a_detour():
    graph = {name: own(imports_when_loaded(name)) for name in FILES}
    finished = set()

    def visit(name, path):
        assert name not in path, " imports ".join([*path[path.index(name) :], name])
        if name not in finished:
            for other in graph.get(name, ()):
                visit(other, [*path, name])
            finished.add(name)

    for name in graph:
        visit(name, [])


@pytest.mark.parametrize("library", ONLY_IN)
def test_a_library_is_imported_only_where_it_belongs(library):
    users = {n for n in FILES if library in {o.split(".")[0] for o in all_imports(n)}}

    assert users
    assert not {name for name in users if not inside(name, ONLY_IN[library])}


@pytest.mark.parametrize("library", NEVER_IN)
def test_a_library_is_not_imported_where_arrays_may_live_on_any_device(library):
    users = {n for n in FILES if library in {o.split(".")[0] for o in all_imports(n)}}

    assert not {name for name in users if inside(name, NEVER_IN[library])}


@pytest.mark.parametrize("library", NOT_AT_THE_TOP)
def test_a_heavy_library_is_imported_where_it_is_used(library):
    users = {n for n in FILES if library in {o.split(".")[0] for o in imports_when_loaded(n)}}

    assert not users


def test_only_the_edges_choose_a_device():
    sayers = {
        name
        for name, tree in TREES.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and node.value == "cuda"
    }

    assert not {name for name in sayers if not inside(name, MAY_SAY_CUDA)}


def test_kernels_do_not_speak_of_stereo():
    said = {
        (name, node.arg)
        for name, tree in TREES.items()
        if inside(name, ("recon.kernels",))
        for node in ast.walk(tree)
        if isinstance(node, ast.arg) and node.arg in WORDS_OF_STEREO
    }

    assert not said


def test_no_module_is_named_after_nothing():
    last = {name.split(".")[-1] for name in FILES}

    assert not last & {"utils", "util", "common", "core", "helpers", "misc", "base"}


@pytest.mark.parametrize("name", PACKAGES)
def test_a_package_lists_its_names_in_order(name):
    listed = [
        ast.literal_eval(node.value)
        for node in TREES[name].body
        if isinstance(node, ast.Assign | ast.AnnAssign) and "__all__" in ast.unparse(node)
    ]

    only_a_docstring = len(TREES[name].body) == 1
    assert len(listed) == 1 or only_a_docstring, f"{name} needs one __all__"

    def kind_then_name(text):  # as ruff sorts them: CONSTANTS, Classes, functions
        return (not text.isupper(), not text[0].isupper(), text)

    assert all(names == sorted(set(names), key=kind_then_name) for names in listed)


def loaded_by(statement, names):
    """Run a statement in a new Python and return which of `names` it has loaded."""
    code = f"import sys; {statement}; print(*(n for n in {names!r} if n in sys.modules))"
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    return done.stdout.split()


def test_open3d_is_imported_in_one_place_which_says_what_the_system_lacks(monkeypatch):
    users = {path.name for path in (ROOT / "recon").rglob("*.py") if imports_open3d(path)}
    assert users == {"open3d_library.py"}

    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(ImportError, match=r"libusb-1\.0-0 libgl1 libegl1 libgomp1"):
        loaded_open3d()


def imports_open3d(path):
    return "import open3d\n" in path.read_text()


def test_the_path_from_pair_to_surfaces_loads_no_viewer_and_no_open3d():
    heavy = ("rerun", "open3d", "tyro", "rich", "ray", "matplotlib")

    assert loaded_by("import recon.matcher, recon.pipeline, recon.output", heavy) == []


def test_the_command_line_answers_for_help_without_loading_torch():
    heavy = ("torch", "rerun", "numba", "open3d", "cv2", "numpy")

    assert loaded_by("import recon.cli", heavy) == []
