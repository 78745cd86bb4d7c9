"""The firmware's scribe with a compiled hand: blocks of nodes that sample alone."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels.jit import kernel
from eskin_sensor_node.firmware.cbor import Writer
from eskin_sensor_node.firmware.message_writer import BLOCK, MessageWriter, Record
from eskin_sensor_node.machine.cbor import scratch
from eskin_sensor_node.machine.compiled_messages import Channel, Span, block

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin.interval import Floats
    from eskin_sensor_node.firmware.message_writer import Channel as Described
    from eskin_sensor_node.machine.cbor import Bytes

BLOCK_BYTES: Final = 400
"""More than a block takes beside its samples."""


class CompiledWriter(MessageWriter):
    """Writes the same bytes."""

    def block(
        self,
        channel: Described,
        ticks: int,
        time: tuple[int, int],
        encoding: int,
        lows: Sequence[float],
        highs: Sequence[float],
        n: int,
    ) -> Record:
        """Samples of one channel, in buffers of floats."""
        sequence = self._numbers.next_sequence()
        out = np.empty(BLOCK_BYTES + 16 * n, np.uint8)
        given = Channel(described(channel.name, channel.unit), channel.dt, channel.coverage)
        span = Span(ticks, *time)
        bounds = [np.frombuffer(each, count=n) for each in (lows, highs)]  # type: ignore[call-overload]  # arrays
        end = _write(out, self._boot, sequence, given, span, encoding, *bounds)
        until = time[0], time[1] + channel.dt * (n - 1)
        return Record(BLOCK, sequence, out[:end].tobytes(), until, n, 0, channel.name)


def described(channel: str, unit: str) -> Bytes:
    """Name and unit of a channel, as they stand in a message."""
    out = Writer()
    for key, text in ((4, channel), (5, unit)):
        out.integer(key)
        out.text(text)
    return np.frombuffer(bytes(out.buffer), np.uint8)


@kernel
def _write(
    out: Bytes,
    boot: int,
    sequence: int,
    channel: Channel,
    time: Span,
    encoding: int,
    lows: Floats,
    highs: Floats,
) -> int:
    return block(out, 0, boot, sequence, channel, time, encoding, lows, highs, scratch())
