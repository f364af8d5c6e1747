"""Errors that a user can cause, and their one sentence."""

import re
from collections.abc import Iterator

LACKS = re.compile(r"bad.?alloc|(allocate|enough|out of) memory|failed to map segment|start new thread", re.IGNORECASE)


class UserError(Exception):
    """An error that a user can cause and correct: one sentence that names what is wrong and what would be right."""


def causes(error: BaseException | None) -> Iterator[BaseException]:
    """Yields an error, what caused it, what caused that, and so on."""
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def sentence_of(error: BaseException) -> str | None:
    """Returns the sentence for a user of an error; None if it is no UserError and no lack of memory.

    Native libraries say in words of their own that memory is lacking, and what cannot be read for this is not damaged.
    """
    for cause in causes(error):
        if isinstance(cause, MemoryError) or (LACKS.search(str(cause)) and not isinstance(cause, UserError)):
            requested = str(cause).strip().split("\n")[0]
            detail = f" ({requested})" if requested else ""
            return f"there is not enough memory{detail}: take a smaller size, or run fewer jobs at once"
    return str(error) if isinstance(error, UserError) else None
