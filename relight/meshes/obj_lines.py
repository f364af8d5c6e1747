"""Parses the `v`, `vt` and `f` lines of Wavefront OBJ files in chunks: NumPy is faster than Python on many at once."""

from pathlib import Path

import numpy as np

from relight.core.errors import UserError
from relight.meshes.raw import parse_numbers

CHUNK = 1 << 17  # lines that are parsed at a time, so that 5 million faces never exist as text objects


class Numbers:
    """Collects lines of numbers and parses them in chunks, to rows of `least` to `most` columns.

    Attributes:
        count: number of the lines.
        widest: columns of the longest line.
    """

    def __init__(self, path: Path, keyword: str, least: int, most: int):
        """Collects the lines of a keyword; `path` and keyword are for error messages."""
        self.path, self.keyword, self.least, self.most = path, keyword, least, most
        self.lines: list[bytes] = []
        self.rows: list[np.ndarray] = []
        self.count = self.widest = 0

    def add(self, line: bytes) -> None:
        """Adds a line without its keyword."""
        self.lines.append(line)
        self.count += 1
        if len(self.lines) == CHUNK:
            self._flush()

    def _flush(self) -> None:
        """Parses the lines so far, as wide as the shortest of them; raises UserError if that is below `least`."""
        if not self.lines:
            return
        width = len(self.lines[0].split())
        self.widest = max(self.widest, width)
        values = parse_numbers(self.path, b" ".join(self.lines), np.float64)
        if values.size != width * len(self.lines):  # some lines are longer than others
            widths = [len(line.split()) for line in self.lines]
            width, self.widest = min(widths), max(self.widest, *widths)
            cut = [b" ".join(line.split()[:width]) for line in self.lines]
            values = parse_numbers(self.path, b" ".join(cut), np.float64)
        if width < self.least:
            raise UserError(f"{self.path}: a `{self.keyword}` line has {width} numbers; {self.least} are needed")
        self.rows.append(values.reshape(-1, width)[:, : self.most])
        self.lines = []

    def array(self) -> np.ndarray:
        """Returns all rows (count,columns), with as many columns as the shortest has."""
        self._flush()
        width = min((rows.shape[1] for rows in self.rows), default=self.least)
        return np.concatenate([rows[:, :width] for rows in self.rows]) if self.rows else np.zeros((0, width))


class Faces:
    """Collects lines of faces and parses them in chunks, to indices of vertices and texture coordinates."""

    def __init__(self, path: Path):
        """Starts without lines; `path` is for error messages."""
        self.path = path
        self.lines: list[bytes] = []
        self.above: list[tuple[int, int]] = []  # vertices and texture coordinates above each line, for negative indices
        self.counts: list[np.ndarray] = []
        self.corners: list[np.ndarray] = []

    def add(self, line: bytes, vertices: int, coordinates: int) -> None:
        """Adds a line without its keyword, and the numbers of vertices and texture coordinates above it."""
        self.lines.append(line)
        self.above.append((vertices, coordinates))
        if len(self.lines) == CHUNK:
            self._flush()

    def _flush(self) -> None:
        """Parses the lines so far; indices that count from the end become such from the start, and all count from 0."""
        if not self.lines:
            return
        words = [line.split() for line in self.lines]
        counts = np.array([len(line) for line in words])
        corners = self._parse_corners([word for line in words for word in line])
        if (corners[:, 0] == 0).any():
            raise UserError(f"{self.path}: a face names vertex 0; .obj files count from 1")
        if (corners < 0).any():
            above = np.repeat(np.array(self.above), counts, axis=0)
            corners = np.where(corners < 0, np.maximum(above + corners, -1) + 1, corners)
            if (corners[:, 0] < 1).any():
                raise UserError(f"{self.path}: a face names a vertex before the first one")
        self.counts.append(counts)
        self.corners.append(corners - 1)
        self.lines, self.above = [], []

    def _parse_corners(self, words: list[bytes]) -> np.ndarray:
        """Parses words `v`, `v/t`, `v//n` or `v/t/n` to (N,2) v and t, 0 for none; fast if all have one form."""
        text = b" ".join(words).replace(b"//", b"/0/")
        slashes = words[0].count(b"/")  # of each word, if all have one form
        if all(word.count(b"/") == slashes for word in words) and b"/ " not in text + b" ":
            table = self._table(text.replace(b"/", b" "), len(words), columns=slashes + 1)
            return table[:, :2] if slashes else np.pad(table, ((0, 0), (0, 1)))
        pairs = [(word.split(b"/") + [b""])[:2] for word in words]
        return self._table(b" ".join(b"%s %s" % (v, t or b"0") for v, t in pairs), len(words), columns=2)

    def _table(self, text: bytes, rows: int, columns: int) -> np.ndarray:
        """Parses integers between spaces to (rows,columns); raises UserError if there are more or fewer of them."""
        values = parse_numbers(self.path, text, np.int64)
        if values.size != rows * columns:
            raise UserError(f"{self.path}: a corner of a face is not written v, v/vt, v//vn or v/vt/vn")
        return values.reshape(rows, columns)

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns how many corners each polygon has (P,), and vertex and texture coordinate of each corner (N,2).

        Both count from 0; -1 is a corner without texture coordinate.

        Raises:
            UserError: if there are no lines, or one is damaged.
        """
        self._flush()
        if not self.corners:
            raise UserError(f"{self.path} has no faces: relight needs a surface")
        return np.concatenate(self.counts), np.concatenate(self.corners)
