"""Hashes the code of relight that each rule runs, so that changed code makes its results again."""

import ast
import hashlib
import json
from collections.abc import Iterable, Iterator
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from relight import extensions
from relight.core.errors import UserError
from relight.core.files import atomic_write
from relight.settings import ROOT

PACKAGE = "relight"
# Modules on which no result depends: settings, whose values are recorded, messages, records and the start of processes.
WITHOUT_RESULTS = (
    "cli", "core.errors", "core.files", "core.lazy", "core.libraries", "core.processes", "core.progress",
    "core.version", "lab.job", "lab.tracking", "settings",
)  # fmt: skip
SCRIPTS = ROOT / "workflow" / "scripts"
CACHE = Path(".snakemake", "relight.code.json")


class Source(NamedTuple):
    """What counts of a file: a hash of its content without comments, and the modules of relight that it imports."""

    hash: str
    imports: list[str]


def code_hash(rule: str, names: Iterable[str] = ()) -> str:
    """Returns a hash of the code of a rule: the modules of relight that its script imports, and their data.

    Comments, docstrings and the layout do not count, nor does the code of other packages. The text of the script is a
    trigger of Snakemake's own.

    Args:
        rule: name of a script in workflow/scripts.
        names: of its network, losses and figures. Those of extensions add the code of these.

    Returns:
        16 hexadecimal digits.
    """
    modules = closure(source(SCRIPTS / f"{rule}.py").imports)
    files = {file for module in modules for file in files_of(module)}
    files |= {file for name in {*names} & {*extensions.names()} if (file := extension_file(name))}
    digest = hashlib.sha256()
    for name, content in sorted((file.name, source(file).hash) for file in files):  # the same in every folder
        digest.update(f"{name}\0{content}\0".encode())
    return digest.hexdigest()[:16]


def closure(names: Iterable[str]) -> set[str]:
    """Returns modules and all modules of relight that they import, also inside functions or through other modules.

    Those WITHOUT_RESULTS are left out, with what only they import. `names` are full: relight.transport.baker.
    """
    modules: set[str] = set()
    pending = [*names]
    while pending:
        module = pending.pop()
        path = path_of(module)
        if path and module not in modules and not _has_no_results(module):
            modules.add(module)
            pending.extend(source(path).imports)
    return modules


def _has_no_results(module: str) -> bool:
    """Returns whether no result depends on a module: the package itself, and WITHOUT_RESULTS with their submodules."""
    return module == PACKAGE or any(f"{module}.".startswith(f"{PACKAGE}.{name}.") for name in WITHOUT_RESULTS)


@cache
def source(path: Path) -> Source:
    """Returns what counts of a file, from the cache unless the file has changed, since parsing 250 files takes seconds.

    Args:
        path: a Python file, or data, all of whose bytes count.
    """
    entries, key = cached(), str(path)
    state = [path.stat().st_mtime_ns, path.stat().st_size]
    if key in entries:
        known_state, content_hash, modules = entries[key]
        if known_state == state:
            return Source(content_hash, modules)
    content, modules = path.read_bytes(), []
    if path.suffix == ".py":
        modules = sorted(set(_imported(ast.parse(content))))
        content = without_comments(content.decode()).encode()
    content_hash = hashlib.sha256(content).hexdigest()
    entries[key] = [state, content_hash, modules]
    return Source(content_hash, modules)


@cache
def cached() -> dict[str, list[Any]]:
    """Reads the cache of `source`, once; `source` adds to the same dictionary, and `save_cache` writes it.

    Returns:
        path of a file -> [[date in ns, size in bytes], hash, imported modules]; empty if there is no cache or it is
        damaged.
    """
    with suppress(OSError, ValueError):
        if isinstance(entries := json.loads((ROOT / CACHE).read_text()), dict):
            return entries
    return {}


def save_cache() -> None:
    """Writes the cache of `source`, where its folder exists and can be written."""
    if (ROOT / CACHE).parent.is_dir():
        with suppress(UserError), atomic_write(ROOT / CACHE) as tmp:
            tmp.write_text(json.dumps(cached()))


def _imported(tree: ast.AST) -> Iterator[str]:
    """Yields the full names of the modules of relight that code imports, except imports for type checkers only."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.split(".")[0] == PACKAGE)
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == PACKAGE:
            yield from (_defining_module(str(node.module), alias.name) for alias in node.names)
        yield from _imported(node)


def _defining_module(module: str, name: str) -> str:
    """Returns the module that defines what `from module import name` imports.

    That is a module of this name in the package, or the module that the package's stub (.pyi) imports the name from,
    since packages import lazily, or else `module` itself.
    """
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
    if path is None:
        return []
    if path.parent == ROOT / PACKAGE:  # whose other folders, such as weights, are inputs of rules
        return [path]
    files = [path]
    for item in sorted(path.parent.iterdir()):
        if item.is_file():
            files.append(item)
        elif item.name not in ("__pycache__", "node_modules") and not any(item.glob("*.py")):
            files += [file for file in item.rglob("*") if file.is_file() and "node_modules" not in file.parts]
    data = [file for file in files[1:] if file.suffix not in (".py", ".pyi", ".pyc") and not file.name.startswith(".")]
    return [path, *data]


def extension_file(name: str) -> Path | None:
    """Returns the file of an extension, or None if it cannot be found without importing it."""
    spec = find_spec(extensions.installed().get(name, f"{extensions.__name__}.{name}"))
    return Path(spec.origin) if spec and spec.origin else None


def without_comments(source: str) -> str:
    r"""Returns Python source in one layout, without comments and docstrings; strings are kept as they are.

    >>> without_comments('x = "# a  b"  # one\ndef f(): \n  "Returns one."\n  return (1)\n')
    "x = '# a  b'\n\ndef f():\n    return 1"
    """
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            if ast.get_docstring(node, clean=False) is not None:
                node.body = node.body[1:] or [ast.Pass()]
    return ast.unparse(tree)
