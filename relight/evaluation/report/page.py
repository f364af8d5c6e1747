"""Renders the report's page from jinja templates of Markdown and HTML, with embedded pictures."""

import base64
import io
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markdown_it import MarkdownIt
from markupsafe import Markup
from PIL import Image

from relight.core.files import existing_file
from relight.evaluation.report import formats
from relight.evaluation.scoring.comparisons import MARGIN, Verdict
from relight.evaluation.scoring.statistics import ALPHA, MIN_SUBJECTS
from relight.settings.scores import column_label

LARGE = 400_000  # bytes; larger PNGs are embedded as JPEGs of the same size in pixels


@cache
def environment() -> Environment:
    """Returns the environment of the templates: values are escaped, and undefined names are errors."""
    loader = PackageLoader("relight.evaluation.report")
    made = Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined)
    made.filters |= {"number": formats.number, "count": formats.count, "column": column_label}
    made.globals |= {"table": formats.to_markdown, "picture": picture}
    made.globals |= {"ALPHA": ALPHA, "MARGIN": MARGIN, "MIN_SUBJECTS": MIN_SUBJECTS, "Verdict": Verdict}
    return made


def text(template: str, **context: Any) -> str:
    """Renders a template as plain text, such as the note under a table."""
    lines = environment().get_template(template).render(context).splitlines()
    return Markup(" ".join(line.strip() for line in lines if line.strip())).unescape()


def section(template: str, **context: Any) -> Markup:
    """Renders a template of Markdown as HTML."""
    html = MarkdownIt("commonmark").enable("table").render(environment().get_template(template).render(context))
    return Markup(html.replace(" ± ", "\u00a0±\u00a0").replace(" %", "\u00a0%"))  # so that lines do not break there


def page(template: str, **context: Any) -> str:
    """Renders a template as it is, such as HTML."""
    return environment().get_template(template).render(context)


def picture(path: Path, caption: str) -> Markup:
    """Embeds a picture (PNG) as HTML, scaled to the page; a click shows it at full size."""
    data, kind = existing_file(path, "picture").read_bytes(), "image/png"
    if len(data) > LARGE:
        buffer = io.BytesIO()
        with Image.open(path) as image:
            image.convert("RGB").save(buffer, "JPEG", quality=90, subsampling=0)
        data, kind = buffer.getvalue(), "image/jpeg"
    source = f"data:{kind};base64,{base64.b64encode(data).decode()}"
    return Markup(page("picture.html", source=source, caption=caption).strip())
