"""Each shell line of the README and the site is run, checked against the command line, or listed as not run."""

import ast
import re
import shlex
import tomllib
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import trimesh
import typer
from PIL import Image

from relight.cli import app
from relight.lab.record import expand_sweep
from relight.settings import composed
from relight.settings.schema import FIELDS

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted([ROOT / "README.md", ROOT / ".github" / "CONTRIBUTING.md", *DOCS.glob("*.md"), *DOCS.glob("lab/*.md")])
PAGES.remove(DOCS / "changelog.md")  # it tells of commands that are gone
# Not run by any test, with the reason. What is checked of the others is in `check`.
NOT_RUN = {
    "pip install": "it installs packages, some of them from the network",
    "uv sync": "it installs packages from the network",
    "torchrun": "it needs several GPUs",
    "snakemake": "by hand; tests/workflow runs Snakemake by the same rules",
    "relight light setup": "it downloads panoramas",
    "relight run experiment=batch": "the page shows how this preset is written",
}
PLACEHOLDER = re.compile(r"\.\.\.|<\w+>|\b[A-Z]{4,}\b")  # a line with one shows the form of a command


def shell_lines(page: Path) -> list[str]:
    """Returns the commands of a page's blocks, without comments, and of its code spans that begin with relight."""
    text = page.read_text()
    fenced = [block for kind, block in re.findall(r"^```(\w*)\n(.*?)^```$", text, re.M | re.S) if kind in ("", "sh")]
    plain = re.sub(r"^```.*?^```$", "", text, flags=re.M | re.S)
    blocks = [*fenced, *(line[4:] for line in plain.splitlines() if line.startswith("    "))]
    lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    lines += re.findall(r"`(relight (?:run|light|bake|photo|view|figures) [^`]*[.:=][^`]*)`", plain)
    programs = ("relight", "make", "python", *{words.split()[0] for words in NOT_RUN})
    lines = [re.sub(r"^(?:[A-Z_]+=\S+ )+", "", re.sub(r"\s+# .*$", "", line)).strip() for line in lines]
    return [line for line in dict.fromkeys(lines) if re.match(rf"(?:{'|'.join(programs)})(?:[ -]|$)", line)]


def parse(words: list[str]) -> None:
    """Parses the words of a `relight` command as the command line does; raises click's error if it would."""
    command = typer.main.get_command(app)
    context = command.make_context("relight", words[1:])
    while hasattr(command, "resolve_command"):
        name, command, rest = command.resolve_command(context, [*context._protected_args, *context.args])
        context = command.make_context(name, rest, parent=context)


def check(line: str) -> None:
    """Checks that a command exists and accepts its words, and that settings compose; runs nothing."""
    words = shlex.split(line)
    if any(line.startswith(known) for known in NOT_RUN):
        return
    if words[0] == "relight":
        parse(words)
        overrides = [word for word in words[2:] if re.match(r"[\w.@+]+=", word)]
        fixed, runs = expand_sweep(overrides) if "-m" in words else (overrides, {"": []})
        for run in runs.values() if words[1] == "run" else ():
            composed([*fixed, *run])
    elif words[0] == "make":
        target = next((word for word in words[1:] if "=" not in word), "all")
        assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), re.M)
    elif words[0] == "python":
        assert words[1] == "-c" or (find_spec(words[2]) if words[1] == "-m" else (ROOT / words[1]).exists())
    else:
        raise AssertionError("it is neither run nor listed")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
@pytest.mark.slow
def test_every_shell_line_is_accepted_or_listed_as_not_run(page):
    for line in shell_lines(page):
        if not PLACEHOLDER.search(line):
            try:
                check(line)
            except Exception as error:
                raise AssertionError(f"{line}: {error!r}") from error


def test_what_is_listed_as_not_run_stands_on_a_page():
    lines = [line for page in PAGES for line in shell_lines(page)]
    assert [known for known in NOT_RUN if not any(line.startswith(known) for line in lines)] == []


@pytest.mark.parametrize("line", ["relight bakes a.obj", "relight bake --ray 3 a.obj", "relight run trian.lr=1",
                                  "make al", "python -m relight.no"])  # fmt: skip
def test_a_wrong_line_is_noticed(line):
    with pytest.raises(Exception, match=r"No such|trian|neither|assert|None"):
        check(line)


UNFINISHED = ("MissingParameter", "NoArgsIsHelpError", "BadOptionUsage", "Exit")  # of a command alone, or of --help


def texts(tree: ast.AST) -> Iterator[str]:
    """Yields the strings of a module; what they fill in is X."""
    parts = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            yield "".join(part.value if isinstance(part, ast.Constant) else "X" for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in parts:
            yield node.value


def advice(text: str) -> Iterator[str]:
    """Yields the commands, extras and settings that a text names."""
    commands = "|".join(typer.main.get_command(app).commands)
    yield from re.findall(rf"`(relight (?:{commands})\b[^`]*)`", text)
    yield from re.findall(rf"(?<!`)relight (?:{commands})(?= --[a-z]| -[a-z]\b)(?: -[\w-]+)?", text)
    yield from re.findall(r"pip install '\.\[\w+\]'", text)
    groups = "|".join([*{key.partition(".")[0] for key in FIELDS if "." in key}, "experiment", "scale"])
    yield from re.findall(rf"(?<![\w.-])(?:{groups})(?:\.[a-z_]+)?=\w+", text)


def heed(advised: str) -> None:
    """Raises an error if what a text names is not there."""
    name, _, value = advised.partition("=")
    if advised.startswith("pip"):
        extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
        assert "X" in advised or advised.split("[")[1].split("]")[0] in extras
    elif advised.startswith("relight"):
        try:
            parse(shlex.split(advised))
        except Exception as error:
            if type(error).__name__ not in UNFINISHED:
                raise
    elif "." in name:
        assert name in FIELDS
    elif value != "X" and name in ("experiment", "loss", "model", "scale", "split", "train"):
        assert (ROOT / "conf" / name / f"{value}.yaml").is_file()


MODULES = sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "relight").rglob("*.py"))


@pytest.mark.parametrize("module", MODULES)
def test_what_messages_advise_is_there(module):
    for text in texts(ast.parse((ROOT / module).read_text())):
        for advised in advice(text):
            try:
                heed(advised)
            except Exception as error:
                raise AssertionError(f"{advised}: {error!r}") from error


@pytest.mark.parametrize("text", [
    "run `relight mask sets`", "`relight photo --lights a`", "see relight light --lay", "pip install '.[vide]'",
    "give train.batches=4", "give loss=fully", "experiment=two",
])  # fmt: skip
def test_advice_that_misleads_is_noticed(text):
    (advised,) = advice(text)
    with pytest.raises(Exception, match=r"No such|assert"):
        heed(advised)


@pytest.fixture
def inputs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, (height, width) in {"kitchen.hdr": (8, 16), "kitchen.exr": (8, 16), "grace_probe.hdr": (8, 8)}.items():
        codes = np.random.default_rng(1).integers(60, 200, (height, width, 4), np.uint8)
        codes[..., 3] = 129
        header = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n"
        Path(name).write_bytes(header.encode() + codes.tobytes())
    np.save("probe.npy", np.eye(9, 3))
    Image.new("RGB", (40, 30), "tan").save("street.jpg")
    body = trimesh.creation.capsule(height=1.2, radius=0.3, count=[12, 12])
    for name in ("scan.obj", "scan.glb", "room.ply"):
        body.export(name)
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("page", ["lights", "transport"])
def test_the_lines_about_lights_and_baking_run(page, inputs, capsys):
    """With a few rays and pixels: the last of two equal options counts."""
    lines = [line for line in shell_lines(DOCS / f"{page}.md") if re.match("relight (light|bake) ", line)]
    lines = [line for line in lines if not line.startswith(tuple(NOT_RUN))]
    assert len(lines) >= 4
    for line in lines:
        words = shlex.split(line)[1:]
        quick = ["--rays", "16", "--size", "64"] if words[0] == "bake" and "room.npz" not in words else []
        app([*words, *quick], standalone_mode=False)
        written = [word for word in words if word.endswith((".png", ".npz", ".exr")) and word not in ("kitchen.exr",)]
        assert all(Path(word).stat().st_size for word in written)
