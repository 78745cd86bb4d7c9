"""Shows how far a long start is, while pytest captures all output."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    import pytest


def teller(config: pytest.Config) -> Callable[[str], None]:
    """A function that shows a line at once, with the seconds since now."""
    terminal = config.get_terminal_writer()
    capture = config.pluginmanager.getplugin("capturemanager")
    start = time.monotonic()

    def show(text: str) -> None:
        with capture.global_and_fixture_disabled():
            terminal.line(f"[{time.monotonic() - start:4.0f} s] {text}", flush=True)

    return show
