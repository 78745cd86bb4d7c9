"""A node whose blocks are sealed beforehand, so that sending them costs next to nothing."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any, Final, Self

import paho.mqtt.client as mqtt
from paho.mqtt.enums import CallbackAPIVersion

from benchmarks.loader import sample_block
from eskin.identity import Identity, client_context
from eskin.identity.identity import ROOT_FILE
from eskin.wire.envelope import Opener, Sealer
from eskin.wire.messages import Acknowledgement, ChannelInfo, Position, Status
from eskin.wire.sequence_set import SequenceRanges
from eskin.wire.topics import Stream, node_topic
from tests.support.processes import wait_until

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

_NODE: Final = "fingertip"
_INFLIGHT: Final = 1000
_PATIENCE_S: Final = 300.0


class Flood:
    """The node ``fingertip``, connected; each flood is a boot of its own.

    Attributes:
        boot: The present one.
        finished: When it vouched for the last, UTC ns.
    """

    def __init__(self, pki: Path, port: int) -> None:
        node = Identity.load(pki / _NODE)
        site = Identity.load(pki / "site.main")
        self._sealer = Sealer(node, site.certificate)
        self._opener = Opener([node], sender={site.thumbprint: site.certificate}.get)
        self.boot = 0
        self._told = threading.Semaphore(0)
        self._acknowledged = SequenceRanges()
        self.finished = 0
        self._client = mqtt.Client(CallbackAPIVersion.VERSION2, client_id=_NODE)
        self._client.tls_set_context(client_context(node.directory / ROOT_FILE, node))
        self._client.max_inflight_messages_set(_INFLIGHT)
        self._client.on_message = self._on_message
        self._client.on_publish = self._on_publish
        self._client.connect("127.0.0.1", port)
        self._client.subscribe(node_topic(_NODE, Stream.ACKS), qos=1)
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
        info = ChannelInfo("t01.capacitance", "F", 1_000_000, 1.0)
        status = Status(
            Position(self.boot, 0), (now, now), "bench", "flood", 0, 0, 0, 1, 0, (info,)
        )  # fmt: skip
        topic = node_topic(_NODE, Stream.STATUS)
        sealed = self._sealer.seal(status.encode(), topic=topic, introduce=True)
        self._client.publish(topic, sealed, qos=1, retain=True)
        wait_until(lambda: self.durable >= 0, "the node is known", seconds=_PATIENCE_S)
        self._told.acquire()

    def seal(self, count: int) -> list[bytes]:
        """Envelopes of the next blocks, from sequence 1."""
        return [self.seal_one(number) for number in range(1, count + 1)]

    def seal_one(self, number: int) -> bytes:
        """The envelope of one block."""
        topic = node_topic(_NODE, Stream.FRAMES)
        held = Position(self.boot, self.durable + 1)
        data = sample_block(Position(self.boot, number))
        return self._sealer.seal(data, topic=topic, held=held)

    def send(self, envelope: bytes) -> None:
        """Publish one, at QoS 1."""
        self._client.publish(node_topic(_NODE, Stream.FRAMES), envelope, qos=1)

    def fill(self, envelopes: Sequence[bytes]) -> None:
        """Publish all, and wait until the broker has them."""
        for envelope in envelopes:
            self.send(envelope)
        for _ in envelopes:
            assert self._told.acquire(timeout=_PATIENCE_S), "the broker takes no more"

    def wait_for(self, count: int) -> None:
        """Wait until the gateway vouched for so many blocks."""
        wait_until(lambda: self.durable >= count, "all durable", seconds=_PATIENCE_S)

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
        self._told.release()
