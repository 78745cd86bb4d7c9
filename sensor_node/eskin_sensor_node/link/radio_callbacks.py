"""What the radio asks of its node, and tells it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(frozen=True, slots=True)
class RadioCallbacks:
    """A node, as its radio sees it.

    Attributes:
        record_status: Puts a fresh status into the outbox.
        take_command: Takes a command that was sealed to this node; ``None``: it obeys none.
        attend: Hears for how many seconds somebody is expected to look on.
        is_running: Whether the firmware runs; while it does not, nothing is sent or taken.
    """

    record_status: Callable[[], object]
    take_command: Callable[[bytes], None] | None = None
    attend: Callable[[float], None] = lambda _: None
    is_running: Callable[[], bool] = lambda: True
