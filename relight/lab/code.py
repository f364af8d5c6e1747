"""Hashes of the code of relight that a job has run, so that changed code makes its results again."""

import ast
import hashlib
import re
import sys
import time
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from relight import extensions
from relight.settings import ROOT

# Modules on which no result depends: settings, whose values are recorded, messages, records, checked downloads and the
# start of processes.
WITHOUT_RESULTS = re.compile(
    r"relight(\.(cli|core\.(download|errors|files|lazy|libraries|processes|progress|version)|extensions"
    r"|lab(\.(?!page|training).*)?|settings(\..*)?))?"
)
DOCUMENTED = ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef
BEGUN = time.time()


def code_of(rule: str) -> dict[str, str]:
    """Returns the `code_hash` of a rule's script, and of all that this process has imported.

    They are modules of relight, and of the packages of extensions.
    """
    packages = {"relight", *(module.partition(".")[0] for module in extensions.installed().values())}
    imported = {name for name in [*sys.modules] if name.partition(".")[0] in packages}
    found = {name for name in imported if not WITHOUT_RESULTS.fullmatch(name)}
    return {name: code_hash(name) for name in sorted({*found, f"workflow.scripts.{rule}"})}


@cache
def code_hash(module: str) -> str:
    """Returns a hash of a module, and of the data beside it if it is a package of relight; "" if there is none.

    Comments, docstrings and the layout do not count. Of a module that was edited since this process began, it is "".
    """
    base = ROOT.joinpath(*module.split("."))
    path = next((file for file in (base.with_suffix(".py"), base / "__init__.py") if file.is_file()), None)
    if path is None:
        with suppress(ModuleNotFoundError):
            path = Path(getattr(find_spec(module), "origin", None) or "")
    if path is None or not path.is_file() or BEGUN < path.stat().st_mtime < time.time():
        return ""
    content = path.read_bytes()
    parts = [syntax(ast.parse(content)) if path.suffix == ".py" else content.hex()]
    if path == base / "__init__.py":
        parts += [f"{file.relative_to(base)} {hashlib.sha256(file.read_bytes()).hexdigest()}" for file in data(base)]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]


def data(package: Path) -> list[Path]:
    """Returns the files of a package that are no code, and those of its folders without Python, such as templates."""
    found = [file for item in package.iterdir() if not any(item.glob("*.py")) for file in (item, *item.rglob("*"))]
    apart = re.compile(r"/\.|/node_modules/|\.py\w?$").search
    return sorted(file for file in found if file.is_file() and not apart(str(file.relative_to(package.parent))))


def syntax(node: Any) -> str:
    """Returns a syntax tree as text, alike in all versions of Python, without docstrings, positions and empty lists."""
    if isinstance(node, list):
        return f"[{','.join(map(syntax, node))}]"
    if not isinstance(node, ast.AST):
        return ascii(node)  # in which, unlike repr, the version of Unicode does not count
    fields = dict(ast.iter_fields(node))
    if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
        fields["body"] = fields["body"][1:]
    if isinstance(node, ast.JoinedStr):  # Python 3.12 has empty parts
        fields["values"] = [part for part in node.values if not (isinstance(part, ast.Constant) and part.value == "")]
    parts = [f"{name}={syntax(value)}" for name, value in fields.items() if value != []]
    return f"{type(node).__name__}({','.join(parts)})"
