"""What the README says is run."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from recon.cli import COMMANDS
from recon.output import OUTPUTS

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_five_lines_of_python_do_what_they_say():
    (code,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)

    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )

    points, depth = re.fullmatch(r"\((\d+), 3\) \((\d+, \d+)\)\s*", done.stdout).groups()
    assert int(points) > 300_000
    assert depth == "540, 720"


def test_every_command_that_it_names_is_there():
    named = set(re.findall(r"^reconstruct (\w+)", README, re.MULTILINE))

    assert named == set(COMMANDS)


def test_every_file_of_the_results_is_explained():
    assert all(f"`{name}`" in README for name in OUTPUTS)


def test_every_page_it_points_to_exists():
    links = re.findall(r"\]\(([^):]+)\)", README)

    assert links
    assert all((ROOT / link).exists() for link in links)
