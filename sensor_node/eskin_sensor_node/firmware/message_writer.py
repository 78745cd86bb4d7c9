"""Writes messages as bytes, for `eskin.wire.messages` and `eskin.wire.frames` to read."""

from eskin_sensor_node.firmware.cbor import Writer, put_integer, put_integers, put_text
from eskin_sensor_node.firmware.gap_reasons import reason_text

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from typing import Any, Protocol

    from eskin_sensor_node.firmware.energy import Energy

    State = Mapping[str, Mapping[str, float | str]]
    """Settings of each place: a channel, a taxel, or ``*``."""

    Time = tuple[int, int]
    """Earliest and latest UTC, ns."""
    Grid = tuple[int, int, int, int, float]
    """Delay and period in ns, number of the first row, rows, coverage."""
    PatchSamples = Sequence[Any]
    """Number of the patch, number of its grid, epoch, columns, exponent, offset, codes; then a map
    of options where it has some: 1 strides, 2 bits of unshared columns."""
    Span = tuple[int, int, int]
    """Boot, first and last sequence of lost messages."""
    Gap = tuple[str, Time, int, int, Sequence[Span], Sequence[int]]
    """Reason, time, lost messages, lost samples, positions of the messages, numbers of patches."""

    class Numbers(Protocol):
        """Counts messages."""

        def next_sequence(self) -> int:
            """The next number; never given out again."""


FRAME = 1
STATEMENTS = 2
PATCH = 3
LAYOUT = 4
STATUS = 5
RESULT = 6
COMMAND = 9
"""Kinds of messages, as in `eskin.wire.messages.Kind`."""


class Record:
    """A message with what flash must know of it.

    Attributes:
        kind: `FRAME`, `STATEMENTS`, `STATUS` or `RESULT`.
        sequence: Its number in this boot.
        body: Its bytes.
        earliest: UTC ns of its begin.
        latest: The same, at the end.
        samples: How many samples it holds, or for a gap: how many were lost.
        named: How many lost messages it names.
        gaps: How many gaps it states.
    """

    __slots__ = (
        "body",
        "earliest",
        "gaps",
        "kind",
        "latest",
        "named",
        "samples",
        "sequence",
    )

    def __init__(
        self,
        kind: int,
        sequence: int,
        body: bytes,
        time: "tuple[int, int]",
        samples: int,
        named: int = 0,
        gaps: int = 0,
    ) -> None:
        self.kind = kind
        self.sequence = sequence
        self.body = body
        self.earliest, self.latest = time
        self.samples = samples
        self.named = named
        self.gaps = gaps


class MessageWriter:
    """Writes messages, numbered one after the other.

    Args:
        boot: Number of this start.
        numbers: Gives the sequence numbers.
        layout: Hash of the layout by which the node's frames are read.

    Attributes:
        gateway_time: Latest time of a gateway's clock in an acknowledgement, UTC ns; ``None``
            before the first one. It goes out with each status: what a node writes after it has
            received a time was not written before that time.
    """

    def __init__(self, boot: int, numbers: "Numbers", layout: bytes) -> None:
        self._boot = boot
        self._numbers = numbers
        self._layout = layout
        self.gateway_time: "int | None" = None

    def observe_time(self, time: int) -> None:
        """Remember the time in an acknowledgement, UTC ns, if it is the latest."""
        if self.gateway_time is None or time > self.gateway_time:
            self.gateway_time = time

    def frame(
        self,
        page: int,
        ticks: int,
        time: "Time",
        grids: "Sequence[Grid]",
        patches: "Sequence[PatchSamples]",
        *,
        samples: int,
        lasting: int,
    ) -> Record:
        """Samples of the patches of one page.

        Args:
            page: Number of the page in the layout.
            ticks: The node's clock at the first instant.
            time: UTC ns that enclose this instant, for as long as the frame lasts.
            grids: When patches were sampled, in the order of their first use.
            patches: Encoded samples, with ascending numbers of patches.
            samples: How many samples they are.
            lasting: ns from the first instant to the last sample.
        """
        out, sequence = self._begin(FRAME, 9)
        fields = self._layout, page, ticks, time, grids, patches
        for key, value in enumerate(fields, 4):
            out.integer(key)
            out.item(value)
        until = time[0], time[1] + lasting
        return Record(FRAME, sequence, bytes(out.buffer), until, samples)

    def statements(
        self,
        time: "Time",
        *,
        peaks: "Sequence[Sequence[Any]]" = (),
        contacts: "Sequence[Sequence[Any]]" = (),
        verdicts: "Sequence[Sequence[Any]]" = (),
        gaps: "Sequence[Gap]" = (),
        sequence: "int | None" = None,
    ) -> Record:
        """What is concluded from a stretch of samples, or missing of it; at least one statement.

        Args:
            time: UTC ns, from the earliest to the latest instant that they are about.
            peaks: Patch, column, time, verdict, counts, height, prominence, coverage.
            contacts: Label, time, verdict, counts, cells, force, centroid, coverage, links.
            verdicts: Monitor, time, verdict, whether it is final, reasons, coverage.
            gaps: See `Gap`.
            sequence: Its number, if it was given out before.
        """
        stated = [pair for pair in enumerate((peaks, contacts, verdicts, gaps), 5) if pair[1]]
        out, sequence = self._begin(STATEMENTS, 4 + len(stated), sequence)
        out.integer(4)
        out.octets(self._layout)
        for key, values in stated:
            out.integer(key)
            out.item(values)
        messages = samples = 0
        for gap in gaps:
            messages += gap[2]
            samples += gap[3]
        body = bytes(out.buffer)
        return Record(STATEMENTS, sequence, body, time, samples, messages, len(gaps))

    def gap(
        self,
        reason: int,
        time: "Time",
        samples: int,
        messages: int = 0,
        lost: "Sequence[Span]" = (),
        sequence: "int | None" = None,
        taxel: str = "",
        patches: "Sequence[int]" = (),
    ) -> Record:
        """State samples that were never taken, or messages that were lost.

        Args:
            reason: Why, as a code of `eskin_sensor_node.firmware.gap_reasons`.
            time: UTC ns, from the earliest to the latest instant that is affected.
            samples: How many samples.
            messages: How many messages.
            lost: ``(boot, first, last)`` of the messages.
            sequence: Its number, if it was given out before.
            taxel: Which one is broken, where this is why.
            patches: Numbers of the patches that are affected; none: all.
        """
        stated = reason_text(reason, taxel), time, messages, samples, lost, patches
        return self.statements(time, gaps=[stated], sequence=sequence)

    def status(
        self,
        time: "tuple[int, int]",
        profile: str,
        description: str,
        uptime: int,
        storage: "tuple[int, int, int, int]",
        cause: int,
        *,
        energy: "Energy | None" = None,
        faults: "Sequence[tuple[str, int, int]] | None" = None,
        held: "tuple[int, int] | None" = None,
        ended: "Sequence[tuple[int, int]] | None" = None,
    ) -> Record:
        """The node's state, and why it started.

        ``storage``: messages, bytes, capacity in bytes, gaps ever. ``energy``: bounds of what is
        stored in J, bounds of the state of charge, verdict, stage of shedding. ``faults``: taxels
        that may be broken, whether they are dead and whether they are stuck. ``held``: below it
        nothing waits or will come. ``ended``: former boots, and the last number of each.
        """
        gateway_time = self.gateway_time
        parts = 12 + (energy is not None) + (faults is not None)
        parts += (gateway_time is not None) + (held is not None) + (ended is not None)
        out, sequence = self._begin(STATUS, parts)
        put_integers(out, 4, time)
        put_text(out, 5, profile)
        put_text(out, 6, description)
        put_integer(out, 7, uptime)
        for key in (8, 9, 10, 11):
            put_integer(out, key, storage[key - 8])
        put_integer(out, 12, cause)
        if energy is not None:
            stored, charge, verdict, stage = energy
            out.integer(13)
            out.array(6)
            for bound in stored + charge:
                out.real(bound)
            out.integer(verdict)
            out.integer(stage)
        if faults is not None:
            _faults(out, faults)
        if gateway_time is not None:
            put_integer(out, 15, gateway_time)
        if held is not None:
            put_integers(out, 16, held)
        if ended is not None:
            out.integer(17)
            out.array(len(ended))
            for boot, last in ended:
                out.array(2)
                out.integer(boot)
                out.integer(last)
        return Record(STATUS, sequence, bytes(out.buffer), time, 0)

    def result(
        self,
        time: "tuple[int, int]",
        command: int,
        outcome: int,
        reason: "str | None",
        state: "State",
    ) -> Record:
        """What became of the last command, why it was not done, and how each place is set."""
        out, sequence = self._begin(RESULT, 7 if reason is None else 8)
        put_integers(out, 4, time)
        put_integer(out, 5, command)
        put_integer(out, 6, outcome)
        if reason is not None:
            put_text(out, 7, reason)
        out.integer(8)
        _write_state(out, state)
        return Record(RESULT, sequence, bytes(out.buffer), time, 0)

    def _begin(self, kind: int, fields: int, sequence: "int | None" = None) -> "tuple[Writer, int]":
        out = Writer()
        if sequence is None:
            sequence = self._numbers.next_sequence()
        out.map(fields)
        put_integer(out, 1, kind)
        put_integer(out, 2, self._boot)
        put_integer(out, 3, sequence)
        return out, sequence


def _faults(out: Writer, faults: "Sequence[tuple[str, int, int]]") -> None:
    out.integer(14)
    out.array(len(faults))
    for name, dead, stuck in faults:
        out.array(3)
        out.text(name)
        out.integer(dead)
        out.integer(stuck)


def _write_state(out: Writer, state: "State") -> None:
    """Write a map from places to maps of their settings, each a number or a text."""
    out.map(len(state))
    for place in _in_order(state):
        out.text(place)
        settings = state[place]
        out.map(len(settings))
        for name in _in_order(settings):
            out.text(name)
            value = settings[name]
            if isinstance(value, str):
                out.text(value)
            else:
                out.real(value)


def _in_order(texts: "Iterable[str]") -> "list[str]":
    """As their encodings follow each other (RFC 8949, section 4.2.1): short ones first."""
    encoded = [(len(each), each) for each in [text.encode() for text in texts]]
    return [each.decode() for _, each in sorted(encoded)]
