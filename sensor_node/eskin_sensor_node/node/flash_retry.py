"""Tolerates failing flash commits: sampling continues, and a gap reports the loss."""

from __future__ import annotations

import logging
from contextlib import contextmanager
from typing import TYPE_CHECKING

from eskin.errors import FlashError

if TYPE_CHECKING:
    from collections.abc import Iterator

log = logging.getLogger(__name__)


class FlashRetry:
    """Lets a node continue when a commit fails; the next gap reports what was lost.

    It logs the first failure, and the first success after it.
    """

    def __init__(self) -> None:
        self._failures = 0

    @contextmanager
    def commit(self) -> Iterator[None]:
        """Catch the error of a commit."""
        try:
            yield
        except FlashError as error:
            if self._failures == 0:
                log.error("flash commit failed, sampling continues: error=%s", error)  # noqa: TRY400 - one line
            self._failures += 1
            return
        if self._failures:
            log.warning("flash commit succeeded again: failed_commits=%d", self._failures)
            self._failures = 0
