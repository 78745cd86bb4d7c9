"""A node whose frames are sealed beforehand, so that sending them costs next to nothing."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any, Final, Self

import paho.mqtt.client as mqtt
from paho.mqtt.enums import CallbackAPIVersion

from benchmarks.said import FEW, NODE, descriptions, frame
from eskin.identity import Identity, client_context
from eskin.identity.identity import ROOT_FILE
from eskin.wire.envelope import Opener, Sealer
from eskin.wire.messages import Acknowledgement, Position, Status
from eskin.wire.sequence_set import SequenceRanges
from eskin.wire.topics import Stream, node_topic
from tests.support.files import ask
from tests.support.processes import wait_until

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

_INFLIGHT: Final = 1000
_PATIENCE_S: Final = 300.0


class Flood:
    """The node ``fingertip``, connected; each flood is a boot of its own.

    Attributes:
        boot: The present one.
        finished: When it vouched for the last, UTC ns.
    """

    def __init__(self, pki: Path, port: int) -> None:
        node = Identity.load(pki / NODE)
        site = Identity.load(pki / "site.main")
        self._sealer = Sealer(node, site.certificate)
        self._opener = Opener([node], sender={site.thumbprint: site.certificate}.get)
        self.boot = 0
        self._puback = threading.Semaphore(0)
        self._acknowledged = SequenceRanges()
        self.finished = 0
        self._client = mqtt.Client(CallbackAPIVersion.VERSION2, client_id=NODE)
        self._client.tls_set_context(client_context(node.directory / ROOT_FILE, node))
        self._client.max_inflight_messages_set(_INFLIGHT)
        self._client.on_message = self._on_message
        self._client.on_publish = self._on_publish
        self._client.connect("127.0.0.1", port)
        self._client.subscribe(node_topic(NODE, Stream.ACKS), qos=1)
        self._client.loop_start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._client.disconnect()
        self._client.loop_stop()

    def introduce(self) -> None:
        """Begin a boot, and wait until the gateway knows the node."""
        self.boot += 1
        self._acknowledged = SequenceRanges()
        now = time.time_ns()
        status = Status(Position(self.boot, 0), (now, now), "bench", "flood", 0, 0, 0, 1, 0)
        topic = node_topic(NODE, Stream.STATUS)
        sealed = self._sealer.seal(status.encode(), topic=topic, introduce=True)
        self._client.publish(topic, sealed, qos=1, retain=True)
        wait_until(lambda: self.durable >= 0, "the node is known", seconds=_PATIENCE_S)
        self._puback.acquire()
        topic = node_topic(NODE, Stream.LAYOUTS)
        for each in descriptions(FEW):
            self._client.publish(topic, self._sealer.seal(each, topic=topic), qos=1)
            self._puback.acquire()

    def seal(self, count: int) -> list[bytes]:
        """Envelopes of the next frames, from sequence 1."""
        return [self.seal_one(number) for number in range(1, count + 1)]

    def seal_one(self, number: int) -> bytes:
        """The envelope of one frame."""
        topic = node_topic(NODE, Stream.FRAMES)
        held = Position(self.boot, self.durable + 1)
        data = frame(FEW, Position(self.boot, number), time.time_ns())
        return self._sealer.seal(data, topic=topic, held=held)

    def send(self, envelope: bytes) -> None:
        """Publish one, at QoS 1."""
        self._client.publish(node_topic(NODE, Stream.FRAMES), envelope, qos=1)

    def fill(self, envelopes: Sequence[bytes]) -> None:
        """Publish all, and wait until the broker has them."""
        for envelope in envelopes:
            self.send(envelope)
        for _ in envelopes:
            assert self._puback.acquire(timeout=_PATIENCE_S), "the broker takes no more"

    def wait_for(self, count: int) -> None:
        """Wait until the gateway vouched for so many frames."""
        wait_until(lambda: self.durable >= count, "all durable", seconds=_PATIENCE_S)

    def stored(self, store: Path) -> int:
        """How many frames of this boot the cloud has stored, compacted or not."""
        query = "SELECT node, last - first + 1 FROM sequences WHERE boot = "
        counts = dict(ask(store, query + str(self.boot)))
        return max(0, int(counts.get(NODE, 0)) - 1)  # the status was the first message

    @property
    def durable(self) -> int:
        """The last sequence up to which the gateway vouched for all; -1 where for none."""
        first, last = next(iter(self._acknowledged), (1, -1))
        return last if first == 0 else -1

    def _on_message(self, _client: mqtt.Client, _data: object, message: mqtt.MQTTMessage) -> None:
        opened = self._opener.open(bytes(message.payload), topic=message.topic)
        for boot, first, last in Acknowledgement.decode(opened.plaintext).spans:
            if boot == self.boot:
                self._acknowledged.add(first, last)
        self.finished = time.time_ns()

    def _on_publish(self, *_: Any) -> None:
        self._puback.release()
