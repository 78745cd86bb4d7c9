"""Statements: what a node concludes from a stretch of samples, or had to give up of it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag
from itertools import pairwise
from typing import Final, NamedTuple, Self, TypeAlias

from eskin.errors import MessageError
from eskin.interval import Verdict
from eskin.wire.frames.content_hash import HASH_BYTES
from eskin.wire.frames.layout import MOST_PATCHES
from eskin.wire.frames.sample_codec import MOST_COLUMNS
from eskin.wire.messages.cbor_map import (
    MOST_BYTES,
    MOST_COUNT,
    Fields,
    dump,
    integer,
    integer_pair,
    items,
    load,
    pair,
    read_span,
    real,
    row,
    text,
)
from eskin.wire.messages.command import TAXEL
from eskin.wire.messages.header import Kind, Position, position_fields, read_position
from eskin.wire.timestamp import MOST_INSTANT

Bounds: TypeAlias = "tuple[float, float]"
Counts: TypeAlias = "tuple[int, int]"
Instants: TypeAlias = "tuple[int, int]"

MOST_STATEMENTS: Final = 1000
"""Of one kind in one message."""
_FIELDS: Final = frozenset(range(1, 9))
_MOST_SPANS: Final = 64
_MOST_LINKS: Final = 64
_REASON_LENGTH: Final = 100
_MONITOR_LENGTH: Final = 31


class Peak(NamedTuple):
    """A certain peak of a column, or a region with a number of possible ones.

    Attributes:
        patch: Number of its patch in the layout; height and prominence have its unit.
        column: Its channel.
        time: UTC ns, from the sample before it to the sample after it.
        verdict: Certain or possible.
        counts: Fewest and most peaks: 1, 1 if certain; 0, n if possible.
        height: Enclosure of the greatest value in that time.
        prominence: Enclosure of the prominence.
        coverage: Probability of the whole statement.
    """

    patch: int
    column: int
    time: Instants
    verdict: Verdict
    counts: Counts
    height: Bounds
    prominence: Bounds
    coverage: float


class Link(NamedTuple):
    """Whether a contact continues one of an earlier instant.

    Attributes:
        contact: Label of the earlier one.
        verdict: Certain or possible.
    """

    contact: int
    verdict: Verdict


class Contact(NamedTuple):
    """A contact with a certain core, or a region that may hold some.

    Attributes:
        label: Names it from message to message by a fixed rule; states nothing.
        time: Enclosure of its instant, UTC ns.
        verdict: Certain with a core; possible without one.
        counts: Fewest and most contacts in its region.
        cells: Fewest and most taxels.
        force: Enclosure of the force, in N.
        centroid: Enclosures of x and y, or of x, y and z, in m.
        coverage: Probability of the whole statement.
        links: To contacts of earlier instants.
    """

    label: int
    time: Instants
    verdict: Verdict
    counts: Counts
    cells: Counts
    force: Bounds
    centroid: tuple[Bounds, ...]
    coverage: float
    links: tuple[Link, ...] = ()


class Because(IntFlag):
    """Why a verdict is only possible."""

    WIDTH = 1
    """Intervals are too wide."""
    INSTANT = 2
    """Instants are not known exactly enough."""
    GAP = 4
    """Samples are missing."""
    PENDING = 8
    """Samples are yet to come."""


class MonitorVerdict(NamedTuple):
    """What a monitor's formula is at an instant.

    Attributes:
        monitor: Name of the monitor.
        time: Enclosure of the instant, UTC ns.
        verdict: Impossible, possible or certain.
        final: Whether no later sample can change it.
        because: Why it is possible; none where it is not.
        coverage: Probability that it holds.
    """

    monitor: str
    time: Instants
    verdict: Verdict
    final: bool
    because: Because
    coverage: float


class Gap(NamedTuple):
    """Samples that were never taken, or messages that a full flash gave up.

    Attributes:
        reason: Such as ``flash full``.
        time: UTC ns, from the earliest to the latest instant that is affected.
        messages: How many messages were given up.
        samples: How many samples were lost.
        lost: ``(boot, first, last)`` of the messages given up.
        patches: Numbers of the patches that are affected, ascending; empty for all.
    """

    reason: str
    time: Instants
    messages: int
    samples: int
    lost: tuple[tuple[int, int, int], ...] = ()
    patches: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Statements:
    """Statements of a stretch; a node writes it only if there is one.

    Attributes:
        position: Boot and sequence.
        layout: Hash of the layout whose patches it names.
        peaks: Of single channels.
        contacts: Of the skin.
        verdicts: Of monitors.
        gaps: What is missing.

    Raises:
        MessageError: There is none at all, or one contradicts itself.
    """

    position: Position
    layout: bytes
    peaks: tuple[Peak, ...] = ()
    contacts: tuple[Contact, ...] = ()
    verdicts: tuple[MonitorVerdict, ...] = ()
    gaps: tuple[Gap, ...] = ()

    def __post_init__(self) -> None:
        if not (self.peaks or self.contacts or self.verdicts or self.gaps):
            raise MessageError("statements hold no statement; write none")
        for peak in self.peaks:
            _require_counted(peak.verdict, peak.counts, "field 5")
        for contact in self.contacts:
            _require_counted(contact.verdict, contact.counts, "field 6")
        for verdict in self.verdicts:
            _require_reason(verdict)
        for gap in self.gaps:
            if any(first >= second for first, second in pairwise(gap.patches)):
                raise MessageError(f"field 8 names patches {gap.patches}; they must ascend")

    def encode(self) -> bytes:
        """Write as CBOR.

        Raises:
            MessageError: It is longer than a message may be; divide it.
        """
        arrays = {
            5: [_listed(peak) for peak in self.peaks],
            6: [_listed(contact) for contact in self.contacts],
            7: [_listed(verdict) for verdict in self.verdicts],
            8: [_listed(gap) for gap in self.gaps],
        }
        data = dump(
            position_fields(Kind.STATEMENTS, self.position)
            | {4: self.layout}
            | {key: each for key, each in arrays.items() if each}
        )
        if len(data) > MOST_BYTES:
            raise MessageError(
                f"statements take {len(data)} bytes; at most {MOST_BYTES} are allowed: divide them"
            )
        return data

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Read statements.

        Raises:
            MessageError: They are none.
        """
        return cls.read(load(data))

    @classmethod
    def read(cls, fields: Fields) -> Self:
        """Read statements from their decoded fields."""
        fields.only(_FIELDS)
        fields.integer(1, Kind.STATEMENTS, Kind.STATEMENTS)
        return cls(
            position=read_position(fields),
            layout=fields.octets(4, HASH_BYTES, HASH_BYTES),
            peaks=tuple(map(_peak, fields.optional_items(5, MOST_STATEMENTS))),
            contacts=tuple(map(_contact, fields.optional_items(6, MOST_STATEMENTS))),
            verdicts=tuple(map(_verdict, fields.optional_items(7, MOST_STATEMENTS))),
            gaps=tuple(map(_gap, fields.optional_items(8, MOST_STATEMENTS))),
        )


def _require_counted(verdict: Verdict, counts: Counts, what: str) -> None:
    least = 1 if verdict is Verdict.CERTAIN else 0
    if verdict is Verdict.IMPOSSIBLE or min(counts[0], 1) != least or counts[1] == 0:
        raise MessageError(f"{what} states {verdict.name.lower()} with {counts[0]} to {counts[1]}")


def _require_reason(verdict: MonitorVerdict) -> None:
    if (verdict.verdict is Verdict.POSSIBLE) is not bool(verdict.because):
        raise MessageError("field 7 states why a verdict is possible that is not, or does not")
    if verdict.final and Because.PENDING in verdict.because:
        raise MessageError("field 7 states a final verdict that waits for samples")


def _listed(value: object) -> object:
    """Tuples as arrays, and names of numbers as numbers."""
    if isinstance(value, tuple):
        return [_listed(each) for each in value]
    return int(value) if isinstance(value, (Verdict, Because)) else value


def _instants(value: object, what: str) -> Instants:
    return integer_pair(value, what, -MOST_INSTANT, MOST_INSTANT)


def _counts(value: object, what: str) -> Counts:
    return integer_pair(value, what, 0, MOST_COUNT)


def _bounds(value: object, what: str) -> Bounds:
    lo, hi = (real(each, what) for each in pair(value, what))
    if lo > hi:
        raise MessageError(f"{what} is reversed: {lo!r} > {hi!r}")
    return lo, hi


def _coverage(value: object, what: str) -> float:
    return real(value, what, 0.0, 1.0)


def _one_of_three(value: object, what: str) -> Verdict:
    return Verdict(integer(value, what, 0, max(Verdict)))


def _peak(value: object) -> Peak:
    what = "field 5"
    patch, column, time, verdict, counts, height, prominence, coverage = row(value, what, 8)
    return Peak(
        patch=integer(patch, what, 0, MOST_PATCHES - 1),
        column=integer(column, what, 0, MOST_COLUMNS - 1),
        time=_instants(time, what),
        verdict=_one_of_three(verdict, what),
        counts=_counts(counts, what),
        height=_bounds(height, what),
        prominence=_bounds(prominence, what),
        coverage=_coverage(coverage, what),
    )


def _contact(value: object) -> Contact:
    what = "field 6"
    label, time, verdict, counts, cells, force, centroid, coverage, links = row(value, what, 9)
    axes = items(centroid, what, 3)
    if len(axes) < 2:
        raise MessageError(f"{what} has a centroid of {len(axes)} axes; expected 2 or 3")
    return Contact(
        label=integer(label, what, 0, MOST_COUNT),
        time=_instants(time, what),
        verdict=_one_of_three(verdict, what),
        counts=_counts(counts, what),
        cells=_counts(cells, what),
        force=_bounds(force, what),
        centroid=tuple(_bounds(axis, what) for axis in axes),
        coverage=_coverage(coverage, what),
        links=tuple(map(_link, items(links, what, _MOST_LINKS))),
    )


def _link(value: object) -> Link:
    contact, verdict = pair(value, "field 6, link")
    found = _one_of_three(verdict, "field 6, link")
    if found is Verdict.IMPOSSIBLE:
        raise MessageError("field 6 has a link that is impossible; leave it out")
    return Link(integer(contact, "field 6, link", 0, MOST_COUNT), found)


def _verdict(value: object) -> MonitorVerdict:
    what = "field 7"
    monitor, time, verdict, final, because, coverage = row(value, what, 6)
    name = text(monitor, what, _MONITOR_LENGTH)
    if TAXEL.fullmatch(name) is None:
        raise MessageError(f"{what} names monitor {name!r}; expected a name such as grip")
    if type(final) is not bool:
        raise MessageError(f"{what} has {final!r} for final; expected true or false")
    return MonitorVerdict(
        monitor=name,
        time=_instants(time, what),
        verdict=_one_of_three(verdict, what),
        final=final,
        because=Because(integer(because, what, 0, sum(Because))),
        coverage=_coverage(coverage, what),
    )


def _gap(value: object) -> Gap:
    what = "field 8"
    reason, time, messages, samples, lost, patches = row(value, what, 6)
    return Gap(
        reason=text(reason, what, _REASON_LENGTH),
        time=_instants(time, what),
        messages=integer(messages, what, 0, MOST_COUNT),
        samples=integer(samples, what, 0, MOST_COUNT),
        lost=tuple(read_span(span, what) for span in items(lost, what, _MOST_SPANS)),
        patches=tuple(
            integer(patch, what, 0, MOST_PATCHES - 1)
            for patch in items(patches, what, MOST_PATCHES)
        ),
    )
