"""Progress with the time left: a bar on a terminal, a line every few seconds in a log."""

import sys
import time
from collections.abc import Iterable, Iterator, Sized
from typing import TypeVar

T = TypeVar("T")


def span(seconds: float) -> str:
    """Seconds as a person says them: 8 s, 2 min 05 s, 1 h 10 min."""
    seconds = int(seconds + 0.5)
    if seconds < 60:
        return f"{seconds} s"
    if seconds < 3600:
        return f"{seconds // 60} min {seconds % 60:02d} s"
    return f"{seconds // 3600} h {seconds % 3600 // 60:02d} min"


def progress(items: Iterable[T], what: str, total: int | None = None, every: float = 5.0) -> Iterator[T]:
    """Yields `items`, showing "what 12/64, 40 s left" on stderr.

    On a terminal the line is rewritten four times a second; in a log a line is written every `every` seconds and
    none at all when everything takes less than that, so that short stages stay quiet.
    """
    total = len(items) if total is None and isinstance(items, Sized) else total
    terminal = sys.stderr.isatty()
    start = last = time.monotonic()
    shown = False
    done = 0
    for done, item in enumerate(items, 1):
        yield item
        now = time.monotonic()
        if now - last < (0.25 if terminal else every):
            continue
        last, shown = now, True
        left = f", {span((now - start) / done * (total - done))} left" if total else ""
        line = f"{what} {done}{f'/{total}' if total else ''}{left}"
        print(f"\r\x1b[K{line}" if terminal else line, end="" if terminal else "\n", file=sys.stderr, flush=True)
    if shown:
        line = f"{what} {done}{f'/{total}' if total else ''}, took {span(time.monotonic() - start)}"
        print(f"\r\x1b[K{line}" if terminal else line, file=sys.stderr, flush=True)
