"""docker-compose.yml on a real engine: it comes up, carries data, keeps it, and grants little."""

from __future__ import annotations

import io
import tarfile
import time
from typing import TYPE_CHECKING, Any

import httpx
import orjson
import pytest

from eskin.identity import new_key
from eskin.identity.identity import save_key
from eskin.wire.timestamp import parse_timestamp
from tests.support.processes import wait_until
from tests.system.compose.checks import (
    PSQL,
    missing,
    require_few_rights,
    require_limits,
    wait_for_samples_after,
)
from tests.system.compose.secrets import secrets_in
from tests.system.compose.stack import IDENTIFIED, IMAGES, NODES, SERVICES, Stack, items

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.compose


@pytest.fixture
def client(stack: Stack) -> Iterator[httpx.Client]:
    with stack.client() as client:
        yield client


def test_three_nodes_reach_the_cloud(stack: Stack, client: httpx.Client) -> None:
    before = stack.channels(client)
    assert {name.split("/")[0] for name in before} == set(NODES)
    wait_until(
        lambda: all(
            channel["last"] > before[name]["last"]
            for name, channel in stack.channels(client).items()
        ),
        "each channel grows",
    )
    online = dict.fromkeys(NODES, "online")

    def health() -> dict[str, str]:
        return {node["id"]: node["health"] for node in items(client, "/api/v1/nodes")}

    wait_until(lambda: health() == online, "each node is online")


def test_other_mqtt_client_reads_what_is_public(stack: Stack) -> None:
    words = ["run", "--rm", "-T", "client", "-C", "1", "-W", "20", "-t"]
    said = stack.compose(*words, "eskin/v1/live/palm/t01.capacitance", errors=False)
    hull = orjson.loads(said)
    assert hull["lo"] < hull["hi"]
    assert hull["unit"] == "F"
    status = stack.compose(*words, "eskin/v1/live/forearm/status", errors=False)
    assert orjson.loads(status)["online"] is True


def test_dashboard_asks_to_sign_in_and_takes_a_one_time_address(stack: Stack) -> None:
    with stack.client(signed_in=False) as visitor:
        assert visitor.get("/api/v1/nodes").status_code == httpx.codes.UNAUTHORIZED
        assert visitor.get("/").headers["location"] == "/login"
        address = httpx.URL(stack.execute("cloud", "eskin", "cloud", "login"))
        assert visitor.get(address.raw_path.decode()).status_code == httpx.codes.SEE_OTHER
        assert "<title>" in visitor.get("/").text
        assert len(items(visitor, "/api/v1/nodes")) == 3
    with stack.client(signed_in=False) as second:
        second.get(address.raw_path.decode())
        assert second.get("/api/v1/nodes").status_code == httpx.codes.UNAUTHORIZED


@pytest.mark.parametrize("service", SERVICES)
def test_container_has_no_right_that_it_does_not_need(stack: Stack, service: str) -> None:
    require_few_rights(stack, service)


def test_dashboard_alone_is_reachable_and_from_this_machine_alone(stack: Stack) -> None:
    published: dict[str, Any] = {
        f"{service} {port}": bound
        for service in SERVICES
        for port, bound in stack.inspect(service)["NetworkSettings"]["Ports"].items()
        if bound
    }
    assert published == {"cloud 8080/tcp": [{"HostIp": "127.0.0.1", "HostPort": str(stack.port)}]}


@pytest.mark.parametrize("service", SERVICES)
def test_container_takes_so_much_memory_and_so_many_processes(stack: Stack, service: str) -> None:
    require_limits(stack, service)


def test_services_reach_those_alone_that_they_must_speak_with(stack: Stack) -> None:
    def reaches(service: str, other: str) -> bool:
        look = ["sh", "-c", f"getent hosts {other} >/dev/null && echo yes || echo no"]
        return stack.execute(service, *look) == "yes"

    reached = {
        (service, other)
        for service in ("sensor_node_palm", "gateway", "cloud")
        for other in ("ca", "broker", "cloud", "gateway", "sensor_node_forearm")
        if service != other and reaches(service, other)
    }
    assert reached == {
        ("sensor_node_palm", "ca"),
        ("sensor_node_palm", "broker"),
        ("sensor_node_palm", "sensor_node_forearm"),
        ("gateway", "ca"),
        ("gateway", "broker"),
        ("gateway", "cloud"),
        ("cloud", "ca"),
        ("cloud", "gateway"),
    }


def test_master_keys_lie_on_volumes_of_their_own(stack: Stack) -> None:
    for service in ("gateway", "sensor_node_palm"):
        found = stack.execute(service, "find", "/var/lib", "-name", "master.key").split()
        assert found == ["/var/lib/eskin-master/master.key"]
        volumes = {m["Destination"]: m["Name"] for m in stack.inspect(service)["Mounts"]}
        assert volumes["/var/lib/eskin-master"] != volumes["/var/lib/eskin"]


def test_private_keys_are_readable_by_their_service_alone(stack: Stack) -> None:
    for service in IDENTIFIED:
        found = stack.execute(
            service,
            "sh",
            "-c",
            "find /var/lib/eskin -name key.pem -o -name '*.key' | xargs stat -c %a:%u",
        ).split()
        assert found
        assert set(found) == {"600:10001"}, service


def test_database_is_the_cloud_s_alone(stack: Stack) -> None:
    who = "select current_user, current_setting('is_superuser'), current_setting('fsync')"
    assert stack.execute("database", *PSQL, "-d", "eskin", "-c", who) == "eskin|off|on"
    with pytest.raises(AssertionError, match=r"no pg_hba\.conf entry"):
        stack.execute("database", *PSQL, "-d", "postgres", "-c", "select 1")
    frames = stack.execute("database", *PSQL, "-d", "eskin", "-c", "select count(*) from frames")
    assert int(frames) > 0
    assert stack.inspect("database")["HostConfig"]["NetworkMode"] == "none"


def test_images_hold_no_secret(stack: Stack, tmp_path: Path) -> None:
    images = [f"eskin-{image}" for image in IMAGES]
    saved = tmp_path / "images.tar"
    stack.docker("save", "--output", str(saved), *images, seconds=300)
    assert list(secrets_in(saved)) == []
    saved.unlink()
    history = stack.docker("history", "--no-trunc", "--format", "{{.CreatedBy}}", images[0])
    assert "PRIVATE KEY" not in history


def test_secret_in_an_image_would_be_found(tmp_path: Path) -> None:
    save_key(tmp_path / "harmless.txt", new_key())
    layer = io.BytesIO()
    with tarfile.open(fileobj=layer, mode="w") as files:
        files.add(tmp_path / "harmless.txt", "etc/harmless.txt")
        files.add(tmp_path / "harmless.txt", "enrol/palm.token")
    saved = tmp_path / "images.tar"
    with tarfile.open(saved, "w") as images:
        entry = tarfile.TarInfo("1234/layer.tar")
        entry.size = len(layer.getvalue())
        images.addfile(entry, io.BytesIO(layer.getvalue()))
    assert list(secrets_in(saved)) == ["etc/harmless.txt", "enrol/palm.token"]


def test_killed_containers_come_back_and_nothing_is_lost(
    stack: Stack, client: httpx.Client
) -> None:
    for service in ("gateway", "broker", "database", "cloud"):
        stack.kill(service)
        stack.wait_healthy(service)
    wait_for_samples_after(stack, client, time.time_ns())
    # What was on the way when its carrier died is sent again a few seconds later. Outboxes need not
    # be empty in any status: each states the same instant between two frames.
    wait_until(lambda: not missing(stack), "no sample is missing", seconds=60)
    assert items(client, "/api/v1/events?kind=gap") == []


def test_killed_node_comes_back_in_its_next_boot(stack: Stack, client: httpx.Client) -> None:
    boot = client.get("/api/v1/nodes/palm").json()["boot"]
    stack.kill("sensor_node_palm")
    stack.wait_healthy("sensor_node_palm")

    def back() -> bool:
        node = client.get("/api/v1/nodes/palm").json()
        return bool(node["boot"] > boot and node["health"] == "online")

    wait_until(back, "palm is online in its next boot", seconds=60)


def test_data_and_identities_outlive_the_containers(stack: Stack, client: httpx.Client) -> None:
    before = stack.channels(client)
    serials = stack.execute("ca", "cat", "ledger.jsonl").count('"kind": "node"')
    stack.compose("down", "--timeout", "20", seconds=120)
    stack.up()
    for name, channel in stack.channels(client).items():
        assert channel["first"] == before[name]["first"]
        assert parse_timestamp(channel["last"]) >= parse_timestamp(before[name]["last"])
    assert stack.execute("ca", "cat", "ledger.jsonl").count('"kind": "node"') == serials
    wait_for_samples_after(stack, client, time.time_ns())
