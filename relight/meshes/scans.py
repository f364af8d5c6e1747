"""A folder of scans as named figures."""

import hashlib
import os
import re
import unicodedata
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from relight.files import UserError, read_table
from relight.meshes.read import READERS, kinds

TABLE = "scans.csv"
LONGEST = 71  # letters of a name, before the hash


@dataclass(frozen=True)
class Scan:
    """A mesh file, and the person that it shows: figures of one subject stay on one side of a split."""

    path: Path
    subject: str


def list_scans(folder: Path | str) -> dict[str, Scan]:
    """The scans of a folder by name, in the order of their names, or of the table where there is one.

    A file `scans.csv` in the folder (columns path, and if wanted use, name, subject; `pick` writes one for BUFF) says
    which files are figures. Without it all mesh files in the folder and its subfolders are, hidden ones aside. A scan
    is called like its file, with the folders before it or a hash of its path where that is not enough. The subject is
    the folder right under `folder`, the person of a RenderPeople name (rp_<person>_...), or the scan's own name.
    Raises UserError for a folder that is missing or holds no mesh, and for a table that contradicts the folder.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise UserError(f"figures.folder: there is no folder {folder}; it should hold scans ({kinds()})")
    if (folder / TABLE).is_file():
        return _from_table(folder / TABLE)
    files = sorted(
        path
        for path in folder.rglob("*")
        if path.suffix.lower() in READERS
        and path.is_file()
        and not any(part.startswith(".") for part in path.relative_to(folder).parts)
    )
    files = _finest(files)
    if not files:
        raise UserError(f"figures.folder: {folder} holds no scans; {kinds()} files are read, in subfolders too")
    relative = {path: path.relative_to(folder).with_suffix("") for path in files}
    names = {path: safe(path.stem) for path in files}
    for longer in (
        lambda path: safe("_".join(relative[path].parts)),
        lambda path: f"{safe(path.stem)}_{hashed(str(relative[path]))}",
    ):
        counts = Counter(name.lower() for name in names.values())  # file systems may take a and A for one
        names = {path: name if counts[name.lower()] == 1 else longer(path) for path, name in names.items()}
    scans = {name: Scan(path, _subject(relative[path], name)) for path, name in names.items()}
    if len(scans) < len(files):
        raise UserError(f"figures.folder: two scans in {folder} would have one name, hashes and all; rename one")
    return dict(sorted(scans.items()))


def safe(text: str) -> str:
    """`text` as a name that can be a file's on any system: at most 80 letters of ASCII, digits, - and _.

    Accents are dropped (Zoë is Zoe). Where letters or the end are lost, a hash of `text` keeps names apart.
    """
    bare = "".join(c for c in unicodedata.normalize("NFKD", text) if not unicodedata.combining(c))
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", bare)[:LONGEST].strip("_-") or "scan"
    whole = len(bare) <= LONGEST and not any(c.isalnum() for c in bare if not c.isascii())
    return name if whole else f"{name}_{hashed(text)}"


def hashed(text: str) -> str:
    """Eight digits that stand for `text`."""
    return hashlib.sha256(os.fsencode(text)).hexdigest()[:8]


def _subject(relative: Path, name: str) -> str:
    if len(relative.parts) > 1:
        return safe(relative.parts[0])
    person = re.match(r"rp_([a-z]+)", name, re.IGNORECASE)
    return person[1].lower() if person else name


def _finest(files: list[Path]) -> list[Path]:
    """One file of those that differ only in a size at the end of the name (rp_x_30k.obj, rp_x_100k.obj): the finest."""
    best: dict[Path, tuple[int, Path]] = {}
    for path in files:
        match = re.fullmatch(r"(.+)_(\d+)k", path.stem, re.IGNORECASE)
        key = path.with_stem(match[1]) if match else path
        count = int(match[2]) if match else 0
        if key not in best or count > best[key][0]:
            best[key] = (count, path)
    return sorted(path for _, path in best.values())


def _from_table(table: Path) -> dict[str, Scan]:
    columns, rows = read_table(table)
    if "path" not in columns:
        raise UserError(f"{table} has no column `path`; it may have use, name, subject and path")
    scans: dict[str, Scan] = {}
    for row in rows:
        if row.get("use", "1").lower() in ("0", "no", "false"):
            continue
        path = table.parent / row["path"].replace("\\", "/")
        name = safe(row.get("name") or path.stem)
        if not path.is_file():
            raise UserError(f"{table} names {row['path']}, which is not there; paths start at the table's folder")
        if name in scans:
            raise UserError(f"{table} names {name} twice")
        scans[name] = Scan(path, safe(row.get("subject") or name))
    if not scans:
        raise UserError(f"{table} chooses no scan")
    return scans
