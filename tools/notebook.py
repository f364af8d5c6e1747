"""Runs the code blocks of docs/first_hour.md as one program, and inserts their output and pictures into the page."""

import re
from collections.abc import Iterator
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "first_hour.md"
CELL = re.compile(r"```python\n(?P<code>.*?)```\n(?:```text\n(?P<output>.*?)```\n)?", re.DOTALL)


def run(page: str, pictures: Path) -> Iterator[tuple[re.Match[str], str]]:
    """Runs the code blocks of a page in order, in one namespace.

    Args:
        page: Markdown, with fenced Python blocks, some of which are followed by a text block with their output.
        pictures: folder for the figures of matplotlib, named first_hour_1.jpg and so on.

    Yields:
        The match of CELL for each block, and its output.
    """
    matplotlib.use("Agg")
    names: dict[str, Any] = {"__name__": "__main__"}
    count = 0
    for cell in CELL.finditer(page):
        printed = StringIO()
        lines_above = page[: cell.start("code")].count("\n")  # so that errors name the line of the page
        with redirect_stdout(printed):
            exec(compile("\n" * lines_above + cell["code"], str(PAGE), "exec"), names)
        for number in plt.get_fignums():
            count += 1
            plt.figure(number).savefig(pictures / f"first_hour_{count}.jpg", dpi=100, pil_kwargs={"quality": 88})
        plt.close("all")
        yield cell, printed.getvalue()


def main() -> None:
    """Rewrites the page with the output of its code blocks, and the pictures beside it."""
    page = PAGE.read_text(encoding="utf-8")
    outputs = {cell.start(): output for cell, output in run(page, ROOT / "docs" / "images")}

    def with_output(cell: re.Match[str]) -> str:
        """Returns a code block with its new output, if the page shows one."""
        shown = f"```text\n{outputs[cell.start()]}```\n" if cell["output"] is not None else ""
        return f"```python\n{cell['code']}```\n{shown}"

    PAGE.write_text(CELL.sub(with_output, page), encoding="utf-8")


if __name__ == "__main__":
    main()
