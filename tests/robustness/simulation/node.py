"""A node: the firmware's outbox on a flash, and the publisher without its thread."""

from __future__ import annotations

import sqlite3
from contextlib import closing, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple, cast

import numpy as np
import paho.mqtt.client as mqtt
from eskin_sensor_node.firmware.assembler import encode
from eskin_sensor_node.firmware.message_writer import FRAME, STATUS
from eskin_sensor_node.firmware.peaks import CERTAIN
from eskin_sensor_node.link.publisher import Publisher
from eskin_sensor_node.machine.flash.flash import Flash
from eskin_sensor_node.machine.node_layout import describe
from eskin_sensor_node.machine.radio import Radio
from eskin_sensor_node.node.factory import build_outbox
from eskin_sensor_node.settings import BrokerSection, IdentitySection, RadioSection

from eskin.errors import FlashError
from eskin.privacy.subject import KEY_BYTES
from eskin.wire.frames import Layout, Patch, Privacy
from tests.robustness.simulation.faults import ACTIVE_S
from tests.robustness.simulation.timeline import EPOCH, SECOND

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from eskin_sensor_node.firmware.message_writer import Record

    from tests.robustness.simulation.world import World

_PLAIN: Final = Patch("skin", "pressure", "Pa", ("p01",), 1e-3)
_WORN: Final = Patch("body", "bioelectric", "V", ("b01",), 1e-6, Privacy.BIOMETRIC, "wearer")
_LAYOUT: Final = Layout((_PLAIN.content_hash, _WORN.content_hash), (1, 1))
_DESCRIBED: Final = describe(_LAYOUT, (_PLAIN, _WORN))
_CAPACITY: Final = 12_000
_WINDOW: Final = 24
_SAMPLES: Final = 8
_TURN_S: Final = 0.15
_FAIL: Final = """CREATE TRIGGER simulated_fault BEFORE INSERT ON message
    BEGIN SELECT RAISE(ROLLBACK, 'database or disk is full'); END"""
_WORK: Final = "DROP TRIGGER IF EXISTS simulated_fault"
_MANY: Final = 30
_BURSTS: Final = 5


class Made(NamedTuple):
    """A message that became durable in a flash.

    Attributes:
        kind: Of `eskin_sensor_node.firmware.message_writer`.
        body: Its bytes.
        subject: Whose it is, if it is biometric.
    """

    kind: int
    body: bytes
    subject: str | None = None


@dataclass
class _Meter:
    sent: int = 0
    received: int = 0


class _Delivery:
    """What paho returns for a publication."""

    rc = mqtt.MQTT_ERR_SUCCESS

    def __init__(self) -> None:
        self.published = False

    def is_published(self) -> bool:
        return self.published


class _Client:
    """Takes the place of paho's client: a connection to the simulated broker."""

    on_connect: Callable[..., None]
    on_disconnect: Callable[..., None]
    on_connect_fail: Callable[..., None]
    on_message: Callable[..., None]

    def __init__(self, node: Node) -> None:
        self._node = node
        self.connected = False

    def is_connected(self) -> bool:
        return self.connected

    def subscribe(self, topics: object) -> None:
        del topics

    def socket(self) -> None:
        """Asked for only to end a connection that carries no acknowledgements."""
        self._node.disconnect(0.5)

    def publish(self, topic: str, payload: bytes, *, qos: int, retain: bool) -> _Delivery:
        del qos
        delivery = _Delivery()
        self._node.send(topic, bytes(payload), delivery, retain=retain)
        return delivery


@dataclass(frozen=True, slots=True)
class _Reason:
    is_failure: bool = False


class _Message(NamedTuple):
    topic: str
    payload: bytes


class Node:
    """One node.

    Args:
        world: What it is part of.
        name: Its name.
        folder: Of its flash.

    Attributes:
        made: What became durable, by boot and sequence.
        boots: Times that it started.
    """

    def __init__(self, world: World, name: str, folder: Path) -> None:
        self._world = world
        self.name = name
        self._path = folder / f"{name}.flash"
        self._draw = world.timeline.draws(f"messages of {name}")
        self._latency = world.timeline.draws(f"latency of {name}")
        self.made: dict[tuple[int, int], Made] = {}
        self.boots = 0
        self._sent = 0
        self._arrives = 0
        self._connection = 0
        self._failing = False
        self._life = 0
        self._gap: tuple[int, int] | None = None
        self._start()
        self._measure()

    @property
    def waiting(self) -> int:
        """Messages in the flash; one at least while it has no power."""
        return self.outbox.messages if self._powered else 1

    def has_given_up(self, position: tuple[int, int]) -> bool:
        """Whether a message was made, and is in the flash no more as far as that can be read."""
        return position in self.made and (not self._powered or self.flash.read(position) is None)

    # Power.

    def _start(self) -> None:
        self._powered = True
        self._life += 1
        self.boots += 1
        # An epoch makes boots count from a number that no clock decides.
        self.flash = Flash(self._path, node=self.name, key=bytes(KEY_BYTES), epoch=1)
        broker = BrokerSection(window=_WINDOW, resend_s=1.0, status_s=4.0, silence_s=8.0)
        self.outbox = build_outbox(
            self.flash, capacity=_CAPACITY, broker=broker, described=_DESCRIBED
        )
        parties, timeline = self._world.parties, self._world.timeline
        radio = Radio(
            RadioSection(),
            now=timeline.monotonic_ns,
            random=np.random.default_rng(0),
            meter=_Meter(),
        )
        self._client = _Client(self)
        self._publisher = Publisher(
            self.outbox,
            radio=radio,
            broker=broker,
            identity=IdentitySection(
                directory=parties.nodes[self.name].directory, site=parties.site_file
            ),
            record_status=self._record_status,
            client=cast("mqtt.Client", self._client),
            clock=timeline.monotonic_ns,
        )
        self._world.timeline.note(self.name, f"starts boot {self.flash.boot}")
        self._connect()
        self._turn(self._life)

    def lose_power(self, lasts: float) -> None:
        """Lose all but the flash, and start again after so many seconds."""
        if not self._powered:
            return
        self._world.timeline.note(self.name, "loses power")
        self._powered = False
        self._life += 1
        self._connection += 1
        self.flash.close()
        self._world.timeline.after(lasts, self._start)

    def reset(self) -> None:
        """Start the firmware again; the radio stays connected."""
        if not self._powered:
            return
        with suppress(FlashError):
            self.outbox.restart()
        self._world.timeline.note(self.name, f"is reset to boot {self.outbox.boot}")

    def close(self) -> None:
        """Close the flash."""
        if self._powered:
            self.flash.close()

    # Messages.

    def _measure(self) -> None:
        timeline = self._world.timeline
        if timeline.now >= ACTIVE_S * SECOND:
            return
        timeline.after(self._draw.uniform(0.3, 0.9), self._measure)
        if self._powered:
            self.measure(self._draw.randint(1, 3))

    def measure(self, count: int) -> None:
        """Make messages, in one commit."""
        if not self._powered:
            return
        writer = self.outbox.message_writer
        self._set_failing()
        records: list[tuple[Record, bool]] = []
        start = EPOCH + self._world.timeline.now
        with suppress(FlashError), self.outbox.batch() as batch:
            for number in range(count):
                what, time = self._draw.random(), (start + number, start + number + 500)
                if what < 0.25:
                    peak = 0, 0, time, CERTAIN, (1, 1), (0.0, 1.0), (0.0, 1.0), 1.0
                    records.append((writer.statements(time, peaks=[peak]), False))
                else:
                    page = what > 0.65
                    grid = 0, 1_000_000, 0, _SAMPLES, 1.0
                    patch = int(page), 0, 0, 1, *_encoded(self._draw.random())
                    frame = writer.frame(
                        int(page), 0, time, [grid], [patch],
                        samples=_SAMPLES, lasting=1_000_000 * (_SAMPLES - 1),
                    )  # fmt: skip
                    records.append((frame, page))
            batch.take([record for record, _ in records])
        self._note_durable(batch.records, {each.sequence for each, worn in records if worn})

    def measure_much(self) -> None:
        """Make so many that the flash evicts some, again and again."""
        for number in range(_BURSTS):
            self._world.timeline.after(0.3 * number, lambda: self.measure(_MANY))

    def _record_status(self) -> None:
        if self._world.timeline.now >= ACTIVE_S * SECOND and not self.outbox.messages:
            return
        self._set_failing()
        now = self._world.timeline.now
        with self.outbox.batch() as batch:
            status = self.outbox.message_writer.status(
                (EPOCH + now, EPOCH + now + 500),
                "simulated",
                "simulated",
                now,
                self.outbox.usage(),
                0,
                held=self.outbox.held(),
                ended=self.outbox.ended(),
            )
            batch.take([status])
        self._note_durable(batch.records, set())

    def _note_durable(self, records: list[Record], worn: set[int]) -> None:
        """Remember what is in the flash now; all of a batch, or nothing."""
        boot, settled = self.outbox.settled
        if not records or settled <= records[-1].sequence:
            self._world.timeline.note(self.name, f"fails to write {len(records)}")
            return
        for each in records:
            subject = self._world.wearers[self.name] if each.sequence in worn else None
            self.made[boot, each.sequence] = Made(each.kind, each.body, subject)
        # The gap of what was evicted is no part of the batch, and grows until it is sent.
        if self._gap is not None and self._gap[0] == boot:
            self._note_gap(self._gap)
        for sequence in range(records[-1].sequence + 1, settled):
            self._note_gap((boot, sequence))
        first = records[0].sequence
        self._world.timeline.note(self.name, f"makes {boot}/{first}..{settled - 1}")

    def _note_gap(self, position: tuple[int, int]) -> None:
        kept = self.flash.read(position)
        if kept is not None:
            self._gap = position
            self.made[position] = Made(kept.kind, kept.body)

    def _set_failing(self) -> None:
        """Make the flash fail, or work, as faults have it."""
        failing = self._world.faults.lasting(self.name, "cannot write its flash") is not None
        if failing != self._failing:
            with closing(sqlite3.connect(self._path, isolation_level=None)) as db:
                db.execute(_FAIL if failing else _WORK)
            self._failing = failing

    # Connection.

    def _turn(self, life: int) -> None:
        if life != self._life:
            return
        with suppress(FlashError):
            self._publisher.turn()
        self._world.timeline.after(_TURN_S, lambda: self._turn(life))

    def _connect(self) -> None:
        if self._powered and not self._client.connected:
            self._client.connected = True
            self._client.on_connect(self._client, None, None, _Reason(), None)

    def disconnect(self, lasts: float) -> None:
        """Lose the connection, and what is under way on it."""
        if not self._client.connected:
            return
        self._world.timeline.note(self.name, "disconnects")
        self._client.connected = False
        self._connection += 1
        self._world.timeline.after(lasts, self._connect)

    def send(self, topic: str, payload: bytes, delivery: _Delivery, *, retain: bool) -> None:
        """Send to the broker, in order."""
        self._sent += 1
        number, connection, timeline = self._sent, self._connection, self._world.timeline
        self._arrives = max(
            self._arrives, timeline.now + round(self._latency.uniform(0.001, 0.05) * SECOND)
        )

        def arrive() -> None:
            if connection != self._connection:
                return
            delivery.published = True
            if self._world.faults.often(self.name, "loses what it sends"):
                timeline.note(self.name, f"message #{number} is lost")
            else:
                self._world.broker.take(self.name, number, topic, payload, retain=retain)

        timeline.after((self._arrives - timeline.now) / SECOND, arrive)

    def receive(self, topic: str, payload: bytes) -> None:
        """Take an acknowledgement."""
        if not self._client.connected:
            return
        if self._world.faults.often(self.name, "gets no acknowledgements"):
            self._world.timeline.note(self.name, "loses an acknowledgement")
            return
        self._client.on_message(self._client, None, _Message(topic, payload))


def _encoded(value: float) -> tuple[Any, ...]:
    lows = [value * 1000.0 + k for k in range(_SAMPLES)]
    return encode(lows, [low + 1.0 for low in lows], _SAMPLES, 1, 0, b"", 0)


def is_frame(made: Made) -> bool:
    """Whether a message is a frame."""
    return made.kind == FRAME


def is_status(made: Made) -> bool:
    """Whether a message is a status."""
    return made.kind == STATUS
