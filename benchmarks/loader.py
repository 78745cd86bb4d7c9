"""A node that sends as fast as the gateway acknowledges: ``python -m benchmarks.loader``."""

from __future__ import annotations

import functools
import json
import sys
import threading
import time
from pathlib import Path
from typing import Final

import cbor2
import numpy as np
import paho.mqtt.client as mqtt
from paho.mqtt.enums import CallbackAPIVersion

from eskin.identity import Identity, client_context
from eskin.interval import Interval
from eskin.tube import Tube
from eskin.wire.envelope import Opener, Sealer
from eskin.wire.messages import Acknowledgement, Block, ChannelInfo, Encoding, Position, Status
from eskin.wire.messages.cbor_map import dump
from eskin.wire.messages.header import Kind, position_fields
from eskin.wire.topics import Stream, node_topic

WINDOW: Final = 2000
SAMPLES: Final = 250
RESEND_S: Final = 5.0
_SHAPES: Final = 64


class Loader:
    """Seals blocks made beforehand, and keeps a window of them unacknowledged."""

    def __init__(self, pki: Path, port: int, blocks: int) -> None:
        self._node = Identity.load(pki / "fingertip")
        site = Identity.load(pki / "site.main")
        self._sealer = Sealer(self._node, site.certificate)
        self._opener = Opener([self._node], sender={site.thumbprint: site.certificate}.get)
        self._blocks = [sample_block(Position(1, i + 1)) for i in range(blocks)]
        self._waiting: set[int] = set()
        self._changed = threading.Condition()
        self._client = mqtt.Client(CallbackAPIVersion.VERSION2, client_id="fingertip")
        self._client.tls_set_context(client_context(pki / "fingertip" / "root.pem", self._node))
        self._client.max_inflight_messages_set(WINDOW)
        self._client.on_message = self._acknowledged
        self._client.connect("127.0.0.1", port)
        self._client.subscribe(node_topic("fingertip", Stream.ACKS), qos=1)
        self._client.loop_start()

    def run(self) -> None:
        """Introduce the node, then send everything."""
        self._waiting.add(0)
        while 0 in self._waiting:
            self._introduce()
            with self._changed:
                self._changed.wait_for(lambda: 0 not in self._waiting, timeout=1.0)
        sys.stdout.write(json.dumps({"started": time.time()}) + "\n")
        sys.stdout.flush()
        for sequence, data in enumerate(self._blocks, start=1):
            with self._changed:
                self._changed.wait_for(lambda: len(self._waiting) < WINDOW)
                self._waiting.add(sequence)
            self._send(data, sequence)
        while self._waiting:
            with self._changed:
                self._changed.wait_for(lambda: not self._waiting, timeout=RESEND_S)
            for sequence in sorted(self._waiting):
                self._send(self._blocks[sequence - 1], sequence)
        self._client.disconnect()
        self._client.loop_stop()

    def _send(self, data: bytes, sequence: int) -> None:
        topic = node_topic("fingertip", Stream.FRAMES)
        held = Position(1, min(self._waiting, default=sequence))
        self._client.publish(topic, self._sealer.seal(data, topic=topic, held=held), qos=1)

    def _introduce(self) -> None:
        now = time.time_ns()
        info = ChannelInfo("t01.capacitance", "F", 1_000_000, 1.0)
        status = Status(
            Position(1, 0), (now, now), "bench", "loader", 0, 0, 0, 1, 0, (info,)
        )  # fmt: skip
        topic = node_topic("fingertip", Stream.STATUS)
        envelope = self._sealer.seal(status.encode(), topic=topic, introduce=True)
        self._client.publish(topic, envelope, qos=1, retain=True)

    def _acknowledged(self, _client: mqtt.Client, _data: object, message: mqtt.MQTTMessage) -> None:
        opened = self._opener.open(bytes(message.payload), topic=message.topic)
        with self._changed:
            for _, first, last in Acknowledgement.decode(opened.plaintext).spans:
                self._waiting -= set(range(first, last + 1))
            self._changed.notify_all()


def sample_block(position: Position) -> bytes:
    """A block of 250 samples: 1.1 kB. Only its position and time are made for each anew."""
    start = time.time_ns() + position.sequence * SAMPLES * 1_000_000
    fields = dict(_shape(position.sequence % _SHAPES))
    fields |= position_fields(Kind.BLOCK, position) | {7: [start, start + 4_000_000]}
    return dump(fields)


@functools.cache
def _shape(number: int) -> dict[int, object]:
    """The fields of a block with one stretch of the signal."""
    phase = number * SAMPLES + np.arange(SAMPLES)
    values = 5e-11 * (1.1 + np.sin(phase * 0.0126))
    tube = Tube((0, 4_000_000), 1_000_000, Interval.relative(values, 0.01), "F", 1.0)
    block = Block.pack(Position(1, 1), "t01.capacitance", 0, tube, Encoding.Q16)
    fields: dict[int, object] = cbor2.loads(block.encode())
    return fields


if __name__ == "__main__":
    Loader(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])).run()
