"""Reasons of gaps: codes, and their texts."""

from eskin_sensor_node.firmware.states import ORDERED, SCARCE

OVERRUN = 0
UNRECORDED = 1
FULL = 2
FAILED = 3
"""Sampling came too late; a recording has a gap; the storage had no room, or was not written."""
DEAD = 4
STUCK = 5
"""A taxel is broken, and reports no derived quantity."""
ASLEEP = {SCARCE: 6, ORDERED: 7}
"""Sampling was given up: by the cause."""
RESET = 8
"""The first one of the causes of a reset: on power, brown-out, watchdog, software."""

TEXTS = (
    "sampling overrun",
    "nothing recorded",
    "flash full",
    "flash write failed",
    "certainly dead",
    "certainly stuck",
    "deep sleep: " + SCARCE,
    "deep sleep: " + ORDERED,
    "power on reset",
    "brown-out reset",
    "watchdog reset",
    "software reset",
)
"""For people, by code."""


def reason_text(code: int, taxel: str) -> str:
    """The text of a code, with the taxel that is broken, where one is."""
    return taxel + " " + TEXTS[code] if taxel else TEXTS[code]
