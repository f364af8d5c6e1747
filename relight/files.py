"""Whole-or-nothing outputs, and the one error type that users see."""

import csv
import errno
import fcntl
import glob
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

# What a file system answers when nothing is wrong with the program.
REFUSALS = frozenset(
    {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, errno.EPERM, errno.ENOTDIR, errno.EIO}
)


class UserError(Exception):
    """An error that a user can cause and mend: one sentence on what is wrong with what, and what would be right."""


@contextmanager
def _refusals(path: Path) -> Iterator[None]:
    """Turns what the file system refuses while `path` is written into a UserError."""
    try:
        yield
    except UserError:
        raise
    except Exception as error:
        if (number := refusal(error)) is None:
            raise
        raise UserError(f"{path} cannot be written: {os.strerror(number).lower()}") from None


def refusal(error: BaseException | None) -> int | None:
    """The errno in REFUSALS that an exception comes from, if any.

    Libraries of other languages have exceptions of their own, which tell the reason in words or hide it in their cause.
    """
    while error is not None:
        if isinstance(error, OSError) and error.errno in REFUSALS:
            return error.errno
        for number in REFUSALS:
            if os.strerror(number) in str(error) or f"(os error {number})" in str(error):
                return number
        error = error.__cause__ or error.__context__
    return None


def writable_folder(path: Path | str, what: str, needed: int = 0) -> Path:
    """`path`, if files of `needed` bytes together can be written into it, whether it is there yet or not.

    For a check before long work: it is tried, and nothing is left behind. Raises UserError that names `what`.
    """
    path = Path(path)
    made: list[Path] = []
    try:
        missing = [folder for folder in (path, *path.parents) if not folder.exists()]
        for folder in reversed(missing):
            folder.mkdir()
            made.append(folder)
        if not path.is_dir():
            raise UserError(f"{what} {path} is a file: give a folder")
        with tempfile.TemporaryFile(dir=path):
            free = shutil.disk_usage(path).free
    except OSError as error:
        reason = os.strerror(error.errno).lower() if error.errno else error
        raise UserError(f"{what} {path}: nothing can be written there ({reason})") from None
    finally:
        for folder in reversed(made):
            with suppress(OSError):
                folder.rmdir()
    if free < needed:
        raise UserError(f"{what} {path}: up to {needed / 1e6:.0f} MB are needed, {free / 1e6:.0f} MB are free there")
    return path


def writable_file(path: Path | str, what: str) -> Path:
    """`path`, if a file can be written there, into a folder that exists. Raises UserError that names `what`."""
    path = Path(path)
    if path.is_dir():
        raise UserError(f"{what} {path} is a folder: give the name of a file")
    if not path.parent.is_dir():
        raise UserError(f"{what} {path}: there is no folder {path.parent}")
    writable_folder(path.parent, what)
    return path


@contextmanager
def whole(path: Path | str) -> Iterator[Path]:
    """Yields a temporary path beside `path`, with the same suffix; it becomes `path` when the block succeeds.

    The rename is atomic, so a reader sees the old file or the new one, never a part; a failed block leaves
    the old file as it was. The temporary name begins with a dot. What a killed writer of the same file left
    is removed.
    """
    path = Path(path)
    with _refusals(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        sweep(path.parent, f".{path.stem}.", path.suffix)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}.", suffix=path.suffix)
    temporary = Path(name)
    try:
        lock(handle)  # tells the sweeps of others that its writer is alive
        with _refusals(path):
            yield temporary
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)  # mkstemp makes private files; outputs carry the user's usual rights
        os.replace(temporary, path)
    finally:
        os.close(handle)
        temporary.unlink(missing_ok=True)


@contextmanager
def whole_folder(path: Path | str) -> Iterator[Path]:
    """The same for a folder: yields an empty temporary folder that replaces `path` when the block succeeds."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    sweep(path.parent, f".{path.name}.")
    temporary = Path(tempfile.mkdtemp(dir=path.parent, prefix=f".{path.name}."))
    handle = os.open(temporary, os.O_RDONLY)
    try:
        lock(handle)
        yield temporary
        temporary.chmod(0o755)
        if path.exists():
            shutil.rmtree(path)
        os.replace(temporary, path)
    finally:
        os.close(handle)
        shutil.rmtree(temporary, ignore_errors=True)


def discard(folder: Path) -> None:
    """Removes a folder, and the one around it where that is left empty."""
    shutil.rmtree(folder, ignore_errors=True)
    with suppress(OSError):
        folder.parent.rmdir()


def sweep(folder: Path, prefix: str, suffix: str = "") -> None:
    """Removes the temporary files and folders of this name whose writers are dead: nobody holds their lock."""
    for stale in folder.glob(glob.escape(prefix) + 8 * "?" + glob.escape(suffix)):
        try:
            handle = os.open(stale, os.O_RDONLY if stale.is_dir() else os.O_RDWR)  # NFS locks only what may be written
        except OSError:  # its writer has just finished, or it is another user's
            continue
        if lock(handle):
            if stale.is_dir():
                shutil.rmtree(stale, ignore_errors=True)
            else:
                stale.unlink(missing_ok=True)
        os.close(handle)


def lock(handle: int) -> bool:
    """Takes the lock of an open file until it is closed or its process ends; False when another holds it."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:  # also file systems that know no locks: nothing is swept there
        return False
    return True


def odd(path: Path | str) -> bool:
    """Whether the workflow cannot name a file: braces are patterns to Snakemake, line breaks end a word in its records,
    and bytes that are no UTF-8 cannot be written down."""
    return re.search(r"[{}\x00-\x1f\x7f\ud800-\udfff]", str(path)) is not None


def refuse_odd(path: Path | str) -> None:
    """Raises UserError for an odd name."""
    if odd(path):
        raise UserError(
            f"{ascii(str(path))[1:-1]}: rename it; braces, line breaks and bytes that are no UTF-8 are not read in the "
            "names of files and folders"
        )


def existing(path: Path | str, what: str) -> Path:
    """`path` as a Path; raises UserError that names `what` when there is no such file."""
    path = Path(path)
    if not path.is_file():
        raise UserError(f"{what}: there is no file {path}")
    return path


def read_table(path: Path) -> tuple[list[str], list[dict[str, str]]]:
    """The columns of a user's CSV table, and its rows: blanks are taken off, cells without a column left out.

    Raises UserError for what is no CSV in UTF-8.
    """
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            rows = [{key: (value or "").strip() for key, value in row.items() if key is not None} for row in reader]
            return list(reader.fieldnames or []), rows
    except (UnicodeDecodeError, csv.Error) as error:
        raise UserError(f"{path} is no CSV table in UTF-8 ({error})") from None


def out_of_memory(error: MemoryError) -> str:
    """What to tell a user whose machine has not the memory that was asked for."""
    asked = str(error).strip().split("\n")[0]
    return f"there is not enough memory{f' ({asked})' if asked else ''}: take a smaller size, or run fewer jobs at once"
