"""After each start and failure, the gateway finds what the cloud lost."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_gateway.forward.forwarder import Forwarder
from eskin_gateway.metrics import Metrics
from eskin_gateway.settings import CloudSection
from eskin_gateway.spool.batch import Batch, SpoolMessage
from eskin_gateway.spool.spool import Spool
from eskin_gateway.upstream.confirmations_client import ConfirmationsClient

from eskin.errors import CloudError
from tests.support.processes import wait_until
from tests.unit.gateway.certificates import KnownNodes
from tests.unit.gateway.descriptions import KnownDescriptions
from tests.unit.gateway.forwarding import MemoryCloud
from tests.unit.gateway.in_memory import quick

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import pytest


class Restored(ConfirmationsClient):
    """A cloud whose store ends at some sequence."""

    def __init__(self, last: int) -> None:
        self.last = last
        self.away = True
        self.asked: list[list[tuple[str, int, int]]] = []

    def find_missing(
        self, confirmed: Sequence[tuple[str, int, int]]
    ) -> list[tuple[str, int, int, int]]:
        self.asked.append(list(confirmed))
        return [(n, boot, self.last + 1, last) for n, boot, last in confirmed if last > self.last]


def test_lost_messages_are_logged_once_and_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    spool = Spool(tmp_path / "spool.db", capacity=10**7, max_dead_letters=3)
    spool.commit(Batch([SpoolMessage("n", 1, bytes([k]), 5, k) for k in range(10)]))
    cloud, restored = MemoryCloud(), Restored(6)
    forwarder = Forwarder(
        CloudSection(),
        spool=spool,
        certificates_client=KnownNodes(),
        descriptions_client=KnownDescriptions(),
        ingest_client=cloud,
        backoff=quick(),
        metrics=Metrics(),
        confirmations_client=restored,
    )
    forwarder.start()
    wait_until(lambda: len(cloud.stored) == 10, "all is forwarded")
    wait_until(lambda: len(restored.asked) > 0, "the cloud is asked")
    cloud.mode = "error"
    spool.commit(Batch([SpoolMessage("n", 1, b"late", 5, 10)]))
    wait_until(lambda: forwarder.fault is not None, "the cloud is away")
    cloud.mode = "ok"
    wait_until(lambda: restored.asked[-1] == [("n", 5, 10)], "it is asked when it is back")
    wait_until(lambda: forwarder.missing == 4, "what it lost is counted")
    forwarder.stop()
    spool.close()
    lost = [r for r in caplog.records if "cloud lost messages" in r.message]
    assert {r.levelname for r in lost} == {"ERROR"}
    assert len({r.message for r in lost}) == len(lost)


def test_failed_comparison_blocks_nothing(tmp_path: Path) -> None:
    class Broken(Restored):
        def find_missing(
            self, confirmed: Sequence[tuple[str, int, int]]
        ) -> list[tuple[str, int, int, int]]:
            super().find_missing(confirmed)
            raise CloudError("away")

    spool = Spool(tmp_path / "spool.db", capacity=10**7, max_dead_letters=3)
    broken, cloud = Broken(0), MemoryCloud()
    forwarder = Forwarder(
        CloudSection(),
        spool=spool,
        certificates_client=KnownNodes(),
        descriptions_client=KnownDescriptions(),
        ingest_client=cloud,
        backoff=quick(),
        metrics=Metrics(),
        confirmations_client=broken,
    )
    forwarder.start()
    for k in range(5):
        spool.commit(Batch([SpoolMessage("n", 1, bytes([k]), 5, k)]))
        wait_until(lambda: spool.statistics.messages == 0, "it is forwarded")
    assert len(broken.asked) == 1
    forwarder.stop()
    spool.close()
