"""One script from ES modules, so that a page can be opened from disk: browsers refuse to import modules from there."""

import re
from pathlib import Path

IMPORT = re.compile(r'^import \{ ([^}]+) \} from "(\.\.?/[\w/-]+\.js)";\n', re.M)
DECLARED = re.compile(r"^export ((?:async )?(?:function|class|const) (\w+))", re.M)
LISTED = re.compile(r"^export \{ ([^}]+) \};\n", re.M)


def bundle(entry: Path) -> str:
    """Bundles a module and all that it imports.

    Each module becomes a function that runs once and returns what it exports, in the order of the imports. Supported
    are `import { a, b } from "./x.js"`, also from other folders, `export { a, b }`, and `export` before a function,
    class or const.

    Args:
        entry: the module that runs last. Modules of the same name in two folders are not told apart.

    Returns:
        The script.

    Raises:
        ValueError: for a name that its module does not export, and for other forms of import and export.
    """
    exports: dict[str, list[str]] = {}
    parts: list[str] = []

    def add(path: Path) -> None:
        """Appends a module to `parts`, after those that it imports, which must not import it."""
        if (name := path.stem) in exports:
            return
        text = path.read_text(encoding="utf-8")
        for names, other in IMPORT.findall(text):
            add(path.parent / other)
            if missing := set(names.split(", ")) - set(exports[Path(other).stem]):
                raise ValueError(
                    f"{name}.js imports {', '.join(sorted(missing))}, which {Path(other).name} does not export"
                )
        exports[name] = [match[1] for match in DECLARED.findall(text)]
        exports[name] += [word for names in LISTED.findall(text) for word in names.split(", ")]
        text = IMPORT.sub(lambda match: f"const {{ {match[1]} }} = ${Path(match[2]).stem};\n", text)
        text = LISTED.sub("", DECLARED.sub(r"\1", text))
        if left := re.search(r"^(?:import|export)\b.*", text, re.M):
            raise ValueError(f"{name}.js: this form is not supported: {left[0]}")
        parts.append(f"const ${name} = (() => {{\n{text}return {{ {', '.join(exports[name])} }};\n}})();\n")

    add(entry)
    return "\n".join(parts)
