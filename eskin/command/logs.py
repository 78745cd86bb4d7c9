"""Logs of a process: one line an event, UTC, on standard error."""

from __future__ import annotations

import logging
import time


def start_logs(level: str) -> None:
    """Send logs of a level and above to standard error."""
    formatter = logging.Formatter(
        "%(asctime)s.%(msecs)03dZ %(levelname)s %(name)s %(message)s", "%Y-%m-%dT%H:%M:%S"
    )
    formatter.converter = time.gmtime
    handler = logging.StreamHandler()
    handler.setFormatter(formatter)
    root = logging.getLogger()
    root.addHandler(handler)
    root.setLevel(level)
    # Libraries' own chatter is no event of ours.
    for chatty in ("httpx", "httpcore", "amqtt", "transitions"):
        logging.getLogger(chatty).setLevel(logging.WARNING)
    # Nor is a stranger's bad request: with a line for each, whoever likes could fill the disk.
    logging.getLogger("uvicorn").setLevel(logging.ERROR)
