"""A node that sends as fast as the gateway acknowledges: ``python -m benchmarks.loader``."""

from __future__ import annotations

import json
import sys
import threading
import time
from pathlib import Path
from typing import Final

import paho.mqtt.client as mqtt
from paho.mqtt.enums import CallbackAPIVersion

from benchmarks.said import FEW, descriptions, frame
from eskin.identity import Identity, client_context
from eskin.wire.envelope import Opener, Sealer
from eskin.wire.messages import Acknowledgement, Position, Status
from eskin.wire.topics import Stream, node_topic

WINDOW: Final = 2000
RESEND_S: Final = 5.0


class Loader:
    """Seals frames made beforehand, and keeps a window of them unacknowledged."""

    def __init__(self, pki: Path, port: int, count: int) -> None:
        self._node = Identity.load(pki / "fingertip")
        site = Identity.load(pki / "site.main")
        self._sealer = Sealer(self._node, site.certificate)
        self._opener = Opener([self._node], sender={site.thumbprint: site.certificate}.get)
        self._frames = [frame(FEW, Position(1, i + 1), time.time_ns()) for i in range(count)]
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
        for sequence, data in enumerate(self._frames, start=1):
            with self._changed:
                self._changed.wait_for(lambda: len(self._waiting) < WINDOW)
                self._waiting.add(sequence)
            self._send(data, sequence)
        while self._waiting:
            with self._changed:
                self._changed.wait_for(lambda: not self._waiting, timeout=RESEND_S)
            for sequence in sorted(self._waiting):
                self._send(self._frames[sequence - 1], sequence)
        self._client.disconnect()
        self._client.loop_stop()

    def _send(self, data: bytes, sequence: int) -> None:
        topic = node_topic("fingertip", Stream.FRAMES)
        held = Position(1, min(self._waiting, default=sequence))
        self._client.publish(topic, self._sealer.seal(data, topic=topic, held=held), qos=1)

    def _introduce(self) -> None:
        now = time.time_ns()
        status = Status(Position(1, 0), (now, now), "bench", "loader", 0, 0, 0, 1, 0)
        topic = node_topic("fingertip", Stream.STATUS)
        envelope = self._sealer.seal(status.encode(), topic=topic, introduce=True)
        self._client.publish(topic, envelope, qos=1, retain=True)
        topic = node_topic("fingertip", Stream.LAYOUTS)
        for each in descriptions(FEW):
            self._client.publish(topic, self._sealer.seal(each, topic=topic), qos=1)

    def _acknowledged(self, _client: mqtt.Client, _data: object, message: mqtt.MQTTMessage) -> None:
        opened = self._opener.open(bytes(message.payload), topic=message.topic)
        with self._changed:
            for _, first, last in Acknowledgement.decode(opened.plaintext).spans:
                self._waiting -= set(range(first, last + 1))
            self._changed.notify_all()


if __name__ == "__main__":
    Loader(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])).run()
