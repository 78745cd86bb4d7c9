"""Blocks are short while a viewer watches."""

from __future__ import annotations

from contextlib import closing
from typing import TYPE_CHECKING

from eskin_sensor_node.firmware.schedule import Attention
from eskin_sensor_node.link.publisher import Publisher
from eskin_sensor_node.settings import IdentitySection

from eskin.wire.messages import Position
from tests.support.processes import wait_until
from tests.unit.sensor_node.designs import SECOND, Bench
from tests.unit.sensor_node.peer import Peer

if TYPE_CHECKING:
    from pathlib import Path

    from tests.support.brokers import Mosquitto
    from tests.support.identities import Identities

MS = SECOND // 1000


def test_one_word_is_good_for_a_minute_at_most_and_shortens_nothing_it_should_not() -> None:
    attention = Attention(50 * MS)
    assert attention.most(0, MS) == 0
    attention.hold(SECOND, 3600 * SECOND)
    assert attention.until == 61 * SECOND
    attention.hold(2 * SECOND, SECOND)
    assert attention.most(61 * SECOND - 1, MS) == 50
    assert attention.most(61 * SECOND, MS) == 0
    # A sample that takes longer than a short block is one.
    assert attention.most(0, 80 * MS) == 1
    never = Attention(0)
    never.hold(0, SECOND)
    assert never.most(0, MS) == 0


def test_only_word_that_acknowledges_something_shortens_blocks(
    tmp_path: Path, broker: Mosquitto, identities: Identities, site_file: Path
) -> None:
    first, second = [Position(1, 0)], [Position(1, 1)]
    with (
        closing(
            Bench(tmp_path / "node", broker={"port": broker.node_port, "drain_s": 0.0})
        ) as bench,
        Peer(identities, broker.gateway_port, acknowledging=False) as peer,
    ):
        publisher = Publisher(
            bench.outbox,
            record_status=bench.node.record_status,
            attend=bench.node.attend,
            radio=bench.radio(),
            broker=bench.settings.broker,
            identity=IdentitySection(directory=identities.node.directory, site=site_file),
        )
        unit = bench.node.taxels[0]
        bench.run_to(1.0)
        publisher.start()
        wait_until(lambda: len(peer.messages) > 24, "all arrived")
        peer.acknowledge("fingertip", first, watched=3000)
        wait_until(lambda: bench.outbox.held() == (1, 1), "the first is forgotten")
        # It hears of onlookers behind that.
        wait_until(lambda: bench.node._attention.until > 0, "a viewer watches")
        bench.run_to(2.0)
        assert unit.next.n == 50
        bench.run_to(6.0)
        assert unit.next.n == 250
        # A copy, which forgets nothing; and behind it one without a viewer.
        peer.acknowledge("fingertip", first, watched=3000)
        peer.acknowledge("fingertip", second)
        wait_until(lambda: bench.outbox.held() == (1, 2), "the second is forgotten")
        bench.run_to(7.0)
        assert unit.next.n == 250
        publisher.stop()
