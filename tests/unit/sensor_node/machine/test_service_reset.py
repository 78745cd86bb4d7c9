"""A reset within a node's process: it stays connected, and is set as it was before."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from eskin.wire.frames import Statements
from eskin.wire.messages import ResetCause, Result, Status
from tests.support.processes import wait_until
from tests.unit.sensor_node.designs import settings
from tests.unit.sensor_node.machine.hanging import hang
from tests.unit.sensor_node.peer import Peer
from tests.unit.sensor_node.services import serving

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

    from tests.support.brokers import Mosquitto
    from tests.support.identities import Identities


def test_service_goes_on_after_the_watchdog_and_stays_connected(
    tmp_path: Path,
    identities: Identities,
    site_file: Path,
    broker: Mosquitto,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO)
    hang(monkeypatch, "t02", 3)
    given = settings(
        tmp_path,
        node={"speed": 5.0},
        machine={"watchdog_s": 1.0},
        broker={"port": broker.node_port, "status_s": 0.2, "drain_s": 0.0},
        identity={"directory": identities.node.directory, "site": site_file},
    )
    with Peer(identities, broker.gateway_port) as peer, serving(given):

        def second() -> dict[int, object]:
            return {p.sequence: m for p, m in sorted(peer.messages.items()) if p.boot == 2}

        # Nothing says that they come in the order in which they were recorded.
        wait_until(
            lambda: {0, 1} <= second().keys() and Status in {type(m) for m in second().values()},
            "gap, result and status of boot 2",
        )
        said = list(second().values())
    stated, result = said[:2]
    assert isinstance(stated, Statements)
    (gap,) = stated.gaps
    assert gap.reason == "watchdog reset"
    assert isinstance(result, Result)
    assert result.state["t01"]["mode"] == "samples"
    status = next(m for m in said if isinstance(m, Status))
    assert status.cause is ResetCause.WATCHDOG
    assert [r.message for r in caplog.records if r.message.startswith("connected:")] == [
        f"connected: broker=127.0.0.1:{broker.node_port}"
    ]
