"""Logs of a process: one line an event, UTC, on standard error."""

from __future__ import annotations

import logging
import time

from eskin.errors import SettingsError

LEVELS = ("DEBUG", "INFO", "WARNING", "ERROR")


def start_logs(level: str) -> None:
    """Send logs to standard error.

    Raises:
        SettingsError: The level is none.
    """
    if level.upper() not in LEVELS:
        raise SettingsError(
            "log.level", f"{level!r} is not allowed; use one of {', '.join(LEVELS)}"
        )
    formatter = logging.Formatter(
        "%(asctime)s.%(msecs)03dZ %(levelname)s %(name)s %(message)s", "%Y-%m-%dT%H:%M:%S"
    )
    formatter.converter = time.gmtime
    handler = logging.StreamHandler()
    handler.setFormatter(formatter)
    root = logging.getLogger()
    root.addHandler(handler)
    root.setLevel(level.upper())
    # Libraries' own chatter is no event of ours.
    for chatty in ("httpx", "httpcore", "amqtt", "transitions"):
        logging.getLogger(chatty).setLevel(logging.WARNING)
