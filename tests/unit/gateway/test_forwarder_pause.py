"""The forwarder pauses after a small batch, and only then."""

from __future__ import annotations

from threading import Event
from typing import TYPE_CHECKING

import pytest

from tests.support.processes import wait_until
from tests.unit.gateway.forwarding import MESSAGES, MemoryCloud, Setup

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from eskin_gateway.upstream.ingest_client import ItemResult


class _Rests(Event):
    """Records the waits, and returns at once."""

    def __init__(self) -> None:
        super().__init__()
        self.seconds: list[float] = []

    def wait(self, timeout: float | None = None) -> bool:
        self.seconds.append(timeout or 0.0)
        return self.is_set()


@pytest.mark.parametrize(
    ("most", "took", "rests"),
    [
        (20, 0.02, [0.02]),  # all ten messages at once
        (20, 0.3, [0.05]),
        (10, 0.02, []),  # ten are all that a request may have
        (7, 0.02, []),  # seven and three: too few
        (6, 0.02, [0.02]),  # six and four
    ],
)
def test_forwarder_pauses_after_a_small_batch_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most: int, took: float, rests: list[float]
) -> None:
    now = [0.0]
    cloud = MemoryCloud()
    setup = Setup(tmp_path, cloud, cloud, most=most, clock=lambda: now[0])
    send = cloud.send

    def slowly(messages: Sequence[tuple[str, bytes]]) -> list[ItemResult]:
        now[0] += took
        return send(messages)

    monkeypatch.setattr(cloud, "send", slowly)
    noted = setup.forwarder._thread.stopping = _Rests()
    setup.forwarder.start()
    wait_until(lambda: setup.spool.statistics.messages == 0, "the spool is empty")
    setup.forwarder.stop()
    setup.spool.close()
    assert cloud.stored == MESSAGES
    assert noted.seconds == pytest.approx(rests)
