"""Hashes the code of relight that each rule runs, so that changed code makes its results again."""

import ast
import hashlib
import re
from collections.abc import Container, Iterable, Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from relight import extensions
from relight.settings import ROOT

# Modules on which no result depends: settings, whose values are recorded, messages, records, checked downloads and the
# start of processes.
WITHOUT_RESULTS = (
    "cli", "core.download", "core.errors", "core.files", "core.lazy", "core.libraries", "core.processes",
    "core.progress", "core.version", "lab.job", "lab.tracking", "settings",
)  # fmt: skip
# A rule, or a source of figures or lights -> modules that are imported for it, and used for others only.
UNUSED = {"align": ("meshes.read",), "generated": ("lights.place", "panoramas.polyhaven", "panoramas.read")}
SCRIPTS = ROOT / "workflow" / "scripts"


class Source(NamedTuple):
    """What counts of a file: a hash of it, and the files of relight that it imports or finds in its folder."""

    hash: str
    uses: list[Path]


def code_hash(rule: str, names: Iterable[str] = ()) -> str:
    """Returns a hash of the code of a rule: its script, the modules of relight that it imports, and their data.

    Comments, docstrings and the layout do not count, nor does the code of other packages.

    Args:
        rule: name of a script in workflow/scripts.
        names: of its network, losses and source. Those of extensions add the code of these.

    Returns:
        16 hexadecimal digits.
    """
    hashes = sorted((file.name, source(file).hash) for file in files_of(rule, names))
    return hashlib.sha256(repr(hashes).encode()).hexdigest()[:16]  # without folders: the same in every clone


def files_of(rule: str, names: Iterable[str]) -> set[Path]:
    """Returns the files that `code_hash` covers."""
    extended = filter(None, map(extension_file, sorted({*names} & {*extensions.names()})))
    unused = {path_of(f"relight.{module}") for key in (rule, *names) for module in UNUSED.get(key, ())}
    return closure([SCRIPTS / f"{rule}.py", *extended], unused)


def closure(files: Iterable[Path], unused: Container[Path | None] = ()) -> set[Path]:
    """Returns files with all files of relight that they use, also inside functions or through other modules.

    `unused` ones are left out, with what is used through them alone.
    """
    found: set[Path] = set()
    pending = [*files]
    while pending:
        file = pending.pop()
        if file not in found and file not in unused:
            found.add(file)
            pending += source(file).uses
    return found


@cache
def source(path: Path) -> Source:
    """Returns what counts of a Python file, or of data, all of whose bytes count."""
    content = path.read_bytes()
    if path.suffix != ".py":
        return Source(hashlib.sha256(content).hexdigest(), [])
    tree = ast.parse(content)
    modules = [*filter(None, map(path_of, _imported(tree))), *filter(Path.is_file, _relative(tree, path))]
    code = ast.dump(without_docstrings(tree)).encode()
    return Source(hashlib.sha256(code).hexdigest(), [*modules, *_data(path.parent)])


def _imported(tree: ast.AST) -> Iterator[str]:
    """Yields the full names of all that code imports for a result, so not for type checkers."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (_defining_module(node.module, alias.name) for alias in node.names)
        yield from _imported(node)


def _relative(tree: ast.AST, path: Path) -> Iterator[Path]:
    """Yields where the modules may be that a file imports relatively, as extensions import theirs."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
            yield from (base.with_suffix(".py"), base / "__init__.py", *(base / f"{a.name}.py" for a in node.names))


def _defining_module(module: str, name: str) -> str:
    """Returns the module that defines what `from module import name` imports.

    That is a module of this name in the package, or the module that the package's stub (.pyi) imports the name from,
    since packages import lazily, or else `module` itself.
    """
    if path_of(f"{module}.{name}"):
        return f"{module}.{name}"
    stub = ROOT.joinpath(*module.split("."), "__init__.pyi")
    if stub.exists():
        for node in ast.parse(stub.read_bytes()).body:
            if isinstance(node, ast.ImportFrom) and name in (alias.name for alias in node.names):
                return str(node.module)
    return module


@cache
def path_of(module: str) -> Path | None:
    """Returns the file of a module of relight; None for other modules, the package itself, and WITHOUT_RESULTS."""
    package, _, name = module.partition(".")
    if package != "relight" or not name or any(f"{name}.".startswith(f"{other}.") for other in WITHOUT_RESULTS):
        return None
    base = ROOT.joinpath(package, *name.split("."))
    return next((path for path in (base.with_suffix(".py"), base / "__init__.py") if path.is_file()), None)


@cache
def _data(folder: Path) -> list[Path]:
    """Returns the data of a subpackage: its files, and those of its folders without Python, such as templates."""
    if ROOT / "relight" not in folder.parents:
        return []
    found = [file for item in folder.iterdir() if not any(item.glob("*.py")) for file in (item, *item.rglob("*"))]
    apart = re.compile(r"/\.|/node_modules/|\.py\w?$").search
    return [file for file in found if file.is_file() and not apart(str(file.relative_to(folder.parent)))]


def extension_file(name: str) -> Path | None:
    """Returns the file of an extension, or None if it cannot be found without importing it."""
    spec = find_spec(extensions.installed().get(name, f"{extensions.__name__}.{name}"))
    return Path(spec.origin) if spec and spec.origin else None


def without_docstrings(tree: ast.AST) -> ast.AST:
    """Removes the docstrings of a module, its classes and functions in place, and returns it."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            if ast.get_docstring(node, clean=False) is not None:
                node.body = node.body[1:] or [ast.Pass()]
    return tree
