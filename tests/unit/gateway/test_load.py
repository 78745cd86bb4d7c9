"""More than the cloud takes: the gateway refuses by holding back, loses nothing, and empties."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from eskin_gateway.service import Gateway

from eskin.wire.topics import Stream
from tests.support.processes import wait_until
from tests.unit.gateway.messages import status
from tests.unit.gateway.skins import SkinNode, SkinOf, patch

if TYPE_CHECKING:
    from eskin_gateway.settings import GatewaySettings

    from tests.unit.gateway.stub_cloud import StubCloud
    from tests.unit.gateway.wire_node import WireNode

CAPACITY = 2_097_152
FRAMES = 400  # of 8 kB: half as much again as the spool holds
SKIN = SkinOf(patch(0, 64))


@pytest.mark.nightly
@pytest.mark.parametrize("mode", ["flooded", "slow"])
def test_overload_reaches_the_node_and_nothing_is_lost(
    settings: GatewaySettings, cloud: StubCloud, node: WireNode, mode: str
) -> None:
    sections = {
        # Longer than the test: nothing is dropped to keep the broker's connection alive.
        "broker": settings.broker.model_copy(
            update={"receive_queue_messages": 16, "keepalive_s": 600}
        ),
        "spool": settings.spool.model_copy(update={"capacity_bytes": CAPACITY}),
        "cloud": settings.cloud.model_copy(update={"timeout_s": 600.0}),
    }
    running = Gateway(settings.model_copy(update=sections))
    cloud.mode, cloud.retry_after = mode, "0"
    running.start()
    try:
        wait_until(lambda: running.broker.connected, "the gateway is connected")
        node.say(Stream.STATUS, status(0))
        SkinNode(node, SKIN).describe()
        random = np.random.default_rng(1)
        for number in range(1, FRAMES):
            noise = random.integers(0, 15_000_000, (40, 64)).astype(np.float64)
            node.say(Stream.FRAMES, SKIN.frame(number, {0: noise}, rows=40))
        full = "the spool and the inbox are full"
        wait_until(
            lambda: running.commit_loop.fault is not None and running.receive_queue.full, full
        )
        held = running.spool.statistics
        wait_until(lambda: len(node.acknowledged) == held.messages, "what is durable is answered")
        assert held.messages < FRAMES
        assert held.used <= CAPACITY
        assert cloud.stored == []
        cloud.mode = "ok"
        cloud.release.set()
        node.wait_for(*((1, number) for number in range(FRAMES)))
        wait_until(lambda: running.spool.statistics.messages == 0, "the spool is empty")
        assert len(set(cloud.stored)) == len(cloud.stored) == FRAMES
        assert cloud.duplicates == 0
        assert running.receive_queue.statistics.dropped == 0
        assert running.commit_loop.fault is None
    finally:
        cloud.release.set()
        running.stop()
