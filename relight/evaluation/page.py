"""A report as one HTML file: sections of words, tables and pictures, all inside it, readable offline and on a phone."""

import base64
import io
import re
from dataclasses import dataclass
from html import escape
from pathlib import Path

from jinja2 import Environment, PackageLoader
from PIL import Image

from relight.files import UserError, existing, whole

TYPES = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg", ".svg": "image/svg+xml"}
LARGE = 800_000  # bytes; larger PNGs go into the page as JPEGs of the same pixels


@dataclass
class Section:
    """html: the body, from the functions below or by hand (it goes in as it is); aside: a line under the title."""

    title: str
    html: str
    aside: str = ""


def build_page(title: str, sections: list[Section], out: Path, lead: str = "") -> None:
    """Writes the page, whole or not at all. lead: a few words of plain text under the title.

    The bytes depend on nothing but the arguments: there is no date in it.
    """
    names = {}
    for section in sections:
        name = re.sub(r"[^a-z0-9]+", "-", section.title.lower()).strip("-") or "section"
        names[id(section)] = name if name not in names.values() else f"{name}-{len(names)}"
    environment = Environment(loader=PackageLoader("relight.evaluation", "."), autoescape=True, trim_blocks=True)
    text = environment.get_template("page.html").render(
        title=title, lead=lead, sections=[(names[id(section)], section) for section in sections]
    )
    with whole(out) as tmp:
        tmp.write_text(text, encoding="utf-8")


def prose(text: str) -> str:
    """Paragraphs (blank lines between), **bold** and `code` of Markdown."""
    parts = []
    for paragraph in re.split(r"\n\s*\n", text.strip()):
        words = re.sub(r"\*\*(.+?)\*\*", r"<b>\1</b>", escape(paragraph, quote=False))
        parts.append("<p>" + re.sub(r"`(.+?)`", r"<code>\1</code>", words) + "</p>")
    return "\n".join(parts)


def grid(heads: list[str], rows: list[list], caption: str = "") -> str:
    """A plain table. Numbers are right-aligned, floats shown to three significant digits."""
    out = ["<div class=scroll><table>"]
    if caption:
        out.append(f"<caption>{escape(caption)}</caption>")
    out.append("<thead><tr>" + "".join(f"<th scope=col>{escape(head)}" for head in heads) + "<tbody>")
    for row in rows:
        cells = "".join(
            f"<td class=number>{value:.3g}"
            if isinstance(value, float)
            else f"<td class=number>{value}"
            if isinstance(value, int)
            else f"<td>{escape(str(value))}"
            for value in row
        )
        out.append(f"<tr>{cells}")
    return "\n".join([*out, "</table></div>"])


def settings_list(settings: dict, prefix: str = "") -> str:
    """Nested settings as a table of dotted names and values."""
    rows: list[list] = []

    def walk(part: dict, name: str) -> None:
        for key, value in part.items():
            if isinstance(value, dict) and value:
                walk(value, f"{name}{key}.")
            else:
                rows.append([f"{name}{key}", "none" if value is None else str(value)])

    walk(settings, prefix)
    return grid(["setting", "value"], rows)


def picture(path: Path, caption: str, alt: str = "") -> str:
    """A picture in the page (PNG, JPEG, SVG), as wide as the page; a tap shows it at its own size."""
    kind = TYPES.get(existing(path, "picture").suffix.lower())
    if kind is None:
        raise UserError(f"{path}: the report takes pictures of the kinds {', '.join(TYPES)}")
    data = Path(path).read_bytes()
    if kind == "image/png" and len(data) > LARGE:
        buffer = io.BytesIO()
        with Image.open(path) as image:
            image.convert("RGB").save(buffer, "JPEG", quality=90, subsampling=0)
        data, kind = buffer.getvalue(), "image/jpeg"
    code = base64.b64encode(data).decode()
    alt = escape(alt or caption)
    return (
        f'<figure><label class=zoom><input type=checkbox aria-label="show at full size">'
        f'<span><img src="data:{kind};base64,{code}" alt="{alt}"></span></label>'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def fold(summary: str, html: str) -> str:
    """A part that opens when asked for."""
    return f"<details><summary>{escape(summary)}</summary>\n{html}\n</details>"
