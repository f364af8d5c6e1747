"""Lists the scans of a folder as named figures."""

import hashlib
import os
import re
import unicodedata
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from relight.core.errors import UserError
from relight.core.files import require_readable, require_safe_name
from relight.core.names import find_path
from relight.core.text import Table, read_table
from relight.meshes.left_out import save_mesh
from relight.meshes.mesh import Mesh

TABLE = "scans.csv"
YES, NO = ("", "1", "1.0", "y", "yes", "t", "true", "x", "on"), ("0", "0.0", "n", "no", "f", "false", "-", "off")
MAX_NAME = 71  # characters of a name, before the hash
WORDS = "mesh(es)?|models?|scans?|obj|ply|glb|smpl[-_]?[hx]?|textured|raw|data|dataset|sequences|train|val|test"
KINDS, KIND = re.compile(WORDS, re.I), re.compile(rf"(^|[-_.])({WORDS})(?=$|[-_.])", re.I)  # which are nobody's name
LETTERS = dict(zip(map(ord, "ßẞæÆœŒøØłŁđĐðÐþÞı"), "ss SS ae Ae oe Oe o O l L d D d D th Th i".split()))  # no accents


@dataclass(frozen=True)
class Scan:
    """A scan.

    Attributes:
        path: of the mesh.
        subject: the person, as first spelled; figures of one subject are on one side of a split.
    """

    path: Path
    subject: str


def list_scans(folder: Path | str) -> dict[str, Scan]:
    """Lists the scans of a folder.

    A table `scans.csv` in the folder (column path, optionally use, name, subject) says which files are figures; without
    it all mesh files in the folder and its subfolders are, except hidden ones. A scan has the name of its file, with
    the folders before it or a hash of its path where names would be the same. Where the table names no subject, it is
    the person of a RenderPeople name (rp_<person>_...), else the subfolder of `folder`, below those that name a kind
    of files (BUFF's `sequences`, THuman's `model` and `smplx`), else the scan's own name.

    Args:
        folder: of the scans.

    Returns:
        Scans by name, sorted by name, or in the order of the table.

    Raises:
        UserError: if the folder is missing or holds no mesh, or if the table contradicts it.
    """
    from relight.meshes.read import suffix_list  # here, since alignment takes the tables alone

    folder = Path(folder)
    if not folder.is_dir():
        raise UserError(f"figures.folder: there is no folder {folder.resolve()}; it should hold {suffix_list()} scans")
    require_readable(folder, "figures.folder")
    if (folder / TABLE).is_file():
        return _from_table(folder / TABLE)
    if not (files := _finest_versions(_mesh_files(folder))):
        raise UserError(f"figures.folder: {folder} holds no scans; {suffix_list()} files are read, in subfolders too")
    relative = {path: path.relative_to(folder).with_suffix("") for path in files}
    names = {path: safe_name(path.stem) for path in files}
    with_folders = {path: safe_name("_".join(relative[path].parts)) for path in files}
    with_hash = {path: f"{safe_name(path.stem)}_{short_hash(str(relative[path]))}" for path in files}
    for longer in (with_folders, with_hash):
        counts = Counter(name.lower() for name in names.values())  # some file systems do not distinguish a and A
        names = {path: name if counts[name.lower()] == 1 else longer[path] for path, name in names.items()}
    scans, subjects = dict[str, Scan](), dict[str, str]()
    for path, name in names.items():
        if name in scans:
            raise UserError(f"{scans[name].path} and {path} have one name: of two formats of a scan, keep one")
        subject = _subject(relative[path], name)
        scans[name] = Scan(path, subjects.setdefault(subject.lower(), subject))
    return dict(sorted(scans.items()))


def read_scan(path: Path, name: str, subject: str, out: Path) -> None:
    """Reads the mesh of a scan without changes.

    Args:
        path: the mesh.
        name: of the figure.
        subject: name of the person.
        out: the mesh record (.npz).
    """
    from relight.meshes.read import read_mesh

    def make() -> Mesh:
        require_safe_name(path)
        mesh = read_mesh(path)
        mesh.info.update(name=name, subject=subject)
        return mesh

    save_mesh(make, {"name": name, "subject": subject}, out)


def safe_name(text: str) -> str:
    """Returns a name of at most 80 ASCII letters, digits, - and _, valid for files on any system.

    Accents are dropped. If letters are dropped or the name is truncated, a hash of `text` keeps names distinct.

    >>> safe_name("Zoë Groß")
    'Zoe_Gross'
    """
    decomposed = unicodedata.normalize("NFKD", text).translate(LETTERS)
    bare = "".join(c for c in decomposed if not unicodedata.combining(c))
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", bare)[:MAX_NAME].strip("_-") or "scan"
    whole = len(bare) <= MAX_NAME and not any(c.isalnum() for c in bare if not c.isascii())
    return name if whole else f"{name}_{short_hash(text)}"


def short_hash(text: str) -> str:
    """Returns eight hexadecimal digits of the SHA-256 of `text`."""
    return hashlib.sha256(os.fsencode(text)).hexdigest()[:8]


def _subject(relative: Path, name: str) -> str:
    """Returns the person of a RenderPeople name, else the subfolder, else the own name of a scan."""
    is_outside = relative.is_absolute() or ".." in relative.parts
    parts = relative.parts[-1:] if is_outside else relative.parts
    for part in (*reversed(parts), name):
        if person := re.match(r"rp_([a-z]+)", part, re.IGNORECASE):
            return person[1].lower()
    below = parts
    while len(below) > 1 and KINDS.fullmatch(below[0]) and (len(below) > 2 or below[0].lower() != "sequences"):
        below = below[1:]
    if len(below) > 1:
        return safe_name(below[0])
    return safe_name(KIND.sub("", below[0]) or below[0]) if len(parts) > 1 else name  # mesh/eve and smplx/eve_smplx


def one_subject(scans: dict[str, Scan]) -> str:
    """Returns a sentence if several scans show one person alone, whom no split by subject divides, and else ""."""
    subjects = {scan.subject for scan in scans.values()}
    if len(subjects) > 1 or len(scans) < 2:
        return ""
    return (
        f"all {len(scans)} scans have the subject {min(subjects)}, and a split by subject needs two: give the folder "
        f"above those of the people, name them in a column `subject` of {TABLE}, or give split=paper"
    )


def _mesh_files(folder: Path) -> list[Path]:
    """Returns the meshes in a folder and its subfolders, also linked ones, each once; none that are hidden."""
    from relight.meshes.read import READERS

    files: list[Path] = []
    seen: set[str] = set()  # a link may lead to a folder around it
    for root, folders, names in os.walk(folder, followlinks=True):
        is_new = (real := os.path.realpath(root)) not in seen
        seen.add(real)
        folders[:] = sorted(name for name in folders if is_new and not name.startswith("."))
        files += [Path(root, name) for name in names if is_new and not name.startswith(".")]
    return [path for path in files if path.suffix.lower() in READERS and path.is_file()]


def _finest_versions(files: list[Path]) -> list[Path]:
    """Keeps the largest of files whose names differ only in a size (x_30k.obj, x_100k.obj) or level (x_LOD0.glb)."""
    best: dict[Path, tuple[float, Path]] = {}
    for path in files:
        match = re.fullmatch(r"(.+)_(?:(?P<thousands>\d+)k|lod_?(?P<level>\d+))", path.stem, re.IGNORECASE)
        key = path.with_stem(match[1]) if match else path
        # A copy names its number of faces, or by how much it is coarser; its original names neither.
        count = float("inf") if match is None else float(match["thousands"] or -int(match["level"]))
        if key not in best or count > best[key][0]:
            best[key] = (count, path)
    return sorted(path for _, path in best.values())


def _from_table(table: Path) -> dict[str, Scan]:
    """Reads the scans that a table names; raises UserError if it contradicts itself or its folder, or chooses none."""

    def scan_path(row: dict[str, str]) -> Path:
        """Returns the file of a row, also if capitals or accents differ; where there is none, the path as written."""
        written = Path(row["path"].replace("\\", "/"))
        path = table.parent / written
        inside = not written.is_absolute() and ".." not in written.parts
        return path if path.is_file() or not inside else find_path(table.parent, written.parts) or path

    def names_files(reading: Table) -> bool:
        """Returns whether all paths are there, if the table is read in some code page."""
        _, rows = reading
        return all(scan_path(row).is_file() for row in rows if row.get("path") and is_used(table, row))

    columns, rows = read_table(table, names_files)
    if "path" not in columns:
        raise UserError(f"{table} has no column `path`; it may have use, name, subject and path")
    scans, subjects = dict[str, Scan](), dict[str, str]()
    for name, row in named_rows(table, rows):
        if not row["path"]:
            raise UserError(f"{table} has a row without a path")
        written, path = Path(row["path"].replace("\\", "/")), scan_path(row)
        if not path.is_file():
            raise UserError(f"{table} names {row['path']}, which is not there; paths start at the table's folder")
        subject = safe_name(row.get("subject") or _subject(written.with_suffix(""), name))
        scans[name] = Scan(path, subjects.setdefault(subject.lower(), subject))
    if not scans:
        raise UserError(f"{table} chooses no scan")
    return scans


def named_rows(table: Path, rows: list[dict[str, str]]) -> Iterator[tuple[str, dict[str, str]]]:
    """Yields the rows that are used, after the name of each: the cell's, else its file's; UserError for one twice."""
    names: set[str] = set()
    for row in rows:
        if is_used(table, row):
            name = safe_name(row.get("name") or Path(row.get("path", "").replace("\\", "/")).stem)
            if name.lower() in names:
                raise UserError(f"{table} names {name} twice")
            names.add(name.lower())
            yield name, row


def is_used(table: Path, row: dict[str, str]) -> bool:
    """Returns whether the cell `use` of a row says yes, as an empty one does; raises UserError if it says neither."""
    if (said := row.get("use", "").lower()) not in YES + NO:
        raise UserError(f"{table}: use is {said!r} for {row.get('path', '')}; give 1 or 0, yes or no")
    return said in YES
