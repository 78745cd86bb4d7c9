"""Each client of the cloud reads and respects Retry-After."""

from __future__ import annotations

from contextlib import contextmanager
from random import SystemRandom
from typing import TYPE_CHECKING, Any

import pytest
from eskin_gateway.commands.poller import CommandPoller, CommandsClient
from eskin_gateway.commands.publisher import PendingCommands
from eskin_gateway.ingest.biometric import BiometricEncryptor
from eskin_gateway.metrics import Metrics
from eskin_gateway.ops.subject_sync import SubjectSync
from eskin_gateway.publish.alarms import AlarmPublisher
from eskin_gateway.spool.subject_assignments import SubjectAssignments
from eskin_gateway.upstream.cloud_client import CloudClient
from eskin_gateway.upstream.ingest_client import IngestClient
from eskin_gateway.upstream.subjects_client import SubjectsClient

from eskin.errors import CloudError
from eskin.identity import IdentityKind, client_context
from eskin.identity.identity import ROOT_FILE
from eskin.privacy import FileMasterKey, KeyStore
from eskin.runtime.supervised import Backoff
from tests.support.processes import free_port, wait_until
from tests.unit.gateway.certificates import KnownNodes
from tests.unit.gateway.https_server import HttpsServer

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from tests.support.identities import Identities


class Refuser:
    """A cloud that rejects all requests with a Retry-After.

    Attributes:
        asked: How often it was asked.
    """

    def __init__(self) -> None:
        self.retry_after = "7"
        self.asked = 0

    def __call__(
        self, _path: str, _headers: Mapping[str, str], _body: bytes, /
    ) -> tuple[int, dict[str, str], bytes]:
        self.asked += 1
        return 503, {"retry-after": self.retry_after}, b"later"


@pytest.fixture
def refuser() -> Refuser:
    return Refuser()


@pytest.fixture
def reach(identities: Identities, refuser: Refuser) -> Iterator[tuple[str, dict[str, Any]]]:
    """URL of that cloud, and arguments of a client."""
    port = free_port()
    server = HttpsServer(identities.make(IdentityKind.SERVER, "server.cloud"), port, refuser)
    context = client_context(identities.gateway.directory / ROOT_FILE)
    common = {"headers": dict, "context": context, "timeout_s": 60.0}
    yield f"https://127.0.0.1:{port}/api/v1/ingest", common
    server.close()


def refused_batch(url: str, common: dict[str, Any]) -> None:
    client = CloudClient([url], **common)
    try:
        IngestClient(client).send([("fingertip", b"")])
    finally:
        client.close()


def refused_question(url: str, common: dict[str, Any]) -> None:
    commands_client = CommandsClient(CloudClient([url], **common))
    try:
        commands_client.fetch([], 0.0, None)
    finally:
        commands_client.close()


def refused_notice(url: str, common: dict[str, Any]) -> None:
    client = CloudClient([url], **common)
    try:
        SubjectsClient(client).send([], ["0" * 32])
    finally:
        client.close()


@pytest.mark.parametrize(
    ("value", "least", "most"),
    [
        ("7", 7, 7),
        ("Wed, 21 Oct 2065 07:28:00 GMT", 10**6, 10**12),
        ("Wed, 21 Oct 2015 07:28:00 GMT", 0, 0),
        ("soon", None, None),
    ],
)
@pytest.mark.parametrize("ask", [refused_batch, refused_question, refused_notice])
def test_retry_after_is_a_number_or_a_date(
    reach: tuple[str, dict[str, Any]],
    refuser: Refuser,
    ask: Any,
    value: str,
    least: float | None,
    most: float | None,
) -> None:
    url, common = reach
    refuser.retry_after = value
    with pytest.raises(CloudError, match="answered 503 Service Unavailable") as caught:
        ask(url, common)
    assert caught.value.status == 503
    if least is None or most is None:
        assert caught.value.retry_after is None
    else:
        assert caught.value.retry_after is not None
        assert least <= caught.value.retry_after <= most


class Patience(Backoff):
    """Records the Retry-After of failures."""

    def __init__(self) -> None:
        super().__init__(0.001, 0.001, random=SystemRandom())
        self.stated: list[float | None] = []

    def failed(self, *, at_least: float | None = None) -> float:
        self.stated.append(at_least)
        return super().failed(at_least=at_least)


@contextmanager
def command_poller(
    url: str, common: dict[str, Any], _folder: Path, patience: Backoff
) -> Iterator[CommandPoller]:
    yield CommandPoller(
        PendingCommands(5.0),
        AlarmPublisher(None),
        commands_client=CommandsClient(CloudClient([url], **common, abortable=True)),
        wait_s=1.0,
        backoff=patience,
        metrics=Metrics(),
    )


@contextmanager
def subject_sync(
    url: str, common: dict[str, Any], folder: Path, patience: Backoff
) -> Iterator[SubjectSync]:
    keystore = KeyStore(folder / "keys", FileMasterKey(folder / "master.key"))
    keystore.shred(keystore.create("Ada").pseudonym)
    assignments, client = SubjectAssignments(keystore), CloudClient([url], **common)
    yield SubjectSync(
        keystore,
        assignments,
        encryptor=BiometricEncryptor(assignments),
        subjects_client=SubjectsClient(client),
        certificates_client=KnownNodes(),
        share=True,
        backoff=patience,
    )
    client.close()


@pytest.mark.parametrize("make", [command_poller, subject_sync])
def test_threads_respect_retry_after(
    reach: tuple[str, dict[str, Any]], refuser: Refuser, tmp_path: Path, make: Any
) -> None:
    url, common = reach
    refuser.retry_after = "1000"
    patience = Patience()
    with make(url, common, tmp_path, patience) as asker:
        asker.start()
        wait_until(lambda: bool(patience.stated), "it was rejected")
        asker.stop()
    assert (patience.stated, refuser.asked) == ([1000.0], 1)
