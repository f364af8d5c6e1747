"""What journals, archives, hubs, catalogues and the hosting site read is there, and says the same everywhere."""

import json
import re
import subprocess
import tomllib
from pathlib import Path

import pytest
import yaml

import relight
from relight.viewer.site import readme

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text())
ZENODO = json.loads((ROOT / ".zenodo.json").read_text())
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
JOSS = "title tags authors affiliations date bibliography".split()
SECTIONS = ["Summary", "Statement of need", "State of the field", "Software design", "Research impact statement"]
SECTIONS += ["AI usage disclosure", "Acknowledgements", "References"]


def front_matter(path: Path) -> tuple[dict, str]:
    """Returns the YAML header of a page, and the rest."""
    _, header, text = path.read_text().split("---\n", 2)
    return yaml.safe_load(header), text


def test_paper_has_the_fields_and_sections_of_joss():
    header, text = front_matter(ROOT / "docs" / "joss" / "paper.md")
    assert [key for key in JOSS if not header.get(key)] == []
    indices = {str(item["index"]) for item in header["affiliations"]}
    assert all(str(author["affiliation"]) in indices for author in header["authors"])
    assert re.findall(r"^# (.+)$", text, re.M) == SECTIONS
    assert 750 <= len(text.split()) <= 1750


def test_paper_cites_what_its_bibliography_holds():
    header, text = front_matter(ROOT / "docs" / "joss" / "paper.md")
    entries = re.findall(r"^@\w+\{(\w+),", (ROOT / "docs" / "joss" / header["bibliography"]).read_text(), re.M)
    assert len(entries) == len(set(entries)) and set(re.findall(r"@(\w+)", text)) == set(entries)


def test_paper_is_the_first_of_its_name_as_the_journal_looks_for_it():
    """Its robot walks the folders by name and takes the first paper.md; docs/method.md is another page."""
    places = [path.relative_to(ROOT).parts for path in ROOT.glob("[a-z]*/**/paper.md")]
    assert min(places) == ("docs", "joss", "paper.md")


def test_citation_has_the_required_and_the_helpful_fields():
    fields = "cff-version message title authors abstract keywords license version date-released type"
    assert [key for key in fields.split() if not CITATION.get(key)] == []
    assert CITATION["authors"] == [{"name": author["name"]} for author in PROJECT["authors"]]
    assert CITATION["version"] == relight.__version__


def test_archive_gets_what_the_citation_says():
    fields = "title upload_type access_right license version publication_date creators description keywords"
    assert [key for key in fields.split() if not ZENODO.get(key)] == []
    for mine, theirs in (("title", "title"), ("version", "version"), ("license", "license"), ("keywords", "keywords")):
        assert ZENODO[mine] == CITATION[theirs]
    assert ZENODO["publication_date"] == str(CITATION["date-released"]) and ZENODO["creators"] == CITATION["authors"]
    assert ZENODO["related_identifiers"][0]["identifier"] == CITATION["references"][0]["doi"]


def test_package_has_authors_keywords_classifiers_and_its_licences():
    assert {*CITATION["keywords"]} <= {*PROJECT["keywords"]}
    known = [line.rpartition(" :: ")[2] for line in PROJECT["classifiers"] if "Python :: 3." in line]
    lowest, highest = re.findall(r"3\.(\d+)", PROJECT["requires-python"])
    assert known == [f"3.{minor}" for minor in range(int(lowest), int(highest))]
    assert all((ROOT / name).is_file() for name in PROJECT["license-files"])
    assert (ROOT / "relight" / "py.typed").is_file()


def test_card_of_the_weights_has_what_a_hub_and_an_open_model_ask_for():
    header, text = front_matter(ROOT / "relight" / "weights" / "README.md")
    assert [key for key in "license library_name pipeline_tag tags model-index".split() if not header.get(key)] == []
    metrics = {metric["name"]: metric["value"] for metric in header["model-index"][0]["results"][0]["metrics"]}
    names, values = re.search(r"^\| (shading .+) \|\n\|[-|]+\|\n\| (.+) \|", text, re.M).groups()
    assert metrics == dict(zip(names.split(" | "), map(float, values.split(" | "))))
    asked = [
        "licence of the weights",
        "training data",
        "provenance of the data",
        "licence of the data",
        "training code",
    ]
    asked += ["Open Source AI Definition 1.0", "Model Openness Framework", "published research", "reproducibility"]
    assert [row for row in asked if f"| {row} |" not in text] == [] and "Limits:" in text


@pytest.mark.parametrize("title", ["Turn the light in a photo", 'My "light": #1\n---\nsdk: gradio \\ \u00e9'])
def test_readme_of_a_site_has_what_a_static_space_asks_for(tmp_path, title):
    (tmp_path / "README.md").write_text(readme(title))
    header, text = front_matter(tmp_path / "README.md")
    assert header["title"] == title and header["sdk"] == "static" and header["app_file"] == "index.html"
    colors = "red yellow green blue indigo purple pink gray".split()
    assert header["colorFrom"] in colors and header["colorTo"] in colors
    assert len(header["emoji"]) == 1 and header["pinned"] is False and len(header["short_description"]) <= 60
    assert header["license"] == PROJECT["license"].lower() and "LICENSES.txt" in text


def test_weights_and_generated_data_have_one_licence():
    header, _ = front_matter(ROOT / "relight" / "weights" / "README.md")
    assert header["license"] == "cc0-1.0"
    notice = " ".join((ROOT / "NOTICE").read_text().split())
    assert re.search(
        r"weights in relight/weights, and all that relight generates \([^)]+\), are under CC0 1\.0", notice
    )
    for page in ("README.md", "docs/index.md", "docs/figures.md"):
        sentences = re.findall(r"[^.]*\bCC0(?:-1\.0)?\b[^.]*", (ROOT / page).read_text())
        assert any("all that relight generates" in " ".join(sentence.split()) for sentence in sentences), page


def test_catalogue_of_workflows_finds_its_files():
    assert (ROOT / "workflow" / "Snakefile").is_file() and (ROOT / "config" / "README.md").is_file()
    assert list((ROOT / "workflow" / "rules").glob("*.smk"))
    usage = yaml.safe_load((ROOT / ".snakemake-workflow-catalog.yml").read_text())["usage"]
    assert {"software-stack-deployment", "report", "mandatory-flags"} <= usage.keys()
    readme = (ROOT / "README.md").read_text().lower()
    assert "snakemake" in readme and "workflow" in readme


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflows_of_the_hosting_site_only_call_make(path):
    workflow = yaml.safe_load(path.read_text())
    assert workflow["permissions"] == {"contents": "read"}
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.M)
    (job,) = workflow["jobs"].values()
    for step in job["steps"]:
        if "run" in step:
            program, target = step["run"].split()
            assert program == "make" and target in targets
        else:
            assert re.fullmatch(r"actions/[\w-]+@v\d+", step["uses"])


def test_commits_are_checked_by_the_tools_of_make_lint():
    (local,) = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"]
    assert local["repo"] == "local"
    entry = re.compile(r"\.venv/bin/(\w+)(?: (\w+))?(?: --force-exclude)?")
    tools = [entry.fullmatch(hook["entry"]).groups() for hook in local["hooks"]]
    lint = re.search(r"^lint:.*\n((?:\t.*\n)+)", (ROOT / "Makefile").read_text(), re.M)[1]
    assert tools == [("ruff", "check"), ("ruff", "format"), ("mypy", None)]
    assert all(" ".join(word for word in tool if word) in lint.replace("$(BIN)/", "") for tool in tools)


def test_root_has_at_most_26_entries():
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("not a clone")
    assert len({line.split("/")[0] for line in listed.stdout.splitlines()}) <= 26
