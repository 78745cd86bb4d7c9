"""The cloud as a process: real sockets, TLS, signals, settings."""

from __future__ import annotations

import signal
import socket
import ssl
import sys
import threading
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING

import httpx
import pytest
from eskin_cloud.access import create_login_code
from eskin_cloud.settings import CloudSettings
from eskin_cloud.store import Store

from eskin.errors import SettingsError
from eskin.identity import Identity, IdentityKind, client_context
from eskin.runtime.http_server.listener import bind
from eskin.runtime.settings import table
from tests.support.processes import Running
from tests.unit.cloud.clouds import batch
from tests.unit.cloud.messages import CHANNEL, NODE, peak, stretch
from tests.unit.cloud.service import PATIENCE_S, PROGRAM, Service

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tests.support.identities import Identities


def test_body_of_an_answer_does_not_wait_until_its_head_is_acknowledged() -> None:
    with (
        bind("people", "127.0.0.1", 0) as listening,
        socket.create_connection(listening.getsockname()[:2], timeout=PATIENCE_S),
        listening.accept()[0] as accepted,
    ):
        assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


@pytest.fixture
def service(tmp_path: Path, identities: Identities) -> Iterator[Service]:
    """A running cloud."""
    with Service(tmp_path, identities) as running:
        yield running


@pytest.fixture(scope="module")
def standing(tmp_path_factory: pytest.TempPathFactory, identities: Identities) -> Iterator[Service]:
    """One for all tests that leave it as it was."""
    with Service(tmp_path_factory.mktemp("standing"), identities) as running:
        yield running


def test_batch_over_tls_reaches_a_live_stream_and_a_series(service: Service) -> None:
    heard: list[str] = []
    listening = threading.Event()

    def listen() -> None:
        with (
            service.people(service.token()) as client,
            client.stream("GET", "/api/v1/live") as answer,
        ):
            for line in answer.iter_lines():
                heard.append(line)
                listening.set()

    thread = threading.Thread(target=listen)
    thread.start()
    assert listening.wait(PATIENCE_S)
    answer = service.ingest(batch(stretch(0), peak(1)))
    assert [item["result"] for item in answer.json()["items"]] == ["stored", "stored"]
    service.wait_for(lambda: "event: peak" in heard, "the peak was heard")
    assert "event: frame" in heard
    with service.people(service.token()) as client:
        series = client.get(f"/api/v1/series/{NODE}/{CHANNEL}").json()
        assert series["lo"] == [1.0]
        assert client.get("/readyz").json() == {"status": "ok"}
    assert service.stop() == 0
    thread.join(PATIENCE_S)
    assert not thread.is_alive()
    assert "stopped" in service.output()
    assert "Traceback" not in service.output()


def test_acknowledged_batch_survives_a_power_cut(service: Service) -> None:
    assert service.ingest(batch(stretch(0), stretch(1))).status_code == 200
    service.kill()
    service.log.write_text("")
    service.start()
    answer = service.ingest(batch(stretch(1), stretch(2)))
    assert [item["result"] for item in answer.json()["items"]] == ["duplicate", "stored"]


def test_gateways_listener_speaks_tls_only(standing: Service) -> None:
    with pytest.raises(httpx.TransportError):
        httpx.get(f"http://127.0.0.1:{standing.ingest_port}/healthz", timeout=PATIENCE_S)
    old = ssl.create_default_context(cafile=standing.server.directory / "root.pem")
    old.set_ciphers("DEFAULT@SECLEVEL=0")
    with pytest.warns(DeprecationWarning, match="TLSv1"):
        old.minimum_version = ssl.TLSVersion.TLSv1
    with pytest.warns(DeprecationWarning, match="TLSv1_1"):
        old.maximum_version = ssl.TLSVersion.TLSv1_1
    with pytest.raises(httpx.ConnectError):
        httpx.get(
            f"https://localhost:{standing.ingest_port}/healthz", verify=old, timeout=PATIENCE_S
        )


def test_gateways_listener_is_closed_to_clients_without_a_certificate(standing: Service) -> None:
    anonymous = client_context(standing.server.directory / "root.pem")
    with pytest.raises(httpx.TransportError), standing.gateway_client(verify=anonymous) as client:
        client.post("/api/v1/ingest", content=batch(stretch(0)))


def test_certificate_of_another_kind_gets_the_reason_and_is_closed(
    standing: Service, identities: Identities
) -> None:
    root = standing.server.directory / "root.pem"
    for kind, name in ((IdentityKind.NODE, "n7"), (IdentityKind.CLIENT, "client.demo")):
        other = client_context(root, identities.make(kind, name))
        with standing.gateway_client(verify=other) as client:
            answer = client.post("/api/v1/ingest", content=batch(stretch(0)))
        assert answer.status_code == 403
        assert answer.headers["connection"] == "close"


@pytest.mark.parametrize("version", [ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3])
def test_resumed_session_is_none_that_passes_without_its_chain(
    standing: Service, version: ssl.TLSVersion
) -> None:
    context = ssl.create_default_context(cafile=standing.server.directory / "root.pem")
    folder = standing.gateway.directory
    context.load_cert_chain(folder / "chain.pem", folder / "key.pem")
    context.minimum_version = context.maximum_version = version
    body = batch(stretch(3))
    head = (
        "POST /api/v1/ingest HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/cbor\r\n"
        f"Content-Length: {len(body)}\r\n\r\n"
    )
    session = None
    for _ in range(2):
        with (
            socket.create_connection(("localhost", standing.ingest_port)) as plain,
            context.wrap_socket(plain, server_hostname="localhost", session=session) as client,
        ):
            client.sendall(head.encode() + body)
            status = b"403" if client.session_reused else b"200"
            assert client.recv(4096).split()[1] == status
            session = client.session


def test_client_that_leaves_in_mid_body_is_one_quiet_line(standing: Service) -> None:
    body = batch(stretch(0))
    head = (
        "POST /api/v1/ingest HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/cbor\r\n"
        f"Content-Length: {len(body)}\r\n\r\n"
    )
    context = client_context(standing.server.directory / "root.pem", standing.gateway)
    address = "localhost", standing.ingest_port
    before = len(standing.output().splitlines())
    with (
        socket.create_connection(address) as plain,
        context.wrap_socket(plain, server_hostname="localhost") as connection,
    ):
        connection.sendall(head.encode() + body[:-1])
    left = "client left in the middle of its body"
    standing.wait_for(lambda: left in standing.output(), "it is notified")
    # A request that comes after it is answered, so all that was to be said of it was said.
    assert standing.ingest(batch(stretch(1))).status_code == 200
    said = standing.output().splitlines()[before:]
    assert [line for line in said if "ERROR" in line or "Traceback" in line] == []
    assert len([line for line in said if left in line]) == 1


def test_rubbish_leaves_no_line_in_the_log(standing: Service) -> None:
    before = len(standing.output().splitlines())
    for _ in range(5):
        with socket.create_connection(
            ("127.0.0.1", standing.port), timeout=PATIENCE_S
        ) as connection:
            connection.sendall(b"\x16\x03\x01\x00 rubbish\r\n\r\n")
            assert b" 400 " in connection.recv(4096)
    # A request that comes after them is answered, so all that was to be said of them was said.
    assert standing.ingest(batch(stretch(2))).status_code == 200
    said = standing.output().splitlines()[before:]
    assert [line for line in said if "uvicorn" in line or "nvalid" in line] == []


def test_people_cannot_ingest_and_gateways_cannot_ask(standing: Service) -> None:
    headers = {"Authorization": f"Bearer {standing.token()}"}
    with standing.gateway_client(headers=headers) as gateway:
        for path in ("/api/v1/nodes", "/healthz", "/metrics"):
            assert gateway.get(path).status_code == 404
    with standing.people(standing.token()) as client:
        assert client.post("/api/v1/ingest").status_code == 405


@pytest.mark.parametrize("path", ["/metrics", "/healthz", "/login", "/api/v1/nodes"])
def test_name_that_dns_led_here_gets_nothing(standing: Service, path: str) -> None:
    with standing.people(standing.token()) as client:
        assert client.get(path, headers={"Host": "evil.example"}).status_code == 421
        for host in ("localhost", "127.0.0.1:8080", "[::1]:8080"):
            assert client.get(path, headers={"Host": host}).status_code == 200


@pytest.mark.nightly
def test_address_that_a_proxy_names_is_not_loopback(tmp_path: Path, identities: Identities) -> None:
    more = 'names = ["skin.example"]\nproxies = ["127.0.0.0/8"]\n'
    with Service(tmp_path, identities, more=more) as service, service.people("x") as client:
        named = {"Host": "Skin.example", "X-Forwarded-For": "127.0.0.1, 192.0.2.1"}
        assert client.get("/metrics", headers=named).status_code == 403
        assert client.get("/metrics").status_code == 200


def test_body_of_a_person_is_bounded(standing: Service) -> None:
    with standing.people(standing.token()) as client:
        assert client.post("/api/v1/nodes/x/commands", content=b"x" * 65_537).status_code == 413
        assert client.post("/api/v1/nodes/x/commands", content=b"x" * 65_536).status_code != 413


@pytest.mark.nightly
def test_renewed_certificate_is_taken_without_a_restart(
    service: Service, identities: Identities
) -> None:
    fresh = identities.make(IdentityKind.SERVER, "server.cloud")
    assert fresh.directory == service.server.directory

    def shown() -> bool:
        address = ("localhost", service.ingest_port)
        pem = ssl.get_server_certificate(address, ca_certs=str(fresh.directory / "root.pem"))
        return pem.encode() in (fresh.directory / "chain.pem").read_bytes()

    service.wait_for(shown, "the renewed certificate is shown")


def test_second_cloud_on_the_same_store_is_refused(
    standing: Service, tmp_path: Path, identities: Identities
) -> None:
    folder = tmp_path / "second"
    folder.mkdir()
    other = Service(folder, identities)
    config = Path(other.argv[-1])
    config.write_text(config.read_text().replace(str(other.place), str(standing.place)))
    Running.start(other)
    assert other.ended() == 1
    assert "another cloud" in other.output()


@pytest.mark.nightly
def test_people_come_by_https_where_there_is_a_certificate(
    tmp_path: Path, identities: Identities
) -> None:
    own = identities.make(IdentityKind.SERVER, "server.people").directory
    with Service(tmp_path, identities, more=f"identity = '{own}'\n") as service:
        with Store(service.place) as store:
            code = create_login_code(store, lifetime=timedelta(minutes=1))
        url = f"https://localhost:{service.port}/login?code={code}"
        answer = httpx.get(url, verify=client_context(own / "root.pem"), timeout=PATIENCE_S)
        assert answer.status_code == 303
        assert "Secure" in answer.headers["set-cookie"]
        service.signal(signal.SIGINT)
        assert service.stop() == 0


@pytest.mark.nightly
def test_port_in_use_is_said_in_one_line(standing: Service, tmp_path: Path) -> None:
    config = (
        Path(standing.argv[-1]).read_text().replace(str(standing.place), str(tmp_path / "other"))
    )
    path = tmp_path / "other.toml"
    path.write_text(config)
    second = Running([sys.executable, "-c", PROGRAM, str(path)], log=tmp_path / "second.log")
    second.start()
    assert second.ended() == 1
    assert second.output().splitlines()[-1].startswith("eskin: people.port: 127.0.0.1:")


def load(tmp_path: Path, text: str) -> CloudSettings:
    """Load settings."""
    path = tmp_path / "cloud.toml"
    path.write_text(text)
    return CloudSettings.load(path)


_NEEDED = "[store]\npath = 's'\n[gateways]\nidentity = 'i'\n"


def test_plain_http_beyond_loopback_is_refused(tmp_path: Path) -> None:
    for host in ("0.0.0.0", "example.org", "10.0.0.1", "::"):  # noqa: S104 - that is the point
        with pytest.raises(SettingsError, match="plain HTTP stays on loopback"):
            load(tmp_path, f"{_NEEDED}[people]\nhost = '{host}'\n")
    for host in ("127.0.0.1", "::1", "localhost", "127.5.5.5"):
        assert load(tmp_path, f"{_NEEDED}[people]\nhost = '{host}'\n").people.host == host
    assert load(tmp_path, f"{_NEEDED}[people]\nhost = '::'\nidentity = 'x'\n").people.host == "::"


@pytest.mark.parametrize(
    ("text", "setting"),
    [
        ("[people]\nport = 70000\n", "people.port"),
        ("[people]\nprot = 1\n", "people.prot"),
        ("[live]\nheartbeat_s = 0\n", "live.heartbeat_s"),
        ("[nodes]\nlate_s = nan\n", "nodes.late_s"),
        ("[nothing]\n", "nothing"),
    ],
)
def test_bad_setting_is_named(tmp_path: Path, text: str, setting: str) -> None:
    with pytest.raises(SettingsError) as caught:
        load(tmp_path, _NEEDED + text)
    assert caught.value.setting == setting


def test_every_setting_is_described() -> None:
    settings = list(table(CloudSettings))
    assert len(settings) > 15
    assert all(setting.help for setting in settings)
    needed = {setting.name for setting in settings if setting.default is None}
    assert needed == {"gateways.identity"}


@pytest.mark.nightly
def test_unusable_identity_is_named(tmp_path: Path, identities: Identities) -> None:
    service = Service(tmp_path, identities, more=f"identity = '{tmp_path}'\n")
    Running.start(service)
    assert service.ended() == 1
    assert "people.identity" in service.output()
    assert Identity.load(service.server.directory).name == "server.cloud"
