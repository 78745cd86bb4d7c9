"""What a machine does: the counts that its energy follows from."""

from __future__ import annotations

from typing import NamedTuple


class Work(NamedTuple):
    """What the machine did in a span of time.

    Attributes:
        instructions: That its processor executed.
        conversions: Of its analogue-to-digital converter.
        sent: Bytes given to the radio, with repeats.
        received: Bytes.
        asleep: ns in deep sleep.
        span: ns, all in all.
        wakes: How often an interrupt woke the processor.
    """

    instructions: int
    conversions: int
    sent: int
    received: int
    asleep: int
    span: int
    wakes: int = 0
