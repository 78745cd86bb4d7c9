"""How full a flash is."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Usage:
    """How full the flash is: messages, bytes, capacity in bytes, gaps ever recorded."""

    messages: int
    used: int
    capacity: int
    gaps: int
