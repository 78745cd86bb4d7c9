"""Layouts and patches are kept in flash, and said before what is read by them."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

import pytest
from eskin_sensor_node.firmware.message_writer import STATEMENTS, MessageWriter
from eskin_sensor_node.machine.flash.sealing import UNREADABLE

from eskin.wire.frames import Statements, content_hash
from eskin.wire.messages import Position, Status
from tests.support.processes import wait_until
from tests.unit.eskin.wire.frames import examples
from tests.unit.sensor_node.designs import waiting
from tests.unit.sensor_node.flashes import change, on_disk, open_flash
from tests.unit.sensor_node.peer import Peer

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from tests.support.brokers import Mosquitto
    from tests.support.identities import Identities
    from tests.unit.sensor_node.designs import Bench
    from tests.unit.sensor_node.stores import Store

OWN = {content_hash(data): data for data in (each.encode() for each in examples.PATCHES)}
LAYOUT = examples.LAYOUT.content_hash
OWN |= {LAYOUT: examples.LAYOUT.encode()}
OTHER = {content_hash(data): data for data in (each.encode() for each in examples.SMALL[:3])}


def test_descriptions_outlive_a_restart_and_are_sealed(store: Store, path: Path) -> None:
    store.outbox.describe(LAYOUT, OWN)
    assert store.outbox.descriptions() == list(OWN)
    store.flash.close()
    assert b"temperature" not in on_disk(path.parent)
    flash = open_flash(path)
    assert flash.descriptions() == list(OWN)
    assert {name: flash.description(name) for name in OWN} == OWN
    assert flash.description(bytes(32)) is None
    flash.close()


def test_older_descriptions_stay_while_messages_wait(store: Store) -> None:
    store.outbox.describe(LAYOUT, OWN)
    store.fill(2)
    store.outbox.describe(b"other", OTHER)
    assert store.outbox.descriptions() == [*OWN, *(name for name in OTHER if name not in OWN)]
    store.outbox.acknowledge([(store.outbox.boot, 0, 100)])
    store.outbox.describe(b"other", OTHER)
    assert set(store.outbox.descriptions()) == set(OTHER)


def test_damaged_description_is_written_anew(store: Store, path: Path) -> None:
    store.outbox.describe(LAYOUT, OWN)
    change(path, "UPDATE description SET body = x'00' WHERE hash = ?", LAYOUT)
    assert store.outbox.description(LAYOUT) is None
    store.outbox.describe(LAYOUT, OWN)
    assert store.outbox.description(LAYOUT) == OWN[LAYOUT]


def test_lost_record_of_a_node_with_a_layout_is_a_statement(store: Store, path: Path) -> None:
    store.outbox.describe(LAYOUT, OWN)
    with store.outbox.batch() as batch:
        writer = MessageWriter(store.outbox.boot, store.outbox, LAYOUT)
        batch.take([writer.frame(0, 5, (7, 9), [], [], samples=12, lasting=3)])
    change(path, "UPDATE message SET body = x'00'")
    kept = waiting(store.flash)[0]
    gap = Statements.decode(kept.body).gaps[0]
    assert kept.kind == STATEMENTS
    assert (gap.reason, gap.messages, gap.samples) == (UNREADABLE, 1, 12)
    assert gap.lost == ((store.outbox.boot, 0, 0),)


def test_descriptions_come_behind_the_first_status_at_each_connection(
    bench: Bench, broker: Mosquitto, identities: Identities, publishing: Callable[..., Any]
) -> None:
    bench.outbox.describe(LAYOUT, OWN)
    bench.run_to(1.0)
    with Peer(identities, broker.gateway_port, acknowledging=False) as peer, publishing():
        wait_until(lambda: len(peer.order) > 3, "messages came")
        status, *described = peer.timeline[: len(OWN) + 1]
        assert isinstance(status, Position)
        assert isinstance(peer.messages[status], Status)
        assert described == list(OWN)
        assert peer.strangers == 0
        # Nothing asks for them, and no time brings them again.
        wait_until(lambda: max(peer.copies.values()) > 1, "messages came twice")
        assert sum(isinstance(each, bytes) for each in peer.timeline) == len(OWN)
    with Peer(identities, broker.gateway_port) as again, publishing():
        wait_until(lambda: bench.outbox.messages == 0, "flash is empty")
    # The broker has retained a status of the first connection.
    described = [each for each in again.timeline if isinstance(each, bytes)]
    assert described == list(OWN)
    assert again.timeline.index(described[-1]) < again.timeline.index(Position(1, 0))


def test_wanted_descriptions_come_again(
    bench: Bench,
    broker: Mosquitto,
    identities: Identities,
    publishing: Callable[..., Any],
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.WARNING, "eskin_sensor_node.link.uplink")
    bench.outbox.describe(LAYOUT, OWN)
    bench.run_to(1.0)
    patch = examples.AIR.content_hash
    with Peer(identities, broker.gateway_port, acknowledging=False) as peer, publishing():
        wait_until(lambda: len(peer.order) > 3, "messages came")
        name = bench.settings.node.name

        def asked() -> bool:
            peer.acknowledge(name, [Position(9, 9)], want=(patch, bytes(32)))
            return peer.timeline.count(patch) > 1

        wait_until(asked, "the patch came again")
        assert peer.timeline.count(LAYOUT) == 1
        assert bench.outbox.messages > 0
    assert bytes(32).hex() in caplog.text


@pytest.mark.parametrize("bench", [{"radio": {"loss": 0.5, "tries": 1}}], indirect=True)
def test_descriptions_that_the_air_loses_are_sent_again(
    bench: Bench, broker: Mosquitto, identities: Identities, publishing: Callable[..., Any]
) -> None:
    bench.outbox.describe(LAYOUT, OWN)
    with Peer(identities, broker.gateway_port) as peer, publishing():
        wait_until(lambda: set(peer.timeline) >= set(OWN), "all came")
