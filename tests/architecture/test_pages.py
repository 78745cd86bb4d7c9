"""What pages refer to exists: links, tests, paths, modules, make targets."""

from __future__ import annotations

import ast
import pkgutil
import posixpath
import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT: Final = Path(__file__).parents[2]
PAGES: Final = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
NAMED: Final = re.compile(r"`(?:tests/)?((?:\w+/)*test_\w+\.py)(?:::(\w+))?`")
FOUND: Final = sorted(
    {
        (str(page.relative_to(ROOT)), file, name)
        for page in PAGES
        for file, name in NAMED.findall(page.read_text())
    }
)
_LINK: Final = re.compile(r"\]\((?![a-z]+:)([^)#\s]*)(?:#([^)\s]*))?\)")
_FOLDERS: Final = "eskin|sensor_node|gateway|cloud|ca_service|services|tests|benchmarks|docs"
_PATH: Final = re.compile(rf"(?<![\w/.-])((?:{_FOLDERS})/[\w./-]*\w)(?![\w{{*])")
# Topics begin like the package's folder, and these are examples of a user's own files.
_NO_PATH: Final = re.compile(r"eskin/v1|sensor_node/\w+\.wav")
_MODULE: Final = re.compile(r"python -m ((?:tests|benchmarks|eskin\w*)(?:\.\w+)*)")
_NAME: Final = re.compile(r"`(eskin(?:_\w+)?(?:\.\w+)+)")
_TARGET: Final = re.compile(r"(?:`make ([a-z-]+)|^make ([a-z-]+)(?=\s*#|$| ARGS))", re.MULTILINE)
_NO_MODULE: Final = {"toml", "dump", "sqlite"}


@cache
def anchors(page: Path) -> frozenset[str]:
    """Anchors of a page's headings, as GitHub and MkDocs make them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    plain = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading) for heading in headings]
    return frozenset(
        re.sub(r"[^\w\- ]", "", each.lower()).strip().replace(" ", "-") for each in plain
    )


def exists(name: str) -> bool:
    """Whether a dotted name is a module, or something in one."""
    try:
        pkgutil.resolve_name(name)
    except (ImportError, AttributeError):
        return False
    return True


def broken_links(page: Path) -> Iterator[str]:
    """Links of a page to files or headings that do not exist."""
    for target, anchor in _LINK.findall(page.read_text()):
        path = Path(posixpath.normpath(page.parent / target)) if target else page
        if not path.exists():
            yield target
        elif anchor and path.suffix == ".md" and anchor not in anchors(path):
            yield f"{target}#{anchor}"


def unknown_names(page: Path) -> Iterator[str]:
    """Paths, modules, Python names and make targets in a page that do not exist."""
    text = page.read_text()
    for path in set(_PATH.findall(text)):
        if not _NO_PATH.match(path) and not (ROOT / path).exists():
            yield path
    names = {each for each in _NAME.findall(text) if each.rpartition(".")[2] not in _NO_MODULE}
    for name in {*_MODULE.findall(text), *names}:
        if not exists(name):
            yield name
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for target in {quoted or typed for quoted, typed in _TARGET.findall(text)} - targets:
        yield f"make {target}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_page_refers_to_what_exists(page: Path) -> None:
    assert [*broken_links(page), *unknown_names(page)] == []


@pytest.mark.parametrize(("page", "file", "name"), FOUND)
def test_test_that_a_page_names_exists(page: str, file: str, name: str) -> None:
    tree = ast.parse((ROOT / "tests" / file).read_text())
    functions = {
        node.name
        for node in tree.body
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and node.name.startswith("test_")
    }
    assert functions, f"{page}: {file} has no test functions"
    assert not name or name in functions


def test_pages_name_tests() -> None:
    assert {page for page, _, _ in FOUND} >= {"docs/threat-model.md", "docs/delivery.md"}


def test_index_lists_each_page() -> None:
    index = (ROOT / "docs" / "README.md").read_text()
    pages = {page.name for page in (ROOT / "docs").glob("*.md")} - {"README.md"}
    assert {page for page in pages if f"]({page})" not in index} == set()


def test_decisions_are_listed() -> None:
    listed = (ROOT / "docs" / "adr" / "README.md").read_text()
    pages = {page.name: page.read_text() for page in (ROOT / "docs" / "adr").glob("0*.md")}
    rows = dict(re.findall(r"^\| \[\d+\]\((\S+)\) \| (.+) \|$", listed, re.MULTILINE))
    titles = {name: re.sub(r"^# \d+\.? ", "", text.splitlines()[0]) for name, text in pages.items()}
    assert rows == titles
