"""Hook of MkDocs: adds pages from outside of ``docs``, and a page of reference for each package."""

from __future__ import annotations

import posixpath
import re
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Final

from mkdocs.structure.files import File

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

ROOT: Final = Path(__file__).parents[2]
_TOP: Final = ("CHANGELOG.md", "CONTRIBUTING.md")
_LINK: Final = re.compile(r"\[(?P<text>[^\]\[]*)\]\((?P<target>[^)#\s]+)(?P<anchor>#[^)\s]*)?\)")
REFERENCE: Final = (
    "eskin",
    "eskin.interval",
    "eskin.tube",
    "eskin.peaks",
    "eskin.constants",
    "eskin.models",
    "eskin.models.icm",
    "eskin.noise",
    "eskin.design",
    "eskin.figures",
    "eskin.client",
    "eskin.errors",
    "eskin.wire.messages",
    "eskin.wire.envelope",
    "eskin.identity",
    "eskin.privacy",
)
"""Packages whose public names the reference describes."""


def on_config(config: MkDocsConfig) -> None:
    """Add the reference to the navigation."""
    assert config.nav is not None
    config.nav.append({"Reference": [{name: f"reference/{name}.md"} for name in REFERENCE]})


def on_files(files: Files, config: MkDocsConfig) -> None:
    """Add the pages that are not in ``docs``."""
    for name in _TOP:
        files.append(File.generated(config, name, abs_src_path=str(ROOT / name)))
    for name in REFERENCE:
        page = f"# `{name}`\n\n::: {name}\n"
        if name == "eskin":
            # The rest of what `import eskin` offers has pages of its own.
            page += "    options:\n      members: [connect]\n"
        files.append(File.generated(config, f"reference/{name}.md", content=page))
        assert import_module(name).__doc__


def on_page_markdown(markdown: str, page: Page, files: Files, **_: object) -> str:
    """Rewrite links that leave ``docs``: to their page in the site, or to plain text."""
    source = page.file.src_uri
    folder = "" if source in _TOP else f"docs/{posixpath.dirname(source)}"

    def rewritten(link: re.Match[str]) -> str:
        target = link["target"]
        if re.match(r"[a-z]+:", target):
            return link[0]
        path = posixpath.normpath(posixpath.join(folder, target))
        inside = path.removeprefix("docs/") if path.startswith("docs/") else path
        for name in (inside, posixpath.join(inside, "README.md")):
            if (path.startswith("docs/") or name in _TOP) and files.get_file_from_path(name):
                relative = posixpath.relpath(name, posixpath.dirname(source) or ".")
                return f"[{link['text']}]({relative}{link['anchor'] or ''})"
        return link["text"] if "`" in link["text"] else f"{link['text']} (`{path}`)"

    return _LINK.sub(rewritten, markdown)
