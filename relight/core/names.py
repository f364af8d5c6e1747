"""Names of files that differ only in what file systems disregard."""

import os
import unicodedata
from pathlib import Path


def find_path(folder: Path, parts: tuple[str, ...]) -> Path | None:
    """Returns the path `parts` in `folder`, written so or with other capitals or accents; None if there is none."""
    path = folder
    for part in parts:
        if not os.path.lexists(path / part):
            names = sorted(os.listdir(path)) if path.is_dir() else []
            if (alike := next((name for name in names if folded(name) == folded(part)), None)) is None:
                return None
            part = alike
        path = path / part
    return path


def folded(name: str) -> str:
    """Returns a name without the differences that file systems disregard: capitals, and how accents are composed."""
    return unicodedata.normalize("NFC", name).casefold()
