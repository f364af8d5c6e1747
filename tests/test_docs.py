"""The pages point to what exists."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CODE = re.compile(r"`((?:relight|tests|conf|benchmarks|workflow)/[\w/.-]+\.(?:py|yaml|smk|js))(?::(\w+))?`")
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), ROOT / "relight" / "weights" / "README.md"])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_and_functions_that_a_page_names_exist(page):
    for path, name in CODE.findall(page.read_text()):
        assert (ROOT / path).exists(), path
        if name:
            assert re.search(rf"^(?:def|class) {name}\b", (ROOT / path).read_text(), re.M), f"{path}:{name}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_that_a_page_links_to_exist(page):
    for target in re.findall(r"\]\((?!https?:|#)([^)#\s]+)", page.read_text()):
        assert (page.parent / target).exists(), target


def test_the_paper_page_names_every_equation_section_figure_and_table():
    text = (ROOT / "docs" / "paper.md").read_text()
    assert re.findall(r"^\| eq\. ([\d, ]+) \|", text, re.M) == ["1", "2", "3, 4", "5", "6", "7"]
    numbers = {
        int(n) for line in re.findall(r"^\| Figures? ([\d, and]+)", text, re.M) for n in re.findall(r"\d+", line)
    }
    assert numbers == set(range(1, 14)) and "| Table 1" in text and "| Table 2" in text


def test_the_site_builds_without_a_warning(tmp_path):
    pytest.importorskip("mkdocs")
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    pages = {path.stem for path in (ROOT / "docs").glob("*.md")}
    built = {path.parent.name for path in (tmp_path / "site").glob("*/index.html")} | {"index"}
    assert pages <= built
