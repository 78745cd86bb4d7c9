"""What the firmware's operations take of the processor: cycles, at least and at most.

Instructions of the inner operations are counted: in C, compiled for the emulated Cortex-M33, run in
QEMU, and equal to the firmware's Python to the same bit (``tests.robustness.cortex_m33`` writes the
table, and compares with it). An instruction's cycles are bounded, by the Cortex-M4's table. What
nothing counts is assumed, and stands here.
"""

from __future__ import annotations

import tomllib
from importlib.resources import files
from math import ceil, floor
from typing import TYPE_CHECKING, Final, NamedTuple

from eskin_sensor_node.kinds.registry import KINDS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

BILLION: Final = 1_000_000_000


class Cycles(NamedTuple):
    """Of the processor.

    Attributes:
        least: So many at least.
        most: So many at most.
    """

    least: int
    most: int

    def plus(self, other: Cycles) -> Cycles:
        """Both."""
        return Cycles(self.least + other.least, self.most + other.most)

    def times(self, n: int) -> Cycles:
        """So many times the same."""
        return Cycles(n * self.least, n * self.most)

    def span(self, clock_hz: int) -> int:
        """How many ns they take at most."""
        return self.most * BILLION // clock_hz


NONE: Final = Cycles(0, 0)
"""No work at all."""


def _counted() -> dict[str, Cycles]:
    """The counted ones, from the table."""
    text = files("eskin_sensor_node.machine").joinpath("instructions.toml").read_text("utf-8")
    table = tomllib.loads(text)
    rates = table["cycles"]
    return {
        name: Cycles(floor(low * rates[name][0]), ceil(high * rates[name][1]))
        for name, (low, high) in table["instructions"].items()
    }


PRICES: Final[Mapping[str, Cycles]] = _counted() | {
    "interrupt": Cycles(100, 200),
    "frame": Cycles(2_000, 10_000),
    "message": Cycles(20_000, 60_000),
    "self_test": Cycles(150, 900),
    **{kind.chain: Cycles(*kind.cycles) for kind in KINDS.values() if kind.cycles is not None},
}
"""Of each operation; assumed are an interrupt (entry, taking codes out of a buffer, exit), a frame
(schedule, states), a message (flash driver, MQTT, TLS records, IP), a sample of a skin in its
self-test, and kinds without a count."""
CORTEX_A53: Final[Mapping[str, Cycles]] = {
    "pad": Cycles(250, 1_700),
    "neighbour": Cycles(15, 130),
    "remembered": Cycles(12, 120),
    "self_test": Cycles(15, 150),
    "encode_frame": Cycles(30, 200),
    "seal_byte": Cycles(2, 40),
}
"""Of a processor that computes binary64 in hardware. Operations are those of the firmware, counted
in a test. At most: one after the other, each with its latency as LLVM's model of the Cortex-A53 has
it (6 cycles an addition or a product, 33 a division, 4 an access) and 2 a branch. At least: two
instructions a cycle, and 29 cycles a division. Encoding and sealing are assumed, as AES is in
instructions or in tables; what is not here takes as many cycles as on a Cortex-M33, at most."""
PROCESSORS: Final[Mapping[str, Mapping[str, Cycles]]] = {
    "cortex-m33": PRICES,
    "cortex-a53": {**PRICES, **CORTEX_A53},
}
"""Prices of each processor that a machine may have."""
ENVELOPE: Final = 160
"""Bytes of COSE_Encrypt0 around a message: headers, salt, key names, tag."""
_SEALED: Final = 2
"""How often a message is enciphered: in its envelope, and in TLS."""


def inversion(
    chain: str,
    n: int,
    neighbours: int,
    new: Mapping[str, int],
    prices: Mapping[str, Cycles] = PRICES,
) -> Cycles:
    """Of the inversion of a frame.

    Args:
        chain: The taxel's.
        n: Samples.
        neighbours: How many were measured at the same instants.
        new: Of each sensor that is read along, its chain, and how many codes were new.
        prices: Of the processor.
    """
    total = prices[chain].plus(prices["neighbour"].times(neighbours))
    total = total.plus(prices["remembered"].times(len(new))).times(n)
    for sensor, times in new.items():
        total = total.plus(prices[f"new_{sensor}"].times(times))
    return total


def passes(*, rest: bool, peaks: bool, smoothed: bool = False) -> Cycles:
    """Of the passes over a channel's bounds, each sample: its rest, smoothing, the search."""
    names = (("rest", rest), ("peaks", peaks), ("smoothing", smoothed))
    total = NONE
    for name, done in names:
        total = total.plus(PRICES[name]) if done else total
    return total


def message(size: int, samples: int = 0) -> Cycles:
    """Of a message of so many bytes that is written, kept, and sent.

    Args:
        size: Its bytes, without its envelope.
        samples: How many samples it holds; 0: it states something.
    """
    sealed = PRICES["seal_byte"].times(size + ENVELOPE).plus(PRICES["seal_message"]).times(_SEALED)
    total = PRICES["message"].plus(sealed)
    if not samples:
        return total.plus(PRICES["peak"])
    return total.plus(PRICES["encode_frame"].times(samples))


class StretchCycles(NamedTuple):
    """Of a stretch of a skin, by purpose.

    Attributes:
        inversion: From codes to pressures, with neighbours and the air.
        channels: The self-test.
        messages: Frames: encoded, enciphered, kept and sent.
        frames: Interrupts, schedules, states.
    """

    inversion: Cycles
    channels: Cycles
    messages: Cycles
    frames: Cycles

    @property
    def total(self) -> Cycles:
        """All of it."""
        found = NONE
        for each in self:
            found = found.plus(each)
        return found


def stretch(
    processor: str,
    chain: str,
    *,
    taxels: int,
    rows: int,
    neighbours: int,
    along: Sequence[str],
    sizes: Sequence[int],
) -> StretchCycles:
    """Of a stretch of a skin.

    Args:
        processor: A key of `PROCESSORS`.
        chain: Of each taxel.
        taxels: How many.
        rows: Samples of each.
        neighbours: Of a taxel, at most.
        along: Chains of the sensors that are read along.
        sizes: Bytes of each frame, without its envelope.
    """
    prices = PROCESSORS[processor]
    inverted = inversion(chain, taxels * rows, neighbours, dict.fromkeys(along, rows), prices)
    written = prices["encode_frame"].times(taxels * rows)
    for size in sizes:
        sealed = prices["seal_byte"].times(size + ENVELOPE).plus(prices["seal_message"])
        written = written.plus(prices["message"]).plus(sealed.times(_SEALED))
    return StretchCycles(
        inverted,
        prices["self_test"].times(taxels * rows),
        written,
        prices["frame"].plus(prices["interrupt"].times(rows)),
    )
