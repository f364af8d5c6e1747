"""The viewer: one .html with figures and lights that works from disk, without a network, and relights as you drag."""

import html
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from relight.errors import UserError
from relight.files import atomic_write
from relight.lights.place import STATISTICS
from relight.maps import Maps
from relight.progress import progress
from relight.sh import deringed
from relight.viewer.bundle import bundle
from relight.viewer.figure import Figure, embed

PAGE = Path(__file__).parent / "web" / "page"
BACKGROUNDS = ("studio", "light", "color", "clear", "photo")
LIMIT = 6_000_000  # bytes of a page with one figure
FURTHER = 2_500_000  # bytes that the limit grows by with each further one
POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"


@dataclass(frozen=True)
class Additions:
    """What a page has beyond the viewer, which by itself it has not.

    script: the module that runs; policy: content security policy; style: CSS; stage, panel: HTML on the stage and at
    the panel's top; worker: a script that the page starts; settings: JSON values for the script.
    """

    script: Path = PAGE / "main.js"
    policy: str = POLICY
    style: str = ""
    stage: str = ""
    panel: str = ""
    worker: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)


VIEWER = Additions()


def build_viewer(
    out: Path,
    maps: Maps,
    lights: Mapping[str, np.ndarray],
    photo: np.ndarray | None = None,
    photo_light: np.ndarray | None = None,
    background: str | None = None,
    title: str = "relight",
    limit: int | None = None,
) -> None:
    """Writes the page of one figure: the first arguments are those of `Figure`, the others those of `build_gallery`."""
    build_gallery(out, [Figure(title, maps, photo, photo_light)], lights, background, title, limit)


def build_gallery(
    out: Path,
    figures: Sequence[Figure],
    lights: Mapping[str, np.ndarray],
    background: str | None = None,
    title: str = "relight",
    limit: int | None = None,
) -> None:
    """Writes one page for several figures, which it offers by their titles.

    Args:
        out: the page (.html).
        figures: in the order shown.
        lights: radiance coefficients (9,3) by name, in the order shown. The first one lights the first picture, unless
            the figure brings the light of its photo.
        background: the first one shown, of BACKGROUNDS; by default a photo's own, else the studio.
        title: title of the page.
        limit: bytes of the page; by default LIMIT, and FURTHER for each figure after the first. Figures are coded as
            finely as fits (figure.QUALITIES).

    Raises:
        UserError: if the figures do not fit, or there is no figure or light.
    """
    text = page_text(figures, lights, background, title, limit)
    with atomic_write(out) as temporary:
        temporary.write_text(text, encoding="utf-8")


def page_text(
    figures: Sequence[Figure],
    lights: Mapping[str, np.ndarray],
    background: str | None = None,
    title: str = "relight",
    limit: int | None = None,
    additions: Additions = VIEWER,
) -> str:
    """Returns the HTML that `build_gallery` writes, with its arguments and errors; additions: to the viewer."""
    if not figures or not lights:
        raise UserError("a viewer page needs at least one figure and one light")
    if background is not None and background not in BACKGROUNDS:
        raise UserError(f"background '{background}' is not one of {', '.join(BACKGROUNDS)}")
    for name, light in lights.items():
        if np.shape(light) != (9, 3) or not np.isfinite(light).all():
            raise UserError(f"light '{name}' is not (9, 3) finite coefficients but {np.shape(light)}")
    place = json.loads(STATISTICS.read_text(encoding="utf-8"))
    page = {
        "title": title,
        "background": background,
        "lights": [{"name": name, "values": deringed(light).round(6).tolist()} for name, light in lights.items()],
        "place": {key: place[key] for key in ("light", "limits", "level")},
        **additions.settings,
    }
    parts = {
        "title": html.escape(title),
        "page": json.dumps(page).replace("<", "\\u003c"),
        "policy": additions.policy,
        "style": (PAGE / "style.css").read_text(encoding="utf-8") + additions.style,
        "stage": additions.stage,
        "panel": additions.panel,
        "worker": additions.worker and f'<script type="x-worker" id="worker">\n{additions.worker}</script>\n',
        "fragment": (PAGE / "figure.frag").read_text(encoding="utf-8").strip(),
        "script": bundle(additions.script),
    }
    text = (PAGE / "template.html").read_text(encoding="utf-8")
    limit = limit or LIMIT + FURTHER * (len(figures) - 1)
    room = (limit - len(text) - sum(map(len, parts.values())) - 200 * len(figures)) // len(figures)
    parts["figures"] = "\n".join(
        f'<script type="application/json" class="figure" data-title="{html.escape(figure.title)}" '
        f'data-source="{html.escape(figure.source)}">'
        f"{embed(figure, room)}</script>"
        for figure in progress(figures, "figures coded")
    )
    return re.sub(f"%({'|'.join(parts)})%", lambda match: parts[match[1]], text)
