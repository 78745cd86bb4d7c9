"""Messages that the cloud answers with ``later`` are sent again, and hold up no others."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from eskin_gateway.forward.forwarder import DeferredNodes
from eskin_gateway.spool.batch import Batch, SpoolMessage
from eskin_gateway.upstream.ingest_client import ItemResult

from eskin.errors import CloudError
from tests.support.processes import wait_until
from tests.unit.gateway.forwarding import MESSAGES, MemoryCloud, Setup

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path


class Partial(MemoryCloud):
    """A cloud that cannot store messages of one node now.

    Attributes:
        held: The node; empty: it can store all.
        asked_of: How often it was sent messages of each node.
    """

    def __init__(self) -> None:
        super().__init__()
        self.held = "n"
        self.asked_of: list[set[str]] = []

    def send(self, messages: Sequence[tuple[str, bytes]]) -> list[ItemResult]:
        self.asked_of.append({node for node, _ in messages})
        good = iter(super().send([each for each in messages if each[0] != self.held]))
        later = ItemResult("later", "its slot is locked")
        return [later if node == self.held else next(good) for node, _ in messages]


def test_deferred_messages_stay_in_the_spool_and_hold_up_no_other_node(tmp_path: Path) -> None:
    cloud = Partial()
    setup = Setup(tmp_path, cloud, cloud)
    others = [("m", bytes([number])) for number in range(20)]
    setup.spool.commit(Batch([SpoolMessage(node, 1, body) for node, body in others]))
    while setup.forwarder.forward():
        pass
    assert cloud.stored == others
    assert len(cloud.asked_of) <= 8, "the node is left out, not asked for in each request"
    assert setup.spool.statistics.messages == len(MESSAGES)
    assert setup.spool.dead_letters() == []
    assert "its slot is locked" in str(setup.forwarder.fault)
    cloud.held = ""
    wait_until(lambda: setup.forwarder.forward() > 0, "the node is sent again")
    while setup.forwarder.forward():
        pass
    assert sorted(cloud.stored) == sorted([*MESSAGES, *others])
    assert setup.spool.statistics.messages == 0
    assert not setup.forwarder.fault
    setup.spool.close()


class Refusing(Partial):
    """A cloud that answers 503 where it can store no message of a request."""

    def send(self, messages: Sequence[tuple[str, bytes]]) -> list[ItemResult]:
        if {node for node, _ in messages} <= {self.held}:
            self.asked_of.append({self.held})
            raise CloudError("the server of its slot is away", status=503, retry_after=5.0)
        return super().send(messages)


def test_request_of_deferred_nodes_alone_holds_up_no_other_node(tmp_path: Path) -> None:
    cloud = Refusing()
    setup = Setup(tmp_path, cloud, cloud)
    for number in range(5):
        setup.forwarder.forward()
        assert setup.spool.statistics.messages == len(MESSAGES), "nothing of the node is stored"
        other = "m", bytes([number])
        setup.spool.commit(Batch([SpoolMessage("m", 1, other[1])]))
        assert setup.forwarder.forward() == 1
        assert cloud.stored[-1] == other
    assert setup.metrics.value("cloud_failures_total") >= 1
    assert "its slot is away" in str(setup.forwarder.fault)
    setup.spool.close()


def test_cloud_that_stores_nothing_is_waited_for(tmp_path: Path) -> None:
    cloud = MemoryCloud()
    cloud.mode = "busy"
    setup = Setup(tmp_path, cloud, cloud)
    setup.forwarder.forward()
    for number in range(3):
        setup.spool.commit(Batch([SpoolMessage(f"m{number}", 1, b"new")]))
        with pytest.raises(CloudError):
            setup.forwarder.forward()
    setup.spool.close()


def test_a_slow_answer_defers_for_longer() -> None:
    now = [0.0]
    deferred = DeferredNodes(lambda: now[0])
    deferred.defer({"quick": "locked"}, 0.01)
    deferred.defer({"slow": "locked"}, 10.0)
    deferred.defer({"hanging": "locked"}, 300.0)
    left = []
    for second in range(0, 70, 5):
        now[0] = float(second)
        left.append(deferred.left_out())
    assert left[0] == ["quick", "slow", "hanging"]
    assert left[1] == left[7] == ["slow", "hanging"]
    assert left[9] == left[11] == ["hanging"]
    assert left[13] == []
    assert deferred.fault is None
