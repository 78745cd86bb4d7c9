"""A publisher that ends leaves nothing behind that a gateway could still take."""

from __future__ import annotations

import math
import threading
from contextlib import closing
from typing import TYPE_CHECKING

from eskin_sensor_node.link.keys import NodeKeys
from eskin_sensor_node.link.publisher import Publisher
from eskin_sensor_node.settings import IdentitySection

from tests.support.processes import wait_until
from tests.unit.sensor_node.designs import Bench
from tests.unit.sensor_node.peer import Peer

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

    from tests.support.brokers import Mosquitto
    from tests.support.identities import Identities


def test_status_that_a_renewal_asks_for_at_the_very_end_is_waited_for(
    tmp_path: Path,
    broker: Mosquitto,
    identities: Identities,
    site_file: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    settings = {"port": broker.node_port, "drain_s": 60.0}
    with (
        closing(Bench(tmp_path / "node", broker=settings)) as bench,
        Peer(identities, broker.gateway_port),
    ):
        outbox = bench.outbox
        publisher = Publisher(
            outbox,
            record_status=bench.node.record_status,
            radio=bench.radio(),
            broker=bench.settings.broker,
            identity=IdentitySection(directory=identities.node.directory, site=site_file),
        )
        publisher.start()
        known = lambda: outbox.newest_status is not None and outbox.messages == 0  # noqa: E731
        wait_until(known, "the gateway knows it")
        introduced, renewed = outbox.newest_status, iter([True])
        in_turn = threading.Event()

        def refresh(_keys: NodeKeys, _now: float) -> bool:
            in_turn.set()
            wait_until(
                lambda: publisher._until < math.inf, "it is notified to end, in its last turn"
            )
            return next(renewed, False)

        monkeypatch.setattr(NodeKeys, "refresh", refresh)
        wait_until(in_turn.is_set, "a turn has begun")
        publisher.stop()
        assert next(renewed, None) is None
        assert outbox.newest_status != introduced
        assert outbox.messages == 0
