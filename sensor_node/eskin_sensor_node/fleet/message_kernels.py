"""Blocks and peaks of one frame of thousands of nodes, compiled."""

from __future__ import annotations

from math import nan
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from eskin.kernels.jit import kernel, part
from eskin.peaks.certain_possible_peaks import search
from eskin_sensor_node.firmware.message_writer import BLOCK, PEAK
from eskin_sensor_node.fleet.baseline_kernels import forget, is_block_due, smooth
from eskin_sensor_node.machine.cbor import Scratch, scratch
from eskin_sensor_node.machine.compiled_messages import Channel, Span, block, peak
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin_sensor_node.fleet.columns import Columns
    from eskin_sensor_node.machine.cbor import Bytes

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
GONE: Final = -1
"""In the place of a node that has left its group: it gets no messages."""


class Timing(NamedTuple):
    """A schedule and a clock's bounds, as `firmware.schedule` and `firmware.clock` have them."""

    origin: int
    dt: int
    burst: int
    pause: int
    error: int
    drift: int


class Design(NamedTuple):
    """What all nodes share of a taxel.

    Attributes:
        names: Name and unit of each channel, as they stand in messages, one after the other.
        ends: Where each begins in them, and where the last one ends.
        prominences: Least prominence of each channel's peaks; 0 where there are none.
        coverage: Of one sample.
        encoding: How blocks write their bounds.
        mode: What is sent: a place in `eskin_sensor_node.fleet.baseline_kernels.MODES`.
        smoothing: Weight of the past in the samples in which peaks are sought; 0: none.
        timing: When samples are taken, and how well the nodes know it.
    """

    names: Bytes
    ends: Integers
    prominences: Floats
    coverage: float
    encoding: int
    mode: int
    smoothing: float
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
    """

    readings: Integers
    boots: Integers
    sequences: Integers


class Group(NamedTuple):
    """Nodes that sample together.

    Attributes:
        nodes: All nodes that started together.
        numbers: Which of them it has, a row each; `GONE` where one has left.
    """

    nodes: Nodes
    numbers: Integers


class Output(NamedTuple):
    """Room for messages, and for the peaks of one piece."""

    content: Bytes
    records: Any
    events: Any


@part
def _ticks_of(timing: Timing, sample: int) -> int:
    """When a sample is taken."""
    if timing.burst == 0:
        return timing.origin + sample * timing.dt
    number, inside = sample // timing.burst, sample % timing.burst
    return timing.origin + number * timing.pause + inside * timing.dt


@part
def _error_at(timing: Timing, ticks: int) -> int:
    """Greatest error of the clock; the product of both would not fit into 64 bits after days."""
    seconds, rest = ticks // BILLION, ticks % BILLION
    return timing.error + seconds * timing.drift - (-rest * timing.drift) // BILLION


@part
def _note(
    record: Any, row: int, channel: int, kind: int, sequence: int, time: Span, samples: int
) -> None:
    record.row, record.channel, record.kind = row, channel, kind
    record.sequence, record.samples = sequence, samples
    record.earliest, record.latest = time.earliest, time.latest


@part
def _channel(design: Design, k: int) -> Channel:
    name = design.names[design.ends[k] : design.ends[k + 1]]
    return Channel(name, design.timing.dt, design.coverage)


@part
def _next(group: Group, row: int) -> int:
    node = group.numbers[row]
    sequence: int = group.nodes.sequences[node]
    group.nodes.sequences[node] = sequence + 1
    return sequence


@part
def _seek(
    lows: Floats,
    highs: Floats,
    row: int,
    k: int,
    design: Design,
    group: Group,
    columns: Columns,
    output: Output,
    place: Place,
    room: Scratch,
) -> Place:
    """Seek peaks in some samples of one channel, and write what is decided."""
    progress = columns.progress[k, row : row + 1]
    passes, regions = columns.passes[k, row], columns.regions[k, row]
    threshold = design.prominences[k]
    _, found = search(lows, highs, threshold, progress, passes, regions, output.events)
    at, count = place
    channel, since = _channel(design, k), columns.rests[k, row].since
    node = group.numbers[row]
    boot, reading = group.nodes.boots[node], group.nodes.readings[node]
    for number in range(found):
        event = output.events[number]
        first, last = _ticks_of(design.timing, event.first), _ticks_of(design.timing, event.last)
        earliest = reading + first - _error_at(design.timing, first)
        time = Span(first, earliest, reading + last + _error_at(design.timing, last))
        sequence, record = _next(group, row), output.records[count]
        _note(record, row, k, PEAK, sequence, time, 0)
        record.begin = at
        samples = event.last - (since if design.smoothing > 0.0 else event.first) + 1
        at = peak(output.content, at, boot, sequence, channel, time, event, samples, room)
        record.end = at
        count += 1
    return Place(at, count)


@part
def _write_block(
    lows: Floats,
    highs: Floats,
    row: int,
    k: int,
    ticks: int,
    design: Design,
    group: Group,
    output: Output,
    place: Place,
    room: Scratch,
) -> Place:
    """Write the block of one channel."""
    n, dt = lows.size, design.timing.dt
    node = group.numbers[row]
    error, middle = _error_at(design.timing, ticks + n * dt), group.nodes.readings[node] + ticks
    time = Span(ticks, middle - error, middle + error)
    until = Span(ticks, time.earliest, time.latest + (n - 1) * dt)
    sequence, record = _next(group, row), output.records[place.messages]
    _note(record, row, k, BLOCK, sequence, until, n)
    record.begin = place.at
    channel = _channel(design, k)
    boot, encoding = group.nodes.boots[node], design.encoding
    record.end = block(
        output.content, place.at, boot, sequence, channel, time, encoding, lows, highs, room
    )
    return Place(record.end, place.messages + 1)


@part
def _write_channel(
    lows: Floats,
    highs: Floats,
    row: int,
    k: int,
    ticks: int,
    design: Design,
    group: Group,
    columns: Columns,
    output: Output,
    place: Place,
    room: Scratch,
) -> Place:
    """Write a channel's block, if it is sent, and the peaks that are decided now."""
    threshold, rest = design.prominences[k], columns.rests[k, row]
    if is_block_due(lows, highs, threshold, design.mode, rest):
        place = _write_block(lows, highs, row, k, ticks, design, group, output, place, room)
    if threshold > 0.0:
        if design.smoothing > 0.0:
            smooth(lows, highs, design.smoothing, rest)
        place = _seek(lows, highs, row, k, design, group, columns, output, place, room)
    return place


@part
def _pause(
    samples: int,
    row: int,
    k: int,
    design: Design,
    group: Group,
    columns: Columns,
    output: Output,
    place: Place,
    room: Scratch,
) -> Place:
    """Join nothing across some missing samples, or none; writes the peaks that stay undecided."""
    if design.prominences[k] > 0.0:
        missing = np.full(1, nan)
        place = _seek(missing, missing, row, k, design, group, columns, output, place, room)
        columns.progress[k, row].index += samples - 1
    return place


@kernel
def write_frame(
    ticks: int,
    closes: bool,  # noqa: FBT001 - compiled
    lows: Floats,
    highs: Floats,
    design: Design,
    group: Group,
    columns: Columns,
    output: Output,
) -> Place:
    """Write the blocks and the decided peaks of one frame, node by node in their order.

    Args:
        ticks: Of the first sample.
        closes: Whether sampling pauses after it.
        lows: Lower bounds, channels × nodes × samples; smoothed afterwards, if they are to be.
        highs: Upper bounds.
        design: What all nodes share.
        group: Whose messages.
        columns: What the nodes remember.
        output: Takes the messages.

    Returns:
        How many bytes, and how many messages.
    """
    room, place = scratch(), Place(0, 0)
    for row in range(lows.shape[1]):
        if group.numbers[row] == GONE:
            continue
        for k in range(lows.shape[0]):
            lo, hi = lows[k, row], highs[k, row]
            place = _write_channel(
                lo, hi, row, k, ticks, design, group, columns, output, place, room
            )
            if closes:
                place = _pause(0, row, k, design, group, columns, output, place, room)
    return place


@kernel
def skip(samples: int, design: Design, group: Group, columns: Columns, output: Output) -> Place:
    """Skip missing samples; writes the peaks that stay undecided. Else as `write_frame`."""
    room, place = scratch(), Place(0, 0)
    for row in range(group.numbers.size):
        if group.numbers[row] == GONE:
            continue
        for k in range(design.prominences.size):
            place = _pause(samples, row, k, design, group, columns, output, place, room)
            forget(columns.rests[k, row], columns.progress[k, row].index)
    return place
