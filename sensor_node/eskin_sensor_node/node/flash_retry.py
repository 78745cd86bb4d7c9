"""A flash that fails now and then: sampling goes on, and what was lost is told later."""

from __future__ import annotations

import logging
from contextlib import contextmanager
from typing import TYPE_CHECKING

from eskin.errors import FlashError

if TYPE_CHECKING:
    from collections.abc import Iterator

log = logging.getLogger(__name__)


class FlashRetry:
    """Lets a node go on when a commit fails; the next gap tells what was lost.

    It says so when the first one fails, and when one succeeds again.
    """

    def __init__(self) -> None:
        self._failures = 0

    @contextmanager
    def commit(self) -> Iterator[None]:
        """Make a commit that may fail."""
        try:
            yield
        except FlashError as error:
            if self._failures == 0:
                log.error("flash fails, sampling goes on: error=%s", error)  # noqa: TRY400 - says all
            self._failures += 1
            return
        if self._failures:
            log.warning("flash works again: failed_commits=%d", self._failures)
            self._failures = 0
