"""What journals, archives, hubs, catalogues and the hosting site read is there, and says the same everywhere."""

import json
import re
import tomllib
from pathlib import Path

import pytest
import yaml

import relight

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def front_matter(path: Path) -> tuple[dict, str]:
    _, header, text = path.read_text().split("---\n", 2)
    return yaml.safe_load(header), text


def lacking(content: dict, fields: str) -> list[str]:
    return [key for key in fields.split() if not content.get(key)]


CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text())
ZENODO = json.loads((ROOT / ".zenodo.json").read_text())
CODEMETA = json.loads((ROOT / "codemeta.json").read_text())
HEADER, PAPER = front_matter(ROOT / "docs" / "joss" / "paper.md")
BIBLIOGRAPHY = (ROOT / "docs" / "joss" / HEADER["bibliography"]).read_text()
CATALOGUE = yaml.safe_load((ROOT / ".snakemake-workflow-catalog.yml").read_text())
SAME = ("title", "version", "license", "keywords")
SECTIONS = ["Summary", "Statement of need", "State of the field", "Software design", "Research impact statement"]
SECTIONS += ["AI usage disclosure", "Acknowledgements", "References"]
# what a file says, and what it must say
CLAIMS = {
    "fields of the paper": (lacking(HEADER, "title tags authors affiliations date bibliography"), []),
    "sections of the paper": (re.findall(r"^# (.+)$", PAPER, re.M), SECTIONS),
    "length of the paper": (750 <= len(PAPER.split()) <= 1750, True),
    "references": ({*re.findall(r"@(\w+)", PAPER)}, {*re.findall(r"^@\w+\{(\w+),", BIBLIOGRAPHY, re.M)}),
    # The journal's robot walks the folders by name and takes the first paper.md.
    "place of the paper": (min(ROOT.glob("[a-z]*/**/paper.md")), ROOT / "docs" / "joss" / "paper.md"),
    "fields of the citation": (
        lacking(CITATION, "cff-version message title abstract license date-released type"), []),
    "authors": (CITATION["authors"], [{"name": author["name"]} for author in PROJECT["authors"]]),
    "version": (CITATION["version"], relight.__version__),
    "keywords": ({*CITATION["keywords"]} - {*PROJECT["keywords"]}, set()),
    "fields of the archive": (
        lacking(ZENODO, "upload_type access_right description publication_date creators related_identifiers"), []),
    "archive and citation": ([ZENODO[key] for key in SAME], [CITATION[key] for key in SAME]),
    "authors of the archive": (ZENODO["creators"], CITATION["authors"]),
    "date of the archive": (ZENODO["publication_date"], str(CITATION["date-released"])),
    "codemeta and citation": (
        [CODEMETA[key] for key in ("name", "version", "keywords", "description", "datePublished")],
        [CITATION["title"], CITATION["version"], CITATION["keywords"], " ".join(CITATION["abstract"].split()),
         str(CITATION["date-released"])]),
    "licence of codemeta": (CODEMETA["license"], f"https://spdx.org/licenses/{PROJECT['license']}"),
    "Pythons of codemeta": (
        CODEMETA["runtimePlatform"].split()[1::2],
        [name.rsplit(" ", 1)[1] for name in PROJECT["classifiers"] if ":: Python :: 3." in name][::2]),
    "the paper's method": (ZENODO["related_identifiers"][0]["identifier"], CITATION["references"][0]["doi"]),
    "fields of the catalogue": (lacking(CATALOGUE["usage"], "software-stack-deployment report mandatory-flags"), []),
    "files": (
        [name for name in (*PROJECT["license-files"], "relight/py.typed", "workflow/Snakefile", "config/README.md")
         if not (ROOT / name).is_file()], []),
}  # fmt: skip


@pytest.mark.parametrize("claim", CLAIMS)
def test_journals_archives_and_catalogues_read_the_same(claim):
    said, right = CLAIMS[claim]
    assert said == right


def test_card_of_the_weights_has_what_a_hub_and_an_open_model_ask_for():
    header, text = front_matter(ROOT / "relight" / "weights" / "README.md")
    assert [key for key in "license library_name pipeline_tag tags model-index".split() if not header.get(key)] == []
    metrics = {metric["name"]: metric["value"] for metric in header["model-index"][0]["results"][0]["metrics"]}
    names, values = re.search(r"^\| (shading .+) \|\n\|[-|]+\|\n\| (.+) \|", text, re.M).groups()
    assert metrics == dict(zip(names.split(" | "), map(float, values.split(" | "))))
    asked = ["licence of the weights", "training data", "provenance of the data", "licence of the data"]
    asked += ["training code", "Open Source AI Definition 1.0", "Model Openness Framework", "published research"]
    asked += ["reproducibility"]
    assert [row for row in asked if f"| {row} |" not in text] == [] and "Limits:" in text


def test_readme_of_a_site_has_what_a_static_space_asks_for():
    header, text = front_matter(ROOT / "relight" / "viewer" / "web" / "studio" / "space.md")
    assert header["title"] and header["sdk"] == "static" and header["app_file"] == "index.html"
    colors = "red yellow green blue indigo purple pink gray".split()
    assert header["colorFrom"] in colors and header["colorTo"] in colors
    assert len(header["emoji"]) == 1 and header["pinned"] is False and len(header["short_description"]) <= 60
    assert header["license"] == PROJECT["license"].lower() and "LICENSES.txt" in text
