"""Atomic writing of files, and checks of paths before long work."""

import codecs
import errno
import fcntl
import glob
import hashlib
import json
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from relight.core.errors import UserError, causes

FILE_SYSTEM_ERRORS = frozenset({
    errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, errno.EPERM, errno.ENOTDIR, errno.EIO,
    errno.ENAMETOOLONG,
})  # fmt: skip
PHOTO_SUFFIXES = tuple(".jpg .jpeg .jfif .png .webp .tif .tiff .bmp .gif .avif .heic .heif".split())
VIDEO_SUFFIXES = (".mp4", ".mov", ".m4v", ".3gp", ".webm", ".mkv", ".avi", ".mts", ".m2ts", ".ts", ".wmv")

# First bytes of what is not the file that its name says, and an error message for each.
WRAPPINGS = (
    (b"version https://git-lfs", "a git-lfs pointer; fetch the file itself (git lfs pull)"),
    (b"PK\x03\x04", "a zip archive; unpack it first"),
    (b"\x1f\x8b", "a gzip archive; unpack it first"),
    (b"<", "a web page, not the file; download it again"),
)


def data_folder() -> Path:
    """Returns the folder of what set-up commands keep: the variable RELIGHT_DATA, else the user's data folder."""
    from platformdirs import user_data_path

    return Path(os.environ.get("RELIGHT_DATA") or user_data_path("relight"))


@contextmanager
def _file_system_errors(path: Path) -> Iterator[None]:
    """Converts errors of the file system (FILE_SYSTEM_ERRORS) in the block, which writes `path`, to UserError."""
    try:
        yield
    except UserError:
        raise
    except FileExistsError as error:  # where a folder should be
        raise UserError(f"{path} cannot be written: {error.filename} is a file") from None
    except Exception as error:
        if (number := system_errno(error)) is None:
            raise
        raise UserError(f"{path} cannot be written: {os.strerror(number).lower()}") from None


def system_errno(error: BaseException | None) -> int | None:
    """Returns the error number of the file system that caused an exception.

    Native libraries raise their own exceptions, with the reason in the message or in the cause.

    Returns:
        One of FILE_SYSTEM_ERRORS, or None for other reasons.
    """
    for cause in causes(error):
        if isinstance(cause, OSError) and cause.errno in FILE_SYSTEM_ERRORS:
            return cause.errno
        for number in FILE_SYSTEM_ERRORS:
            if os.strerror(number) in str(cause) or f"(os error {number})" in str(cause):
                return number
    return None


def writable_folder(path: Path | str, what: str, needed: int = 0) -> Path:
    """Checks that files can be written to a folder, by writing one.

    Args:
        path: path of the folder; it need not exist, and is not created.
        what: the name of the folder in errors, such as "--out".
        needed: total size of the files, bytes.

    Returns:
        `path`.

    Raises:
        UserError: if it is a file or read-only, or if the disk has less than `needed` bytes free.
    """
    path = Path(path)
    made: list[Path] = []
    try:
        for folder in reversed([folder for folder in (path, *path.parents) if not folder.exists()]):
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
    """Returns the path of a file that can be written to an existing folder; `what` is its name in errors.

    Raises:
        UserError: if it cannot.
    """
    path = Path(path)
    if path.is_dir():
        raise UserError(f"{what} {path} is a folder: give the name of a file")
    if not path.parent.is_dir():
        raise UserError(f"{what} {path}: there is no folder {path.parent}")
    writable_folder(path.parent, what)
    return path


@contextmanager
def atomic_write(path: Path | str) -> Iterator[Path]:
    """Writes a file atomically: readers see either the old file or the new one.

    Yields a temporary path in the same folder, with the same suffix, whose name begins with a dot. If the block
    succeeds, the temporary file is renamed to `path`; otherwise it is removed. Temporary files of killed writers of the
    same path are removed.

    Raises:
        UserError: if the file system refuses to write.
    """
    path = Path(path)
    with _file_system_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        _remove_stale(path.parent, f".{path.stem}.", path.suffix)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}.", suffix=path.suffix)
    temporary = Path(name)
    try:
        _try_lock(handle)  # shows other processes that the writer of this file is alive
        with _file_system_errors(path):
            yield temporary
        mask = os.umask(0)  # it can be read only by setting it
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)  # mkstemp creates private files; outputs get the user's usual permissions
        os.replace(temporary, path)
    finally:
        os.close(handle)
        temporary.unlink(missing_ok=True)


def write_text(path: Path | str, text: str) -> None:
    """Writes a text in UTF-8, atomically; bytes of names that are none are spelled, as in \\udcff."""
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")


def write_json(path: Path | str, record: Any, default: Callable[[Any], Any] | None = None) -> None:
    """Writes a record as JSON, atomically; `default` turns what is no value of JSON into one."""
    write_text(path, json.dumps(record, indent=1, default=default) + "\n")


def read_record(path: Path) -> dict[str, Any]:
    """Reads a record that `write_json` wrote; {} if there is none, or the file holds something else."""
    try:
        record = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    return record if isinstance(record, dict) else {}


@contextmanager
def atomic_folder(path: Path | str) -> Iterator[Path]:
    """Writes a folder atomically: yields an empty folder beside `path` that replaces it if the block succeeds.

    The folders of killed writers of the same path are removed. Raises UserError if the file system refuses to write.
    """
    path = Path(path).resolve()  # a link stays
    with _file_system_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        _remove_stale(path.parent, f".{path.name}.")
        temporary = Path(tempfile.mkdtemp(dir=path.parent, prefix=f".{path.name}."))
    handle = os.open(temporary, os.O_RDONLY)
    try:
        _try_lock(handle)
        with _file_system_errors(path):
            yield temporary
        temporary.chmod(0o755)  # mkdtemp creates private folders
        if path.exists():
            shutil.rmtree(path)
        os.replace(temporary, path)
    finally:
        os.close(handle)
        shutil.rmtree(temporary, ignore_errors=True)


def _remove_stale(folder: Path, prefix: str, suffix: str = "") -> None:
    """Removes temporary files and folders of `tempfile` that are not locked, since their writers are dead."""
    random_part = 8 * "?"  # the characters between them, which `tempfile` draws
    for stale in folder.glob(glob.escape(prefix) + random_part + glob.escape(suffix)):
        try:
            handle = os.open(stale, os.O_RDONLY if stale.is_dir() else os.O_RDWR)  # NFS locks only writable files
        except OSError:  # its writer has just finished, or it belongs to another user
            continue
        if _try_lock(handle):
            if stale.is_dir():
                shutil.rmtree(stale, ignore_errors=True)
            else:
                stale.unlink(missing_ok=True)
        os.close(handle)


def _try_lock(handle: int) -> bool:
    """Locks an open file until it is closed or the process ends; returns False if another process holds the lock."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:  # also on file systems without locks, on which stale files stay
        return False
    return True


def is_unsafe_name(path: Path | str) -> bool:
    """Returns whether the workflow cannot handle a file name.

    For Snakemake, braces are wildcards, and its records cannot contain line breaks or bytes that are not UTF-8.
    """
    return re.search(r"[{}\x00-\x1f\x7f\ud800-\udfff]", str(path)) is not None


def require_safe_name(path: Path | str) -> None:
    """Raises UserError if the workflow cannot handle the name (`is_unsafe_name`)."""
    if is_unsafe_name(path):
        raise UserError(
            f"{ascii(str(path))[1:-1]}: rename it; names of files and folders must not contain braces, line breaks, or "
            "bytes that are not UTF-8"
        )


def existing_file(path: Path | str, what: str) -> Path:
    """Returns the path of a file that exists and can be read; `what` is its name in errors, such as "mask".

    Raises:
        UserError: if there is no such file, or this user may not read it.
    """
    path = Path(path)
    try:
        exists = path.is_file()
    except OSError as error:  # such as of a name that is too long
        exists = isinstance(error, PermissionError)  # of its folder
    if not exists:
        raise UserError(f"{what}: there is no file {path}")
    require_readable(path, what)
    return path


def require_unpacked(path: Path) -> None:
    """Raises UserError for what a download may leave in place of a file: a page, an archive, a pointer of git-lfs."""
    with open(path, "rb") as file:
        start = file.read(256).removeprefix(codecs.BOM_UTF8).lstrip()
    for magic, description in WRAPPINGS:
        if start.startswith(magic):
            raise UserError(f"{path}: {description}")


def file_hash(path: Path) -> str:
    """Returns the SHA-256 of a file, hexadecimal."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def require_readable(path: Path, what: str) -> None:
    """Raises UserError if this user may not read a file, or list a folder; `what` is its name in the error."""
    if not os.access(path, os.R_OK, effective_ids=os.access in os.supports_effective_ids):
        raise UserError(f"{what}: {path} cannot be read: permission denied")
