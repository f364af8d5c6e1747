"""The viewer: one .html with figures and lights that works from disk, without a network, and relights as you drag."""

import html
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from relight.core.errors import UserError
from relight.core.files import write_text
from relight.core.progress import progress
from relight.lights.place import STATISTICS
from relight.sh import deringed
from relight.viewer.bundle import bundle
from relight.viewer.figure import Figure, embed

PAGE = Path(__file__).parent / "web" / "page"
BACKGROUNDS = ("studio", "light", "color", "clear", "photo")
LIMIT = 6_000_000  # bytes of a page with one figure
FURTHER = 2_500_000  # bytes that the limit grows by with each further one
FIGURE_MARKUP = 200  # bytes of HTML around each figure, at most
POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"


@dataclass(frozen=True)
class Additions:
    """What a page has beyond the viewer, such as the site that opens photos; by default nothing.

    Attributes:
        script: the module that runs.
        policy: the page's content security policy.
        style: CSS.
        stage: HTML on the stage, beside the picture.
        panel: HTML at the top of the panel.
        worker: a script that the page starts as a worker.
        settings: JSON values for `script`.
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
    figures: Sequence[Figure],
    lights: Mapping[str, np.ndarray],
    background: str | None = None,
    title: str = "relight",
    limit: int | None = None,
    additions: Additions = VIEWER,
) -> None:
    """Writes the page of one or several figures, which it offers by their titles.

    Args:
        out: the page (.html).
        figures: in the order shown.
        lights: radiance coefficients (9,3) by name, in the order shown. The first one lights the first picture, unless
            the figure brings the light of its photo.
        background: the first one shown, of BACKGROUNDS; by default a photo's own, else the studio.
        title: title of the page.
        limit: bytes of the page; by default LIMIT, and FURTHER for each figure after the first. Figures are coded as
            finely as fits (figure.QUALITIES), or made smaller.
        additions: what the page has beyond the viewer.

    Raises:
        UserError: if there is no figure or light, or the background or a light is invalid.
    """
    if not figures or not lights:
        raise UserError("a viewer page needs at least one figure and one light")
    if background is not None and background not in BACKGROUNDS:
        raise UserError(f"background '{background}' is not one of {', '.join(BACKGROUNDS)}")
    for name, light in lights.items():
        if np.shape(light) != (9, 3) or not np.isfinite(light).all():
            raise UserError(f"light '{name}' is not (9, 3) finite coefficients but {np.shape(light)}")
    # The page estimates the light of a place from a picture of it, as `relight.lights.place` does, by its statistics.
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
    template = (PAGE / "template.html").read_text(encoding="utf-8")
    limit = limit or LIMIT + FURTHER * (len(figures) - 1)
    bytes_for_figures = limit - len(template) - sum(map(len, parts.values()))
    bytes_for_maps = bytes_for_figures // len(figures) - FIGURE_MARKUP
    parts["figures"] = "\n".join(
        f'<script type="application/json" class="figure" data-title="{html.escape(figure.title)}" '
        f'data-source="{html.escape(figure.source)}">{embed(figure, bytes_for_maps)}</script>'
        for figure in progress(figures, "figures coded")
    )
    write_text(out, re.sub(f"%({'|'.join(parts)})%", lambda match: parts[match[1]], template))
