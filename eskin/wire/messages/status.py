"""A node's status on the wire: what it is, what it measures, how it fares."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Final, Self

from eskin.errors import MessageError
from eskin.interval import Verdict
from eskin.wire.messages.cbor_map import MOST_COUNT, dump, integer, items, load, pair, real, text
from eskin.wire.messages.header import Kind, Position, position_fields, read_position
from eskin.wire.timestamp import MOST_INSTANT

if TYPE_CHECKING:
    from eskin.wire.messages.cbor_map import Fields

_FIELDS: Final = frozenset(range(1, 18))
_MOST_TAXELS: Final = 100
_MOST_BOOTS: Final = 8


class ResetCause(IntEnum):
    """Why a node started."""

    POWER_ON = 0
    BROWN_OUT = 1
    WATCHDOG = 2
    SOFTWARE = 3

    @property
    def label(self) -> str:
        """For people: ``power on``, ``brown-out``, ``watchdog`` or ``software``."""
        return "brown-out" if self is ResetCause.BROWN_OUT else self.name.lower().replace("_", " ")


class Shedding(IntEnum):
    """What a node does to save energy."""

    NONE = 0
    ADAPTIVE = 1
    PEAKS = 2
    SLEEP = 3


@dataclass(frozen=True, slots=True)
class Energy:
    """What a node knows of its energy.

    Attributes:
        stored: Bounds of what its supercapacitor holds, in J.
        charge: Bounds of its state of charge: 0 at brown-out, 1 when full.
        verdict: Whether it sustained itself over its horizon.
        shedding: How much load it sheds.
    """

    stored: tuple[float, float]
    charge: tuple[float, float]
    verdict: Verdict
    shedding: Shedding

    def encode(self) -> list[float | int]:
        """As a status states it."""
        return [*self.stored, *self.charge, int(self.verdict), int(self.shedding)]


@dataclass(frozen=True, slots=True)
class TaxelFaults:
    """A taxel that may be broken, by the latest window of its node's self-test.

    Attributes:
        taxel: Its name.
        dead: Whether its line is open.
        stuck: Whether it stays where it is.
    """

    taxel: str
    dead: Verdict
    stuck: Verdict


@dataclass(frozen=True, slots=True)
class Status:
    """How a node fares.

    Attributes:
        position: Boot and sequence.
        time: Enclosure of the instant, UTC ns.
        profile: Name of the node's design, such as ``fingertip``.
        description: One line for people.
        uptime: ns since the start.
        messages: Messages waiting in flash.
        used: Bytes waiting in flash.
        capacity: Bytes that flash may hold.
        gaps: Gaps recorded since the node was made.
        cause: Why it started; ``None`` where it does not say.
        energy: What it knows of its energy; ``None`` where it has a supply that never ends.
        faults: Taxels that may be broken; ``None`` before its first self-test.
        gateway_time: Time of a gateway's clock, UTC ns, in the latest acknowledgement that the node
            had received when it wrote this; ``None`` where it had received none.
        held: The lowest position that the node still held, or would give out next; all below it was
            acknowledged, or is named by a gap. ``None`` where it does not say.
        ended: ``(boot, last)`` of its latest former boots in which it kept a message: the greatest
            sequence of each, in order. ``None`` where it does not say.
    """

    position: Position
    time: tuple[int, int]
    profile: str
    description: str
    uptime: int
    messages: int
    used: int
    capacity: int
    gaps: int
    cause: ResetCause | None = None
    energy: Energy | None = None
    faults: tuple[TaxelFaults, ...] | None = None
    gateway_time: int | None = None
    held: Position | None = None
    ended: tuple[tuple[int, int], ...] | None = None

    def encode(self) -> bytes:
        """Write as CBOR."""
        cause = {} if self.cause is None else {12: int(self.cause)}
        return dump(
            position_fields(Kind.STATUS, self.position)
            | {4: list(self.time), 5: self.profile, 6: self.description, 7: self.uptime}
            | {8: self.messages, 9: self.used, 10: self.capacity, 11: self.gaps}
            | cause
            | ({} if self.energy is None else {13: self.energy.encode()})
            | ({} if self.faults is None else {14: [_encoded(each) for each in self.faults]})
            | ({} if self.gateway_time is None else {15: self.gateway_time})
            | ({} if self.held is None else {16: list(self.held)})
            | ({} if self.ended is None else {17: [list(each) for each in self.ended]})
        )

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Read a status.

        Raises:
            MessageError: It is none.
        """
        return cls.read(load(data))

    @classmethod
    def read(cls, fields: Fields) -> Self:
        """Read a status from its decoded fields."""
        fields.only(_FIELDS)
        return cls(
            position=read_position(fields),
            time=fields.instants(4),
            profile=fields.text(5, 64),
            description=fields.text(6, 200),
            uptime=fields.integer(7, 0, MOST_INSTANT),
            messages=fields.integer(8, 0, MOST_COUNT),
            used=fields.integer(9, 0, MOST_COUNT),
            capacity=fields.integer(10, 0, MOST_COUNT),
            gaps=fields.integer(11, 0, MOST_COUNT),
            cause=_cause(fields),
            energy=_energy(fields) if fields.has(13) else None,
            faults=_faults(fields) if fields.has(14) else None,
            gateway_time=(
                fields.integer(15, -MOST_INSTANT, MOST_INSTANT) if fields.has(15) else None
            ),
            held=_held(fields) if fields.has(16) else None,
            ended=_ended(fields) if fields.has(17) else None,
        )


def _cause(fields: Fields) -> ResetCause | None:
    return ResetCause(fields.integer(12, 0, max(ResetCause))) if fields.has(12) else None


def _energy(fields: Fields) -> Energy:
    found = fields.items(13, 6)
    if len(found) != 6:
        raise MessageError(f"field 13 holds {len(found)} items; expected 6")
    least, most, low, high = (
        real(found[k], "field 13", 0.0, math.inf if k < 2 else 1.0) for k in range(4)
    )
    if least > most or low > high:
        raise MessageError("field 13: a lower bound is above its upper bound")
    return Energy(
        (least, most),
        (low, high),
        _verdict(found[4], "field 13, verdict"),
        Shedding(integer(found[5], "field 13, shedding", 0, max(Shedding))),
    )


def _verdict(value: object, what: str) -> Verdict:
    return Verdict(integer(value, what, 0, max(Verdict)))


def _held(fields: Fields) -> Position:
    return Position(*_numbers(fields.raw(16), "field 16"))


def _ended(fields: Fields) -> tuple[tuple[int, int], ...]:
    return tuple(_numbers(each, "field 17") for each in fields.items(17, _MOST_BOOTS))


def _numbers(value: object, what: str) -> tuple[int, int]:
    """A boot and a sequence."""
    boot, sequence = pair(value, what)
    return integer(boot, what, 0, MOST_COUNT), integer(sequence, what, 0, MOST_COUNT)


def _encoded(faults: TaxelFaults) -> list[str | int]:
    return [faults.taxel, int(faults.dead), int(faults.stuck)]


def _faults(fields: Fields) -> tuple[TaxelFaults, ...]:
    return tuple(_fault(value) for value in fields.items(14, _MOST_TAXELS))


def _fault(value: object) -> TaxelFaults:
    found = items(value, "field 14", 3)
    if len(found) != 3:
        raise MessageError(f"field 14 holds {len(found)} items a taxel; expected 3")
    dead, stuck = (_verdict(each, "field 14, fault") for each in found[1:])
    if dead is stuck is Verdict.IMPOSSIBLE:
        raise MessageError("field 14 names a taxel that cannot be broken")
    return TaxelFaults(text(found[0], "field 14, taxel", 31), dead, stuck)
