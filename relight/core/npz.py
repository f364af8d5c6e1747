"""Reads NumPy files of unknown origin."""

import zipfile
from pathlib import Path

import numpy as np

from relight.core.errors import UserError
from relight.core.files import existing_file

MAX_BYTES = 8 << 30  # total size of the arrays of an archive, which can be far larger than the file


def read_npz(path: Path | str, what: str) -> dict[str, np.ndarray]:
    """Reads the arrays of an .npz file.

    Args:
        path: path of the file.
        what: its expected content, for errors.

    Returns:
        Arrays by name, without Python objects.

    Raises:
        UserError: if the file is missing, damaged, or would take more than MAX_BYTES of memory.
    """
    path = existing_file(path, what)
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > MAX_BYTES:
            raise ValueError(f"its arrays have {size / 2**30:.0f} GiB")
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        for name, value in arrays.items():
            if not isinstance(value, np.ndarray):  # NumPy returns the bytes of other members
                raise ValueError(f"its {name[:40]!r} is not an array")
        return arrays
    except Exception as error:  # zipfile, zlib and NumPy raise a dozen types for damaged files
        reason = str(error).strip().split("\n")[0] or type(error).__name__
        raise UserError(f"{path} is not a {what} of relight ({reason})") from None


def read_npy(path: Path) -> np.ndarray:
    """Reads the array of an .npy file.

    Raises:
        ValueError: if the file is damaged or holds Python objects.
    """
    try:
        return np.load(path, allow_pickle=False)
    except Exception as error:  # the header is Python, so tokenize and ast raise, too
        raise ValueError(str(error).strip().split("\n")[0] or type(error).__name__) from None
