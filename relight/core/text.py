"""Text as people bring it: any byte order mark, line end, code page or separator of columns."""

import codecs
import csv
import io
import os
import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from relight.core.errors import UserError

# In the order in which they are tried. Any bytes are text in Latin-1.
CODE_PAGES = ("utf-8", "cp1252", "gb18030", "cp932", "big5", "cp949", "cp1251", "cp1250", "latin-1")
# UTF-32 before UTF-16, whose mark it begins with.
MARKS = {
    codecs.BOM_UTF32_LE: "utf-32", codecs.BOM_UTF32_BE: "utf-32", codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}  # fmt: skip
CONTROL = re.compile(r"[\x00-\x08\x0e-\x19\x1b-\x1f]")  # no text has these; 1A ends files of DOS
START = 4096  # bytes at the start of a file from which its code and its line ends are told
Table = tuple[list[str], list[dict[str, str]]]  # names of the columns, and the rows: column -> cell


def without_passwords(text: str) -> str:
    """Returns a text without the passwords in its addresses.

    >>> without_passwords("track.uri=postgresql://me:secret@host/runs")
    'track.uri=postgresql://me@host/runs'
    """
    return re.sub(r"(://[^\s:/@]*):[^\s/@]*@", r"\1@", text)


def spellings(name: bytes) -> list[str]:
    """Returns what the bytes of a file's name may say, the likeliest first, each once.

    UTF-8, then the bytes as they are, as Linux keeps them in names, then each other code page that has such bytes.
    """
    likeliest, *others = decodings(name)
    return list(dict.fromkeys([likeliest, os.fsdecode(name), *others]))


def decodings(data: bytes) -> Iterator[str]:
    """Yields what bytes may say: in UTF-16 or UTF-32 if they begin so, else in each of CODE_PAGES that has them."""
    if encoding := _wide_encoding(data):
        yield data.decode(encoding, "replace")
        return
    data = data.removeprefix(codecs.BOM_UTF8)
    for page in CODE_PAGES:
        with suppress(UnicodeDecodeError):
            yield data.decode(page)


def _wide_encoding(start: bytes) -> str | None:
    """Returns UTF-16 or UTF-32, by Python's name, if a text is in it by its first bytes; None for other encodings.

    Without a byte order mark, UTF-16 is told by the zero byte of a first character that is of ASCII.
    """
    for mark, encoding in MARKS.items():
        if start.startswith(mark):
            return encoding
    are_zero = start[:1] == b"\0", start[1:2] == b"\0"
    return {(True, False): "utf-16-be", (False, True): "utf-16-le"}.get(are_zero)


def decode(data: bytes) -> str:
    """Returns what bytes most likely say; raises ValueError for bytes that are no text."""
    text = next(decodings(data))
    if match := CONTROL.search(text):
        raise ValueError(f"it holds the character {match[0]!r}, which no text has")
    return text


def read_text(path: Path) -> str:
    """Reads a text file; raises ValueError if it is not text."""
    return decode(path.read_bytes())


def open_lines(path: Path) -> BinaryIO:
    """Opens a text file to read it line by line as bytes of a superset of ASCII.

    A byte order mark is skipped, UTF-16 and UTF-32 become UTF-8, and lines that end in a lone CR end in LF.
    """
    with open(path, "rb") as file:
        start = file.read(START)
    if encoding := _wide_encoding(start):
        return io.BytesIO(path.read_bytes().decode(encoding, "replace").encode())
    if b"\r" in start[:-1] and b"\n" not in start:
        return io.BytesIO(path.read_bytes().removeprefix(codecs.BOM_UTF8).replace(b"\r", b"\n"))
    opened = open(path, "rb")
    opened.seek(len(codecs.BOM_UTF8) if start.startswith(codecs.BOM_UTF8) else 0)
    return opened


def read_table(path: Path, is_right: Callable[[Table], bool] = lambda table: True) -> Table:
    """Reads a CSV table with columns that are separated by comma, semicolon or tab.

    Args:
        path: path of the file.
        is_right: whether a reading is the one that was meant, such as by files that it names. The code page is the
            first that gives such a reading, else the first that gives any.

    Returns:
        The names of the columns in small letters, and the rows by column, stripped. Cells beyond the last column and
        rows of empty cells are left out.

    Raises:
        UserError: if the file is not a CSV table.
    """
    data = path.read_bytes()
    try:
        decode(data)
        first, *others = (_parse_table(text) for text in dict.fromkeys(decodings(data)))
    except (ValueError, csv.Error) as error:
        raise UserError(f"{path} is not a CSV table ({error})") from None
    return next((table for table in (first, *others) if is_right(table)), first)


def _parse_table(text: str) -> Table:
    """Parses CSV, separated as Excel's first line `sep=` says, else by the commonest in the head (csv.Error)."""
    if match := re.match(r"sep=(.)\r?\n", text):
        separator, text = match[1], text[match.end() :]
    else:
        head_without_quoted = re.sub(r'"[^"]*"', "", text.lstrip().split("\n", 1)[0])
        separator = max(",;\t", key=head_without_quoted.count)
    reader = csv.DictReader(io.StringIO(text.strip("\r\n\x1a"), newline=None), delimiter=separator)
    name_by_head = {head: head.strip().lower() for head in reader.fieldnames or []}
    rows = [{name: (row[head] or "").strip() for head, name in name_by_head.items()} for row in reader]
    return list(name_by_head.values()), [row for row in rows if any(row.values())]
