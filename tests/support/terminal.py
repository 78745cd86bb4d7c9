"""A terminal for commands that look whether they have one."""

from __future__ import annotations

import os
from contextlib import suppress
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from types import TracebackType


class Terminal:
    """A pseudo-terminal, and what was written on it.

    Attributes:
        descriptor: What a process writes to.
    """

    def __init__(self) -> None:
        self._ours, self.descriptor = os.openpty()
        os.set_blocking(self._ours, False)
        self._shown = b""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        os.close(self._ours)
        os.close(self.descriptor)

    def look(self) -> str:
        """All that was written so far, escape sequences and all; it makes room for more."""
        with suppress(BlockingIOError):
            while True:
                self._shown += os.read(self._ours, 65536)
        return self._shown.decode(errors="replace")
