"""What a machine does: the counts that its energy follows from."""

from __future__ import annotations

from typing import NamedTuple


class WorkCounters(NamedTuple):
    """What the machine did in a span of time.

    Attributes:
        cycles: Of its processor, at most.
        conversions: Of its analogue-to-digital converter.
        sent: Bytes given to the radio, with repeats.
        received: Bytes.
        written: Bytes put into flash.
        wakes: How often an interrupt woke the processor.
        fewest: Cycles of its processor, at least.
        asleep: ns in deep sleep, at least.
        on: ns with power.
        span: ns, all in all.
    """

    cycles: int = 0
    conversions: int = 0
    sent: int = 0
    received: int = 0
    written: int = 0
    wakes: int = 0
    fewest: int = 0
    asleep: int = 0
    on: int = 0
    span: int = 0
