"""Small tables for notebooks, in HTML; colours are the notebook's own, light or dark."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

_EDGE: Final = 5
_LINE: Final = "border-bottom:1px solid rgba(128,128,128,.5)"
_CELL: Final = "padding:.1em .8em;text-align:right;white-space:nowrap"


def html_table(
    caption: str, heads: Sequence[str], count: int, row: Callable[[int], Sequence[str]]
) -> str:
    """A table of rows, of many the first and the last.

    Args:
        caption: What it is; plain text, as all cells are.
        heads: Names of the columns.
        count: How many rows there are.
        row: Gives the cells of one.
    """
    chosen = range(count) if count <= 2 * _EDGE else [*range(_EDGE), *range(count - _EDGE, count)]
    lines = ["".join(f'<td style="{_CELL}">{escape(cell)}</td>' for cell in row(k)) for k in chosen]
    if len(chosen) < count:
        lines.insert(_EDGE, f'<td colspan="{len(heads)}" style="text-align:center">⋮</td>')
    names = "".join(f'<th style="{_CELL};{_LINE}">{escape(head)}</th>' for head in heads)
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    return (
        f'<table style="border-collapse:collapse;color:inherit;font:inherit">'
        f'<caption style="text-align:left;white-space:nowrap;color:inherit">'
        f"{escape(caption)}</caption><thead><tr>{names}</tr></thead><tbody>{body}</tbody></table>"
    )


def html_text(text: str) -> str:
    """Text as it stands."""
    return f"<pre>{escape(text)}</pre>"
