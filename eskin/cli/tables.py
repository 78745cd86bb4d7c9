"""Tables on standard output."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.runtime.printable import printable

if TYPE_CHECKING:
    from rich.table import Table

_WIDE: Final = 1000


def add_row(table: Table, *cells: str, style: str | None = None) -> None:
    """Add a row of plain text: no markup and no control character of it counts."""
    from rich.text import Text

    table.add_row(*(Text(printable(cell)) for cell in cells), style=style)


def show(table: Table) -> None:
    """Print a table: as wide as the terminal, or as wide as it is where it goes to a program."""
    from rich.console import Console

    console = Console()
    if not console.is_terminal:
        console = Console(width=_WIDE)
    console.print(table)
