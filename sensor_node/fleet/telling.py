"""What a taxel's frame makes thousands of nodes say: blocks and peaks, compiled."""

from __future__ import annotations

from math import nan
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from eskin.kernels.compiled import kernel, part
from eskin.peaks.search import search
from sensor_node.firmware.record import BLOCK, PEAK
from sensor_node.fleet.cbor import Scratch, scratch
from sensor_node.fleet.writing import Channel, Span, block, peak

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats
    from sensor_node.fleet.cbor import Bytes

    Integers = NDArray[np.int64]

RECORD: Final = np.dtype(
    [
        (name, np.int64)
        for name in (
            "row", "channel", "kind", "sequence", "earliest", "latest", "samples", "begin", "end",
        )
    ]
)  # fmt: skip
"""One message: the node's row, its channel, what flash must know, and where its bytes lie."""
_BILLION: Final = 1_000_000_000


class Timing(NamedTuple):
    """A schedule and a clock's bounds, as `sensor_node.firmware.schedule` and `clock` have them."""

    origin: int
    dt: int
    burst: int
    pause: int
    error: int
    drift: int


class Design(NamedTuple):
    """What all nodes share of a taxel.

    Attributes:
        names: Name and unit of each channel, as they stand in messages.
        prominences: Least prominence of each channel's peaks; 0 where there are none.
        coverage: Of one sample.
        encoding: How blocks write their bounds.
        timing: When samples are taken, and how well the nodes know it.
    """

    names: tuple[Bytes, ...]
    prominences: Floats
    coverage: float
    encoding: int
    timing: Timing


class Place(NamedTuple):
    """Where the next message goes: its first byte, and how many messages there are before."""

    at: int
    messages: int


class Nodes(NamedTuple):
    """Some nodes.

    Attributes:
        readings: What they know of UTC at tick 0, ns.
        boots: Their boots.
        sequences: Their next sequences.
        alone: 1 where one samples alone: nothing is said for it here.
    """

    readings: Integers
    boots: Integers
    sequences: Integers
    alone: Integers


class Search(NamedTuple):
    """Where the searches for peaks stand, each an array of channels × nodes."""

    progress: Any
    passes: Any
    regions: Any


class Output(NamedTuple):
    """Room for messages, and for the peaks of one piece."""

    content: Bytes
    records: Any
    events: Any


@part
def _ticks(timing: Timing, sample: int) -> int:
    if timing.burst == 0:
        return timing.origin + sample * timing.dt
    number, inside = sample // timing.burst, sample % timing.burst
    return timing.origin + number * timing.pause + inside * timing.dt


@part
def _error(timing: Timing, ticks: int) -> int:
    """Greatest error of the clock; the product of both would not fit into 64 bits after days."""
    seconds, rest = ticks // _BILLION, ticks % _BILLION
    return timing.error + seconds * timing.drift - (-rest * timing.drift) // _BILLION


@part
def _note(
    record: Any, row: int, channel: int, kind: int, sequence: int, time: Span, samples: int
) -> None:
    record.row, record.channel, record.kind = row, channel, kind
    record.sequence, record.samples = sequence, samples
    record.earliest, record.latest = time.earliest, time.latest


@part
def _next(nodes: Nodes, row: int) -> int:
    sequence: int = nodes.sequences[row]
    nodes.sequences[row] = sequence + 1
    return sequence


@part
def _seek(
    lows: Floats,
    highs: Floats,
    row: int,
    k: int,
    design: Design,
    nodes: Nodes,
    searches: Search,
    output: Output,
    place: Place,
    room: Scratch,
) -> Place:
    """Seek peaks in some samples of one channel, and write what is decided."""
    progress = searches.progress[k, row : row + 1]
    passes, regions = searches.passes[k, row], searches.regions[k, row]
    threshold = design.prominences[k]
    _, found = search(lows, highs, threshold, progress, passes, regions, output.events)
    at, count = place
    channel = Channel(design.names[k], design.timing.dt, design.coverage)
    boot, reading = nodes.boots[row], nodes.readings[row]
    for number in range(found):
        event = output.events[number]
        first, last = _ticks(design.timing, event.first), _ticks(design.timing, event.last)
        earliest = reading + first - _error(design.timing, first)
        time = Span(first, earliest, reading + last + _error(design.timing, last))
        sequence, record = _next(nodes, row), output.records[count]
        _note(record, row, k, PEAK, sequence, time, 0)
        record.begin = at
        at = peak(output.content, at, boot, sequence, channel, time, event, room)
        record.end = at
        count += 1
    return Place(at, count)


@part
def _tell_block(
    lows: Floats,
    highs: Floats,
    row: int,
    k: int,
    ticks: int,
    design: Design,
    nodes: Nodes,
    output: Output,
    place: Place,
    room: Scratch,
) -> Place:
    """Write the block of one channel."""
    n, dt = lows.size, design.timing.dt
    error, middle = _error(design.timing, ticks + n * dt), nodes.readings[row] + ticks
    time = Span(ticks, middle - error, middle + error)
    until = Span(ticks, time.earliest, time.latest + (n - 1) * dt)
    sequence, record = _next(nodes, row), output.records[place.messages]
    _note(record, row, k, BLOCK, sequence, until, n)
    record.begin = place.at
    channel = Channel(design.names[k], dt, design.coverage)
    boot, encoding = nodes.boots[row], design.encoding
    record.end = block(
        output.content, place.at, boot, sequence, channel, time, encoding, lows, highs, room
    )
    return Place(record.end, place.messages + 1)


@kernel
def tell(
    ticks: int,
    closes: bool,  # noqa: FBT001 - compiled
    lows: Floats,
    highs: Floats,
    design: Design,
    nodes: Nodes,
    searches: Search,
    output: Output,
) -> Place:
    """Write the blocks and the decided peaks of one frame, node by node in their order.

    Args:
        ticks: Of the first sample.
        closes: Whether sampling pauses after it.
        lows: Lower bounds, channels × nodes × samples.
        highs: Upper bounds.
        design: What all nodes share.
        nodes: Whose messages.
        searches: Where the searches for peaks stand.
        output: Takes the messages.

    Returns:
        How many bytes, and how many messages.
    """
    room, missing, place = scratch(), np.full(1, nan), Place(0, 0)
    for row in range(lows.shape[1]):
        if nodes.alone[row]:
            continue
        for k in range(lows.shape[0]):
            lo, hi = lows[k, row], highs[k, row]
            place = _tell_block(lo, hi, row, k, ticks, design, nodes, output, place, room)
            if design.prominences[k] > 0.0:
                place = _seek(lo, hi, row, k, design, nodes, searches, output, place, room)
                if closes:
                    place = _seek(
                        missing, missing, row, k, design, nodes, searches, output, place, room
                    )
                    searches.progress[k, row].index -= 1
    return place


@kernel
def skip(samples: int, design: Design, nodes: Nodes, searches: Search, output: Output) -> Place:
    """Say that samples are missing; writes the peaks that stay undecided. Else as `tell`."""
    room, missing, place = scratch(), np.full(1, nan), Place(0, 0)
    for row in range(nodes.readings.size):
        if nodes.alone[row]:
            continue
        for k in range(design.prominences.size):
            if design.prominences[k] > 0.0:
                place = _seek(
                    missing, missing, row, k, design, nodes, searches, output, place, room
                )
                searches.progress[k, row].index += samples - 1
    return place
