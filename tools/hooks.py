"""MkDocs hooks that add what is made: the pages of settings and licences, and the page of `relight web` if it is built.

`make docs` builds the latter into the folder `extra.demo` of tools/mkdocs.yml.
"""

import shutil
from pathlib import Path

import licences
import settings
from mkdocs.structure.files import File

PAGE = "viewer.md"
FRAME = """
<iframe src="../demo/index.html" title="Turn the light in a photo" loading="lazy" allow="fullscreen"
  style="width: 100%; height: 560px; border: 0; border-radius: 8px"></iframe>

<p><a href="../demo/index.html" target="_blank">On a page of its own</a></p>
"""


def _folder(config) -> Path:
    """Returns the folder of the demo from MkDocs' configuration."""
    return Path(config.config_file_path).parent / config.extra["demo"]


def on_files(files, *, config, **_) -> None:
    """Adds the pages of settings and licences (MkDocs' event for the list of files)."""
    for made in (settings, licences):
        files.append(File.generated(config, f"{made.__name__}.md", content=made.page()))


def on_page_markdown(markdown: str, *, page, config, **_) -> str:
    """Inserts the demo below the title of its page (MkDocs' event for the text of each page)."""
    if page.file.src_uri != PAGE or not (_folder(config) / "index.html").is_file():
        return markdown
    title, rest = markdown.split("\n", 1)
    return f"{title}\n{FRAME}{rest}"


def on_post_build(*, config, **_) -> None:
    """Copies the demo into the site (MkDocs' event after it has written all pages)."""
    if _folder(config).is_dir():
        shutil.copytree(_folder(config), Path(config.site_dir) / "demo", dirs_exist_ok=True)
