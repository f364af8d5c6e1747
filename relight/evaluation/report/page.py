"""The report's page: jinja templates of Markdown and HTML, pictures inside it, readable offline and on a phone."""

import base64
import io
import re
from functools import cache
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markdown_it import MarkdownIt
from markupsafe import Markup
from PIL import Image

from relight.evaluation import formats
from relight.evaluation.comparisons import MARGIN, Verdict
from relight.evaluation.labels import column_label, label
from relight.evaluation.statistics import ALPHA
from relight.files import UserError, existing_file
from relight.progress import duration

TYPES = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg", ".svg": "image/svg+xml"}
LARGE = 400_000  # bytes; larger PNGs go into the page as JPEGs of the same pixels


@cache
def environment() -> Environment:
    """The templates, with what they may call: every value is escaped, and a name that is not given is an error."""
    made = Environment(
        loader=PackageLoader("relight.evaluation.report"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    made.filters |= {
        "number": formats.number,
        "count": formats.count,
        "column": column_label,
        "label": label,
        "duration": duration,
    }
    made.globals |= {"table": table, "picture": picture, "ALPHA": ALPHA, "MARGIN": MARGIN, "Verdict": Verdict}
    return made


def text(template: str, **context) -> str:
    """A template as plain text, such as the note under a table."""
    lines = environment().get_template(template).render(context).splitlines()
    return Markup(" ".join(line.strip() for line in lines if line.strip())).unescape()


def section(template: str, **context) -> Markup:
    """A template of Markdown as HTML."""
    return Markup(MarkdownIt("commonmark").enable("table").render(environment().get_template(template).render(context)))


def page(template: str, **context) -> str:
    """The text of a template, filled in."""
    return environment().get_template(template).render(context)


def table(grid: formats.Grid, caption: str = "") -> Markup:
    """A grid as HTML, by blocks of columns, without blank lines: it may stand in Markdown."""
    parts = []
    for block in grid.blocks():
        texts = block.texts(formats.HTML)
        rows = [(label, kind, cells) for (label, *cells), kind in zip(texts.itertuples(name=None), block.kinds)]
        parts.append(page("table.html", corner=texts.index.name, heads=texts.columns, rows=rows, caption=caption))
    return Markup(re.sub(r"\n\s*\n", "\n", "".join(parts)))


def picture(path: Path, caption: str, alt: str = "") -> Markup:
    """A picture in the page (PNG, JPEG, SVG), no wider than the page; a tap shows it at its own size."""
    kind = TYPES.get(existing_file(path, "picture").suffix.lower())
    if kind is None:
        raise UserError(f"{path}: the report takes pictures of the kinds {', '.join(TYPES)}")
    data = Path(path).read_bytes()
    if kind == "image/png" and len(data) > LARGE:
        buffer = io.BytesIO()
        with Image.open(path) as image:
            image.convert("RGB").save(buffer, "JPEG", quality=90, subsampling=0)
        data, kind = buffer.getvalue(), "image/jpeg"
    source = f"data:{kind};base64,{base64.b64encode(data).decode()}"
    return Markup(page("picture.html", source=source, caption=caption, alt=alt or caption).strip())
