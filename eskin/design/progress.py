"""A progress bar for a long set inversion."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.progress import Progress

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rich.console import Console


@contextmanager
def progress_bar(
    title: str = "inverting", *, console: Console | None = None
) -> Iterator[Callable[[float], None]]:
    """Show a bar while the block runs; what it gives goes to `invert` as ``progress``.

    Args:
        title: What stands before the bar.
        console: Where to show it; the terminal or notebook by default.
    """
    with Progress(console=console) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda share: bar.update(task, completed=share)
