"""Text of others, made safe for a log line or a terminal."""

from __future__ import annotations

from typing import Final

INDENT: Final = "    "


def printable(text: object) -> str:
    r"""A value as one line, with all that a terminal would obey or hide escaped.

    Escaped are control characters (C0, C1, DEL), line and paragraph separators (U+2028, U+2029),
    format characters (bidirectional overrides, zero width), surrogates and unassigned code points:
    what `str.isprintable` calls not printable. ``"a\nb"`` becomes ``"a\\nb"``.
    """
    line = str(text)
    if line.isprintable():
        return line
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode("ascii")
        for character in line
    )


def printable_lines(text: str) -> str:
    """Text of several lines, each `printable`; those after the first are indented by `INDENT`."""
    return f"\n{INDENT}".join(map(printable, text.split("\n")))
