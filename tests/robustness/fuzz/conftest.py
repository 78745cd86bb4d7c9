from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture(autouse=True)
def levels() -> Iterator[None]:
    """Restore the levels of loggers, which targets silence."""
    loggers = [logging.getLogger(name) for name in ("eskin_cloud", "eskin_gateway", "eskin_ca")]
    before = [logger.level for logger in loggers]
    yield
    for logger, level in zip(loggers, before, strict=True):
        logger.setLevel(level)
