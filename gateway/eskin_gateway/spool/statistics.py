"""How a gateway's spool fares, in figures."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SpoolStatistics:
    """How the spool fares.

    Attributes:
        messages: Messages waiting for the cloud.
        used: Their bytes.
        capacity: Most bytes.
        dead_letters: Dead letters kept.
        dropped_letters: Dead letters that gave way to newer ones since the start.
    """

    messages: int
    used: int
    capacity: int
    dead_letters: int
    dropped_letters: int
