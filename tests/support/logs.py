"""What a process would write into its log."""

from __future__ import annotations

import io
import logging
from contextlib import contextmanager
from typing import TYPE_CHECKING

from eskin.runtime.logs import ThrottledHandler

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


@contextmanager
def log_lines() -> Iterator[Callable[[], list[str]]]:
    """What `start_logs` would have this process write so far, all in one window."""
    handler = ThrottledHandler(lambda: 0.0)
    stream = handler.stream = io.StringIO()
    root = logging.getLogger()
    before = root.level
    root.addHandler(handler)
    root.setLevel(logging.WARNING)
    try:
        yield lambda: stream.getvalue().split("\n")[:-1]
    finally:
        root.setLevel(before)
        root.removeHandler(handler)
