"""NumPy files from anywhere: read, or refused in one sentence."""

import zipfile
from pathlib import Path

import numpy as np

from relight.files import UserError, existing

MOST = 8 << 30  # bytes of the arrays of one archive; a few bytes of a compressed one may promise any number


def read_npz(path: Path | str, what: str) -> dict[str, np.ndarray]:
    """The arrays of an .npz by name; none holds Python objects.

    Raises UserError that names the file as no `what` when it is missing, damaged, or would take more than MOST bytes.
    """
    path = existing(path, what)
    try:
        with zipfile.ZipFile(path) as archive:
            promised = sum(member.file_size for member in archive.infolist())
        if promised > MOST:
            raise ValueError(f"it promises {promised / 2**30:.0f} GiB")
        with np.load(path, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except Exception as error:  # zipfile, zlib and NumPy raise a dozen types for what can be wrong
        reason = str(error).strip().split("\n")[0] or type(error).__name__
        raise UserError(f"{path} is not a {what} of relight ({reason})") from None


def read_npy(path: Path) -> np.ndarray:
    """The array of an .npy, no Python objects. Raises ValueError for any other file."""
    try:
        return np.load(path, allow_pickle=False)
    except Exception as error:  # its header is Python, so that tokenize and ast raise, too
        raise ValueError(str(error).strip().split("\n")[0] or type(error).__name__) from None
