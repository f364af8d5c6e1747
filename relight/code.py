"""Hashes the code that each stage runs, so that changed code makes its results again."""

import ast
import hashlib
import io
import json
import tokenize
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from relight import extensions
from relight.config import ROOT
from relight.errors import UserError
from relight.files import atomic_write

PACKAGE = "relight"
# Modules on which no result depends: settings, whose values are recorded, messages, records and the start of processes.
WITHOUT_RESULTS = ("cli", "config", "errors", "files", "lazy", "processes", "progress", "stages.stage", "tracking")
CACHE = Path(".snakemake", "relight.code.json")


class Source(NamedTuple):
    """What counts of a file: a hash of its content, and the modules of relight that it imports."""

    hash: str
    imports: list[str]


def code_hash(stage: str, words: frozenset[str] = frozenset()) -> str:
    """Returns a hash of the code of a stage: its module, the modules of relight that it imports, and their data.

    Comments, docstrings and blank lines do not count, nor does the code of other packages.

    Args:
        stage: name of a module in `relight.stages`.
        words: words of its settings. Those that name extensions add the code of these.
    """
    files = {file for name in closure(f"{PACKAGE}.stages.{stage}") for file in files_of(name)}
    files |= {file for name in words & {*extensions.names()} if (file := extension_file(name))}
    digest = hashlib.sha256()
    for name, content in sorted((file.name, source(file).hash) for file in files):  # the same in every folder
        digest.update(f"{name}\0{content}\0".encode())
    return digest.hexdigest()[:16]


def closure(name: str) -> set[str]:
    """Returns the modules that a module imports, in functions too, and those that these import, with itself."""
    modules: set[str] = set()
    pending = [name]
    while pending:
        module = pending.pop()
        path = path_of(module)
        if path and module not in modules and not _has_no_results(module):
            modules.add(module)
            pending.extend(source(path).imports)
    return modules


def _has_no_results(module: str) -> bool:
    return module == PACKAGE or any(f"{module}.".startswith(f"{PACKAGE}.{name}.") for name in WITHOUT_RESULTS)


@cache
def source(path: Path) -> Source:
    """Returns what counts of a file. It is kept in the cache, since 250 files take seconds, until the file changes."""
    key, state = str(path), [path.stat().st_mtime_ns, path.stat().st_size]
    if key in (kept := cached()) and kept[key][0] == state:
        return Source(*kept[key][1:])
    content, modules = path.read_bytes(), set[str]()
    if path.suffix == ".py":
        tree = ast.parse(content)
        modules = set(_imported(tree))
        content = stripped(content.decode(), tree).encode()
    kept[key] = [state, hashlib.sha256(content).hexdigest(), sorted(modules)]
    return Source(*kept[key][1:])


@cache
def cached() -> dict[str, list]:
    """Returns the entries of the cache; a damaged one is empty."""
    with suppress(OSError, ValueError):
        if isinstance(kept := json.loads((ROOT / CACHE).read_text()), dict):
            return kept
    return {}


def save_cache() -> None:
    """Writes the cache, where its folder exists and can be written."""
    if (ROOT / CACHE).parent.is_dir():
        with suppress(UserError), atomic_write(ROOT / CACHE) as tmp:
            tmp.write_text(json.dumps(cached()))


def _imported(tree: ast.AST) -> Iterator[str]:
    """Yields the modules of relight that code imports; not those for type checkers only."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.expr):
            continue
        if isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.split(".")[0] == PACKAGE)
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == PACKAGE:
            yield from (_defining_module(str(node.module), alias.name) for alias in node.names)
        yield from _imported(node)


def _defining_module(module: str, name: str) -> str:
    """Returns the module that `from module import name` runs: itself, a module in it, or the one its stub names."""
    if path_of(f"{module}.{name}"):
        return f"{module}.{name}"
    path = path_of(module)
    stub = path.with_suffix(".pyi") if path else None
    if stub and stub.exists():
        for node in ast.parse(stub.read_bytes()).body:
            if isinstance(node, ast.ImportFrom) and name in (alias.name for alias in node.names):
                return str(node.module)
    return module


@cache
def path_of(name: str) -> Path | None:
    """Returns the file of a module of relight, or None if there is no such module."""
    base = ROOT.joinpath(*name.split("."))
    return next((path for path in (base.with_suffix(".py"), base / "__init__.py") if path.is_file()), None)


def files_of(name: str) -> list[Path]:
    """Returns the file of a module and, in a subpackage, its data: the other files of its folder.

    Folders in it that hold no Python count too, such as those of templates; hidden files and packages of npm do not.
    """
    path = path_of(name)
    if not path or path.parent == ROOT / PACKAGE:  # whose other folders, such as weights, are inputs of rules
        return [path] if path else []
    found = [path]
    for item in sorted(path.parent.iterdir()):
        if item.is_file():
            found.append(item)
        elif item.name not in ("__pycache__", "node_modules") and not any(item.glob("*.py")):
            found += [file for file in item.rglob("*") if file.is_file() and "node_modules" not in file.parts]
    data = [file for file in found[1:] if file.suffix not in (".py", ".pyi", ".pyc") and not file.name.startswith(".")]
    return [path, *data]


def extension_file(name: str) -> Path | None:
    """Returns the file of an extension, or None if it cannot be found without importing it."""
    spec = find_spec(extensions.installed().get(name, f"{extensions.__name__}.{name}"))
    return Path(spec.origin) if spec and spec.origin else None


def stripped(source: str, tree: ast.Module | None = None) -> str:
    r"""Returns Python source without comments, docstrings and blank lines; strings are kept as they are.

    Args:
        source: code.
        tree: its syntax tree, if it is known.

    >>> stripped('x = "# a  b"  # one\n\ndef f():\n    "Returns one."\n    return 1\n')
    'x = "# a  b"\ndef f():\n    return 1'
    """
    lines = source.splitlines()
    tokens = list(tokenize.generate_tokens(io.StringIO(source).readline))
    for token in tokens:
        if token.type == tokenize.COMMENT:
            row, column = token.start
            lines[row - 1] = lines[row - 1][:column].rstrip()
    dropped = {
        token.start[0] for token in tokens if token.type == tokenize.NL and not lines[token.start[0] - 1].strip()
    }
    for node in ast.walk(tree or ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            if ast.get_docstring(node, clean=False) is not None:
                first, last = node.body[0].lineno, int(node.body[0].end_lineno or 0)
                alone = lines[first - 1].lstrip(" rR")[:1] in ("'", '"') and lines[last - 1][-1:] in ("'", '"')
                dropped |= set(range(first, last + 1)) if alone else set()
    return "\n".join(line for row, line in enumerate(lines, 1) if row not in dropped)
