"""The forwarder deletes nothing that the cloud did not answer for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import cbor2
import pytest
from eskin_gateway.spool.batch import Batch, SpoolMessage
from eskin_gateway.upstream.cloud_client import CloudClient
from eskin_gateway.upstream.ingest_client import IngestClient, encode_batch
from hypothesis import given
from hypothesis import strategies as st

from eskin.errors import CloudError
from eskin.identity import IdentityKind, client_context
from eskin.identity.identity import ROOT_FILE
from tests.support.processes import wait_until
from tests.unit.gateway.forwarding import MESSAGES, MemoryCloud, Setup
from tests.unit.gateway.stub_cloud import StubCloud

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tests.support.identities import Identities


class Https(IngestClient):
    """The cloud over connections of its own."""

    def __init__(
        self,
        stub: StubCloud,
        identities: Identities,
        *,
        timeout_s: float = 60.0,
    ) -> None:
        self._own = CloudClient(
            [stub.url],
            headers=lambda: {"Content-Type": "application/cbor"},
            context=client_context(identities.gateway.directory / ROOT_FILE, identities.gateway),
            timeout_s=timeout_s,
        )
        super().__init__(self._own)

    def close(self) -> None:
        self._own.close()


@pytest.fixture(params=["memory", "https"])
def setup(
    request: pytest.FixtureRequest, tmp_path: Path, identities: Identities
) -> Iterator[Setup]:
    if request.param == "memory":
        twin = MemoryCloud()
        made = Setup(tmp_path, twin, twin)
        yield made
        made.spool.close()
        return
    with StubCloud(identities.make(IdentityKind.SERVER, "server.cloud")) as stub:
        client = Https(stub, identities)
        made = Setup(tmp_path, client, stub)
        yield made
        client.close()
        made.spool.close()
    assert stub.faults == []


def test_all_messages_arrive_once_in_order(setup: Setup) -> None:
    setup.forwarder.start()
    wait_until(lambda: setup.spool.statistics.messages == 0, "the spool is empty")
    setup.forwarder.stop()
    assert setup.cloud.stored == MESSAGES
    assert setup.metrics.value("messages_stored_total") == 10
    assert setup.forwarder.reachable is True


@pytest.mark.parametrize("mode", ["error", "busy", "nonsense", "short"])
def test_messages_wait_for_a_failing_cloud(setup: Setup, mode: str) -> None:
    setup.cloud.mode = mode
    setup.cloud.__dict__["retry_after"] = "0"
    setup.forwarder.start()
    wait_until(lambda: setup.metrics.value("cloud_failures_total") >= 3, "it tries again")
    assert setup.spool.statistics.messages == 10
    assert setup.forwarder.reachable is False
    assert setup.forwarder.fault is not None
    setup.cloud.mode = "ok"
    wait_until(lambda: setup.spool.statistics.messages == 0, "the spool is empty")
    setup.forwarder.stop()
    # Some may have been sent without others, to find a message that causes the failure.
    assert sorted(setup.cloud.stored) == MESSAGES
    assert setup.forwarder.retrying == 0
    assert setup.forwarder.fault is None


def test_messages_that_the_cloud_fails_at_block_no_others(setup: Setup) -> None:
    broken = {MESSAGES[number][1] for number in (0, 1, 5, 9)}
    setup.cloud.failing = broken
    setup.forwarder.start()
    wait_until(lambda: setup.spool.statistics.messages == 4, "all others are stored")
    wait_until(lambda: "fails at each message" in str(setup.forwarder.fault), "there is a fault")
    setup.spool.commit(Batch([SpoolMessage("n", 1, b"new")]))
    wait_until(lambda: ("n", b"new") in setup.cloud.stored, "a new one passes")
    wait_until(
        lambda: "4 message(s), one of n" in str(setup.forwarder.fault), "the fault names the node"
    )
    assert {body for _, body in setup.cloud.stored}.isdisjoint(broken)
    setup.cloud.failing = set()
    wait_until(lambda: setup.spool.statistics.messages == 0, "the spool is empty")
    setup.forwarder.stop()
    assert sorted(setup.cloud.stored) == sorted([*MESSAGES, ("n", b"new")])
    assert setup.spool.dead_letters() == []
    assert setup.forwarder.retrying == 0
    assert setup.forwarder.fault is None


def test_message_at_which_the_cloud_hangs_blocks_no_others(
    stub: StubCloud, tmp_path: Path, identities: Identities
) -> None:
    stub.hanging = {MESSAGES[0][1]}
    client = Https(stub, identities, timeout_s=0.2)
    made = Setup(tmp_path, client, stub)
    made.forwarder.start()
    wait_until(lambda: sorted(stub.stored) == MESSAGES[1:], "all others are stored")
    wait_until(lambda: "1 message(s), one of n" in str(made.forwarder.fault), "there is a fault")
    stub.hanging = set()
    stub.release.set()
    wait_until(lambda: made.spool.statistics.messages == 0, "the spool is empty")
    made.forwarder.stop()
    client.close()
    made.spool.close()
    assert sorted(stub.stored) == MESSAGES


def test_outage_while_a_message_is_retried_is_logged_once(
    setup: Setup, caplog: pytest.LogCaptureFixture
) -> None:
    setup.cloud.failing = {MESSAGES[0][1]}
    setup.forwarder.start()
    wait_until(lambda: "1 message(s), one of n" in str(setup.forwarder.fault), "it is left out")
    caplog.clear()
    setup.cloud.mode, setup.cloud.__dict__["retry_after"] = "busy", "0"
    setup.spool.commit(Batch([SpoolMessage("n", 1, b"new")]))
    wait_until(lambda: "work=forwarder" in caplog.text, "it is logged")
    setup.cloud.mode = "ok"
    wait_until(lambda: "1 message(s), one of n" in str(setup.forwarder.fault), "it is back")
    setup.forwarder.stop()
    assert caplog.text.count("work=forwarder") == 1


def test_rejected_messages_become_dead_letters_with_reason(setup: Setup) -> None:
    setup.cloud.mode = "reject"
    assert setup.forwarder.forward() == 4
    assert setup.spool.statistics.messages == 6
    assert [(d.node, d.reason, d.body) for d in setup.spool.dead_letters()] == [
        (node, "cloud: not wanted", body) for node, body in MESSAGES[:4]
    ]
    assert setup.metrics.value("cloud_rejected_total") == 4


def test_messages_that_the_cloud_has_already_are_settled(setup: Setup) -> None:
    setup.cloud.stored = MESSAGES[:3]
    assert setup.forwarder.forward() == 4
    assert setup.metrics.value("cloud_duplicate_total") == 3
    assert setup.metrics.value("messages_stored_total") == 1


def test_request_that_is_too_large_is_sent_in_parts(setup: Setup) -> None:
    setup.cloud.mode = "large"
    setup.forwarder.start()
    wait_until(lambda: setup.spool.statistics.messages == 0, "the spool is empty")
    setup.forwarder.stop()
    assert setup.cloud.stored == MESSAGES
    assert setup.spool.dead_letters() == []


def test_result_that_cannot_be_stored_is_requested_again(
    setup: Setup, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(setup.spool, "_forward", setup.spool._ingest)
    setup.spool._ingest.execute("PRAGMA query_only = ON")
    setup.forwarder.start()
    wait_until(lambda: "cannot be written" in str(setup.forwarder.fault), "there is a fault")
    assert setup.spool.statistics.messages == 10
    setup.spool._ingest.execute("PRAGMA query_only = OFF")
    wait_until(lambda: setup.spool.statistics.messages == 0, "the spool is empty")
    setup.forwarder.stop()
    assert setup.cloud.stored == MESSAGES
    assert setup.metrics.value("cloud_duplicate_total") >= 4


def test_message_committed_during_stop_is_sent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cloud = MemoryCloud()
    setup = Setup(tmp_path, cloud, cloud)
    take = setup.spool.take

    def meanwhile(*given: Any, **named: Any) -> list[SpoolMessage]:
        """After an empty read, a message is committed and the thread is stopped."""
        found = take(*given, **named)
        if not found:
            monkeypatch.setattr(setup.spool, "take", take)
            setup.spool.commit(Batch([SpoolMessage("n", 1, b"late")]))
            setup.forwarder._thread.stopping.set()
        return found

    monkeypatch.setattr(setup.spool, "take", meanwhile)
    setup.forwarder.start()
    wait_until(lambda: len(cloud.stored) == 11, "all is sent")
    setup.forwarder.stop()
    setup.spool.close()
    assert cloud.stored == [*MESSAGES, ("n", b"late")]


@pytest.fixture
def stub(identities: Identities) -> Iterator[StubCloud]:
    with StubCloud(identities.make(IdentityKind.SERVER, "server.cloud")) as running:
        yield running
    assert running.faults == []


def test_unreachable_cloud_is_retried(
    stub: StubCloud, tmp_path: Path, identities: Identities
) -> None:
    stub.end()
    client = Https(stub, identities)
    made = Setup(tmp_path, client, stub)
    made.forwarder.start()
    wait_until(lambda: made.metrics.value("cloud_failures_total") >= 2, "it tries")
    stub.begin()
    wait_until(lambda: made.spool.statistics.messages == 0, "the spool is empty")
    made.forwarder.stop()
    client.close()
    made.spool.close()
    assert stub.stored == MESSAGES


def test_slow_cloud_gets_smaller_requests(
    stub: StubCloud, tmp_path: Path, identities: Identities
) -> None:
    stub.mode = "slow"
    client = Https(stub, identities, timeout_s=0.2)
    made = Setup(tmp_path, client, stub)
    with pytest.raises(CloudError, match="Timeout"):
        made.forwarder.forward()
    asked = made.metrics.value("messages_forwarded_total")
    with pytest.raises(CloudError, match="Timeout"):
        made.forwarder.forward()
    assert made.metrics.value("messages_forwarded_total") - asked == asked // 2, "it is given less"
    client.close()
    client = made.forwarder._ingest_client = Https(stub, identities)  # patient: it is slow no more
    stub.mode = "ok"
    stub.release.set()
    while made.forwarder.forward():
        assert made.metrics.value("messages_forwarded_total") < 100
    assert sorted(stub.stored) == MESSAGES
    client.close()
    made.spool.close()


def test_cloud_of_other_ca_gets_nothing(tmp_path: Path, identities: Identities) -> None:
    outsiders = type(identities)(tmp_path / "outsiders")
    with StubCloud(outsiders.make(IdentityKind.SERVER, "server.cloud")) as outsider:
        client = Https(outsider, identities)
        with pytest.raises(CloudError, match="CERTIFICATE_VERIFY_FAILED"):
            client.send(MESSAGES)
        client.close()
    assert outsider.requests == 0


@given(st.lists(st.tuples(st.text(max_size=70), st.binary(max_size=300)), max_size=300))
def test_batch_is_the_encoding_of_its_pairs(messages: list[tuple[str, bytes]]) -> None:
    assert encode_batch(messages) == cbor2.dumps([list(message) for message in messages])
