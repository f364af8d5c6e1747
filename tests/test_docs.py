"""The pages point to what exists."""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest
import yaml

ROOT = Path(__file__).parents[1]
CODE = re.compile(r"`((?:relight|tests|conf|benchmarks|workflow)/[\w/.-]+\.(?:py|yaml|smk|js))(?::(\w+))?`")
FOLDERS = ". .github docs docs/lab docs/joss integrations/blender integrations/comfyui relight/weights".split()
PAGES = sorted(page for folder in FOLDERS for page in (ROOT / folder).glob("*.md"))
WRAPPED = [page for page in PAGES if page.parent.name in ("docs", "lab") and page.stem != "first_hour"]


def anchors(page: Path) -> set[str]:
    """Returns the anchors of a page's headings, as MkDocs makes them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.M | re.S)
    titles = [re.sub(r"[^\w\s-]", "", title).strip().lower() for title in re.findall(r"^#+ (.*)$", text, re.M)]
    return {re.sub(r"[-\s]+", "-", title) for title in titles}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_what_a_page_names_and_links_to_exists(page):
    text = page.read_text()
    for path, name in CODE.findall(text):
        assert (ROOT / path).exists(), path
        if name:
            assert re.search(rf"^(?:def|class) {name}\b", (ROOT / path).read_text(), re.M), f"{path}:{name}"
    for target in re.findall(r"\]\((?!https?:|#)([^)#\s]+)", text):
        assert (page.parent / target).exists(), target
    for target, heading in re.findall(r"\]\((?!https?:)([^)#\s]*)#([^)\s]+)\)", text):
        other = page.parent / target if target else page
        assert heading in anchors(other), f"{target}#{heading}"


@pytest.mark.parametrize("page", WRAPPED, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_prose_of_a_page_is_wrapped_at_120_columns(page):
    """Tables, blocks, pictures and single long words are not prose."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.M | re.S)
    words = r"(?:[^\s`]*`[^`]*`)+[^\s`]*|\S+"
    lines = [line for line in text.splitlines() if len(line) > 120 and not re.match(r"\||!\[| {4}|---|  - |#", line)]
    assert [line for line in lines if len(re.findall(words, line)) > 2] == []


def test_the_readme_shows_every_package():
    packages = {folder.parent.name for folder in (ROOT / "relight").glob("*/__init__.py")}
    block = next(text for text in (ROOT / "README.md").read_text().split("```") if "relight/core/" in text)
    assert {*re.findall(r"relight/(\w+)/", block)} == packages


def words(page: str) -> str:
    return " ".join((ROOT / page).read_text().split())


def test_numbers_that_stand_on_two_pages_agree():
    """The orderings of the README are those of the results, and the errors of the weights those of their card."""
    says = r"(\d+) of the (\d+) orderings .*? hold, (\d+) are reversed, (\d+) .*? and (\d+) open"
    told = re.search(says, words("README.md"))
    says = r"prints (\d+) orderings .*?\*\*(\d+) hold here, (\d+) are reversed, (\d+) are .*? and (\d+) are open"
    assert sorted(told.groups()) == sorted(re.search(says, words("docs/lab/results.md")).groups())
    card = dict(re.findall(r"name: (\w+), value: ([\d.]+)", words("relight/weights/README.md")))
    assert len(card) == 4
    for name, value in card.items():
        assert re.search(rf"{name} (has an error of )?{value}\b", words("docs/lab/weights.md")), name


CLAIMS = yaml.safe_load((ROOT / "docs" / "claims.yaml").read_text())
CLAIM_TOOL = runpy.run_path(str(ROOT / "tools" / "claims.py"))


def prose(page: str) -> str:
    """A page without code, addresses of links, and numbers of lists."""
    text = re.sub(r"^```.*?^```|`[^`]*`|(?<=\])\([^)]*\)|^\d+\. ", "", (ROOT / page).read_text(), flags=re.M | re.S)
    return " ".join(text.split())


@pytest.mark.parametrize("page", sorted({claim["page"] for claim in CLAIMS}))
def test_each_number_of_a_page_has_its_command_or_a_reason(page):
    """In docs/claims.yaml; a number that is changed by hand is in no claim. Of pages of docs, what was measured."""
    text, own = prose(page), [claim for claim in CLAIMS if claim["page"] == page]
    assert [claim["says"] for claim in own if claim["says"] not in text] == []
    assert [claim["says"] for claim in own if len(claim.keys() & {"show", "cells", "why"}) != 1] == []
    if page not in ("README.md", "docs/index.md"):
        return
    for claim in own:
        text = text.replace(claim["says"], "")
    assert [text[max(0, m.start() - 40) : m.end() + 20] for m in CLAIM_TOOL["NUMBER"].finditer(text)] == []


def test_tables_of_pages_have_a_line_below_the_head_and_as_many_cells_in_each_row():
    for page in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]:
        for table in re.findall(r"(?:^\|.*\n)+", page.read_text(), re.M):
            head, line, *rows = (re.sub(r"`[^`]*`|\\\|", "", row) for row in table.splitlines())
            assert re.fullmatch(r"[|\s:-]+", line), (page.name, line)
            assert [row for row in (line, *rows) if row.count("|") != head.count("|")] == [], page.name


@pytest.mark.parametrize(("says", "printed", "within", "agrees"), [
    ("had 29 % (19 to 39 %) less", "+29.4 %,+18.9 to +39 %", 0, True),
    ("had 29 % (19 to 39 %) less", "+29.4 %,+18.9 to +40 %", 0, False),
    ("had 29 % (19 to 39 %) less", "+29.4 %", 0, False),
    ("an error of .173", "0.1734", 0, True),
    ("an error of .173", "0.18", 0.05, True),
    ("4,000 steps on AVX2", "steps: 4000", 0, True),
])  # fmt: skip
def test_a_claim_agrees_up_to_its_last_digit_or_its_tolerance(says, printed, within, agrees):
    assert CLAIM_TOOL["agree"](says, CLAIM_TOOL["numbers"](printed), within) == agrees


@pytest.mark.slow
def test_the_first_hour_runs_and_prints_what_its_page_says(tmp_path, monkeypatch):
    """Words as they are, and numbers to a tenth, since the last digits are those of a machine."""
    monkeypatch.chdir(ROOT)
    run = runpy.run_path(str(ROOT / "tools" / "notebook.py"))["run"]
    page = (ROOT / "docs" / "first_hour.md").read_text()
    number = re.compile(r"-?\d[\d,]*\.?\d*")
    for cell, printed in run(page, tmp_path):
        if cell["output"] is not None:
            assert number.sub("#", printed).split() == number.sub("#", cell["output"]).split()
            texts = printed, cell["output"]
            found, told = ([float(n.replace(",", "")) for n in number.findall(text)] for text in texts)
            np.testing.assert_allclose(found, told, rtol=0.1, atol=0.05)
    shown = re.findall(r"\]\(images/(first_hour_\d\.jpg)\)", page)
    assert shown == sorted(path.name for path in tmp_path.iterdir()) and len(shown) == 8
