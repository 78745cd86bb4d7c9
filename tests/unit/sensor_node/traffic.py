"""Byte counts of a radio, without energy."""

from __future__ import annotations


class Traffic:
    """A meter that only counts bytes."""

    def __init__(self) -> None:
        self.sent = self.received = 0
