"""The container of PLY: its header, and the columns of its elements, from ascii or binary data."""

import codecs
import re
import struct
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from relight.core.errors import UserError
from relight.meshes.raw import parse_numbers

TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4",
    "float64": "f8",
}  # fmt: skip
BYTE_ORDERS = {"ascii": None, "binary_little_endian": "<", "binary_big_endian": ">"}
MAX_HEADER = 1 << 20  # bytes; real headers have under a thousand


class Property(NamedTuple):
    """A property of an element.

    Attributes:
        name: such as `x`, in small letters.
        type: of a value, as NumPy names it ("f4").
        length_type: of the number before a list of values; None for a property of one value.
    """

    name: str
    type: str
    length_type: str | None


@dataclass
class Element:
    """One element of the header.

    Attributes:
        name: such as `vertex`.
        count: of its rows.
        properties: in the file's order.
    """

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)


class ListColumn(NamedTuple):
    """The lists of a property.

    Attributes:
        lengths: (N,) of each row's list.
        values: of all lists, one after another.
    """

    lengths: np.ndarray
    values: np.ndarray


Block = dict[str, Any]  # the columns of an element by property: an array (N,), or a ListColumn


def read_blocks(path: Path) -> tuple[dict[str, Block], list[bytes]]:
    """Reads a PLY file.

    Returns:
        The columns of each element by name, and the names of the textures, as bytes in the file's code page.

    Raises:
        UserError: if the file is malformed.
    """
    data = path.read_bytes().removeprefix(codecs.BOM_UTF8)
    byte_order, elements, textures, start = _header(path, data[:MAX_HEADER])
    is_ascii = byte_order is None
    needed = sum(  # a list may be empty, and an ascii value is a digit and a space
        element.count * (2 if is_ascii else np.dtype(length_type or type).itemsize)
        for element in elements
        for _, type, length_type in element.properties
    )
    if needed > len(data) - start + is_ascii:  # checked before such an array is allocated; ascii may end without space
        counts = " and ".join(f"{element.count} {element.name} rows" for element in elements)
        raise UserError(f"{path}: the header promises {counts}, which {len(data) - start} bytes cannot hold")
    if byte_order is None:
        return _ascii_blocks(path, data[start:], elements), textures
    return _binary_blocks(path, data, start, byte_order, elements), textures


def _header(path: Path, head: bytes) -> tuple[str | None, list[Element], list[bytes], int]:
    """Returns byte order, None for ascii, the elements that have properties, the pictures, and where data begin."""
    end = head.find(b"end_header")
    first_line = re.match(rb"ply[ \t]*(\r\n|\n|\r)", head)  # all lines of a header end as the first one does
    line_end = head.find(first_line[1], end) if first_line else -1
    if first_line is None or end < 0 or line_end < 0:
        raise UserError(f"{path} is not a PLY file: it lacks the line `ply` at the top or the line `end_header`")
    format, elements, textures = "", [], []
    for line in head[:end].decode("latin-1").split(first_line[1].decode())[1:]:
        try:
            match line.split():
                case ["format", name, *_]:
                    format = name
                case ["comment", "TextureFile", *_]:
                    textures.append(line.split("TextureFile", 1)[1].strip().strip('"').encode("latin-1"))
                case ["element", name, count]:
                    elements.append(Element(name, int(count)))
                    if elements[-1].count < 0:
                        raise ValueError
                case ["property", "list", length_type, type, name]:
                    elements[-1].properties.append(Property(name.lower(), TYPES[type], TYPES[length_type]))
                case ["property", type, name]:
                    elements[-1].properties.append(Property(name.lower(), TYPES[type], None))
                case ["comment" | "obj_info", *_] | []:
                    pass
                case _:
                    raise ValueError
        except (KeyError, ValueError, IndexError):
            raise UserError(f"{path}: the PLY header's line {line.strip()[:80]!r} means nothing") from None
    if format not in BYTE_ORDERS:
        raise UserError(f"{path}: PLY format {format or 'missing'}; {', '.join(BYTE_ORDERS)} are read")
    for element in elements:
        names = [property.name for property in element.properties]
        if len(set(names)) < len(names):
            raise UserError(f"{path}: the PLY header names a property of {element.name} twice")
    filled = [element for element in elements if element.properties]
    return BYTE_ORDERS[format], filled, textures, line_end + len(first_line[1])


def _binary_blocks(path: Path, data: bytes, start: int, byte_order: str, elements: list[Element]) -> dict[str, Block]:
    """Parses binary data to columns by element.

    In nearly all files, the lists of a property have one length, and an element is a table of equal rows. `start` is in
    bytes, `byte_order` is "<" or ">", and `elements` are in the file's order.
    """
    blocks = {}
    for element in elements:
        first, _ = _ragged(path, data, start, byte_order, replace(element, count=min(element.count, 1)))
        lengths = {name: int(first[name].lengths.sum()) for name, _, is_list in element.properties if is_list}
        fields: list[Any] = []
        for name, type, length_type in element.properties:
            if length_type:
                fields += [(f"{name} length", byte_order + length_type), (name, byte_order + type, (lengths[name],))]
            else:
                fields.append((name, byte_order + type))
        row = np.dtype(fields)
        end = start + element.count * row.itemsize
        table = np.frombuffer(data, row, element.count, start) if end <= len(data) else None
        if table is not None and all((table[f"{name} length"] == lengths[name]).all() for name in lengths):
            block: Block = {name: table[name] for name, _, _ in element.properties}
            for name, length in lengths.items():
                block[name] = ListColumn(np.full(element.count, length), table[name].reshape(-1))
            blocks[element.name], start = block, end
        else:
            blocks[element.name], start = _ragged(path, data, start, byte_order, element)
    return blocks


def _unpack(
    path: Path, data: bytes, start: int, type: str, count: float, element: Element
) -> tuple[tuple[Any, ...], int]:
    """Unpacks numbers of a type ("<f4") from byte `start` on, and returns where they end, too."""
    if not 0 <= count <= len(data):  # also refuses NaN, the length of a list in ascii files
        raise UserError(f"{path}: a list of {count} values in {element.name}; the file is damaged")
    try:
        values = struct.unpack_from(f"{type[0]}{int(count)}{np.dtype(type).char}", data, start)
        return values, start + np.dtype(type).itemsize * len(values)
    except (struct.error, OverflowError):
        raise UserError(f"{path} ends in the middle of its {element.name} data: it is truncated") from None


def _ragged(path: Path, data: bytes, start: int, byte_order: str, element: Element) -> tuple[Block, int]:
    """Parses an element whose lists have different lengths, row by row, and returns where it ends, too."""
    lengths: dict[str, list[int]] = {property.name: [] for property in element.properties}
    values: dict[str, list[Any]] = {property.name: [] for property in element.properties}
    for _ in range(element.count):
        for name, type, length_type in element.properties:
            length = 1
            if length_type:
                (length,), start = _unpack(path, data, start, byte_order + length_type, 1, element)
            read, start = _unpack(path, data, start, byte_order + type, length, element)
            values[name].extend(read)
            lengths[name].append(len(read))
    block = {
        name: ListColumn(np.array(lengths[name]), np.array(values[name])) if length_type else np.array(values[name])
        for name, _, length_type in element.properties
    }
    return block, start


def _ascii_blocks(path: Path, text: bytes, elements: list[Element]) -> dict[str, Block]:
    """Parses ascii numbers to doubles, and these as the data of a binary file."""
    values = parse_numbers(path, text, np.float64)
    doubles = [
        Element(element.name, element.count, [
            Property(name, "f8", length_type and "f8") for name, _, length_type in element.properties
        ])
        for element in elements
    ]  # fmt: skip
    blocks = _binary_blocks(path, values.astype("<f8").tobytes(), 0, "<", doubles)
    for element in elements:
        block = blocks[element.name]
        for name, type, length_type in element.properties:
            column = block[name]
            if length_type:
                block[name] = ListColumn(column.lengths.astype(np.int64), column.values)
            else:
                block[name] = _as_declared(column, type)
    return blocks


def _as_declared(column: np.ndarray, type: str) -> np.ndarray:
    """Returns doubles (N,) as the integers that they were declared, or wider ones where they do not fit."""
    if type[0] == "f" or not np.isfinite(column).all() or np.abs(column).max(initial=0) > 2**53:
        return column
    limits = np.iinfo(type)
    fits = column.min(initial=0) >= limits.min and column.max(initial=0) <= limits.max
    return column.astype(type if fits else np.int64)
