"""Shows progress with the remaining time: on a terminal in one line, in a log as a line every few seconds."""

import sys
import time
from collections.abc import Iterable, Iterator, Sized
from typing import TypeVar

T = TypeVar("T")
TERMINAL_INTERVAL, LOG_INTERVAL = 0.25, 5.0  # seconds between updates of the line on a terminal, and lines in a log


def duration(seconds: float) -> str:
    """Formats a duration.

    >>> [duration(seconds) for seconds in (8, 125, 4200)]
    ['8 s', '2 min 05 s', '1 h 10 min']
    """
    seconds = int(seconds + 0.5)
    if seconds < 60:
        return f"{seconds} s"
    if seconds < 3600:
        return f"{seconds // 60} min {seconds % 60:02d} s"
    return f"{seconds // 3600} h {seconds % 3600 // 60:02d} min"


def progress(items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
    """Yields `items`, and shows on stderr how many are done and the time left: "figures 12/64, 40 s left".

    Args:
        items: to yield.
        what: their name.
        total: number of items; by default their length, if they have one.
    """
    total = len(items) if total is None and isinstance(items, Sized) else total
    of_total = f"/{total}" if total else ""
    terminal = sys.stderr.isatty()
    start = last = time.monotonic()
    shown = False
    done = 0

    def show(time_words: str, end: str) -> None:
        clear = "\r\x1b[K" if terminal else ""  # to the start of the line, and clear it
        print(f"{clear}{what} {done}{of_total}{time_words}", end=end, file=sys.stderr, flush=True)

    for done, item in enumerate(items, 1):
        yield item
        now = time.monotonic()
        if now - last < (TERMINAL_INTERVAL if terminal else LOG_INTERVAL):
            continue
        last, shown = now, True
        left = f", {duration((now - start) / done * (total - done))} left" if total else ""
        show(left, end="" if terminal else "\n")
    if shown:
        show(f", took {duration(time.monotonic() - start)}", end="\n")
