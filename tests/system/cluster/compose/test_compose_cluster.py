"""Three clouds and two gateways in containers, on a cluster of three database servers."""

from __future__ import annotations

import os
import subprocess
import time
from typing import TYPE_CHECKING, Any, Final

import pytest

from eskin.wire.timestamp import parse_timestamp
from tests.support.processes import wait_until
from tests.system.cluster.compose.conftest import ADDED, CLOUDS, CLUSTER_FILE, WORKERS
from tests.system.compose.checks import (
    PSQL,
    missing,
    require_few_rights,
    require_limits,
    wait_for_samples_after,
)
from tests.system.compose.secrets import secrets_in
from tests.system.compose.stack import NODES, REPOSITORY, Stack, items

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.cluster

SERVERS: Final = ("database", *WORKERS)
SLOTS: Final = 64
SOON_S: Final = 10.0
"""Until data of all nodes are at the clouds again, when a cloud and a gateway were killed."""
SIGN_IN: Final = """
import sys, psycopg
for role in ("eskin", "postgres"):
    for port in (5432, 5433, 5434):
        try:
            with psycopg.connect(host="/run/database", port=port, user=role, dbname="eskin") as c:
                print(role, port, c.execute("SHOW is_superuser").fetchone()[0])
        except psycopg.OperationalError:
            print(role, port, "refused")
"""


def messages(stack: Stack) -> int:
    """How many messages are stored."""
    query = "select sum(last - first + 1) from sequences"
    return int(stack.execute("database", *PSQL, "-d", "eskin", "-c", query))


def wait_until_whole(stack: Stack) -> None:
    """Wait until what was on the way is stored; assert that nothing was given up."""
    wait_until(lambda: not missing(stack), "no message is missing", seconds=60)
    with stack.client() as client:
        assert items(client, "/api/v1/events?kind=gap") == []
        assert {node["missing"] for node in items(client, "/api/v1/nodes")} <= {0, None}


@pytest.mark.parametrize("cloud", CLOUDS)
def test_three_nodes_reach_each_cloud(stack: Stack, cloud: str) -> None:
    with stack.client(cloud) as client:
        assert {node["id"] for node in items(client, "/api/v1/nodes")} == set(NODES)
        wait_for_samples_after(stack, client, time.time_ns())


def test_gateways_share_what_nodes_say(stack: Stack) -> None:
    def stored() -> dict[str, int]:
        return {each["id"]: each["stored"] for each in items(client, "/api/v1/gateways")}

    with stack.client() as client:
        before = stored()
        assert set(before) == {"gateway.g1", "gateway.g2"}
        wait_until(
            lambda: all(now > before[name] for name, now in stored().items()),
            "each gateway has brought more",
        )


def test_store_is_distributed_over_the_workers(stack: Stack) -> None:
    said = stack.execute("cloud", "eskin", "cloud", "distribute", "--check").splitlines()
    found = {line.split()[-1]: int(line.split()[0]) for line in said[:-1]}
    assert set(found) == {"/run/database:5433", "/run/database:5434"}
    assert sum(found.values()) == SLOTS
    assert min(found.values()) > 0
    assert messages(stack) > 0


@pytest.mark.parametrize("service", [*ADDED, "database"])
def test_container_has_few_rights_and_limits(stack: Stack, service: str) -> None:
    require_few_rights(stack, service)
    require_limits(stack, service)


def test_dashboards_alone_are_reachable_and_from_this_machine_alone(stack: Stack) -> None:
    published: dict[str, Any] = {
        f"{service} {port}": {each["HostIp"] for each in bound}
        for service in stack.services
        for port, bound in stack.inspect(service)["NetworkSettings"]["Ports"].items()
        if bound
    }
    assert published == {f"{cloud} 8080/tcp": {"127.0.0.1"} for cloud in CLOUDS}


@pytest.mark.parametrize("cloud", CLOUDS)
def test_cloud_is_no_administrator_of_a_server(stack: Stack, cloud: str) -> None:
    said = stack.execute(cloud, "python", "-c", SIGN_IN).splitlines()
    assert said == [
        *(f"eskin {port} off" for port in (5432, 5433, 5434)),
        *(f"postgres {port} refused" for port in (5432, 5433, 5434)),
    ]


@pytest.mark.parametrize("server", SERVERS)
def test_server_has_no_network_and_keeps_what_it_acknowledged(stack: Stack, server: str) -> None:
    assert stack.inspect(server)["HostConfig"]["NetworkMode"] == "none"
    durable = "select current_setting('fsync'), current_setting('synchronous_commit')"
    assert stack.execute(server, *PSQL, "-d", "eskin", "-c", durable) == "on|on"
    keys = stack.execute(server, "find", "/var/lib/eskin", "-name", "*.key", "-o", "-name", "*.crt")
    assert keys == "", "Citus made itself a certificate"


def test_image_holds_no_secret(stack: Stack, tmp_path: Path) -> None:
    saved = tmp_path / "image.tar"
    stack.docker("save", "--output", str(saved), "eskin-citus", seconds=300)
    assert list(secrets_in(saved)) == []


@pytest.mark.parametrize(("cloud", "gateway"), [("cloud", "gateway2"), ("cloud2", "gateway")])
def test_others_go_on_when_a_cloud_and_a_gateway_are_killed(
    stack: Stack, cloud: str, gateway: str
) -> None:
    others = [name for name in CLOUDS if name != cloud]
    clients = [stack.client(name) for name in others]
    stack.compose("kill", cloud, gateway)
    killed, begin = time.time_ns(), time.monotonic()
    for client in clients:
        wait_for_samples_after(stack, client, killed, seconds=SOON_S)
    assert time.monotonic() - begin < SOON_S
    stack.compose("start", cloud, gateway)
    for service in (cloud, gateway):
        stack.wait_healthy(service)
    # The gateway's spool had what it acknowledged.
    wait_until_whole(stack)
    for client in clients:
        client.close()


@pytest.mark.parametrize("server", SERVERS)
def test_server_of_the_store_that_is_killed_comes_back_and_nothing_is_lost(
    stack: Stack, server: str
) -> None:
    stack.kill(server)
    stack.wait_healthy(server)
    instant = time.time_ns()
    for cloud in CLOUDS:
        with stack.client(cloud) as client:
            wait_for_samples_after(stack, client, instant)
    wait_until_whole(stack)


def test_data_and_identities_outlive_the_containers(stack: Stack) -> None:
    with stack.client() as client:
        before = stack.channels(client)
    issued = stack.execute("ca", "cat", "ledger.jsonl").count('"kind": "node"')
    stack.compose("down", "--timeout", "20", seconds=180)
    stack.up()
    assert "as it should be" in stack.compose("logs", "--no-color", "distribute")
    for cloud in CLOUDS:
        with stack.client(cloud) as client:
            for name, channel in stack.channels(client).items():
                assert channel["first"] == before[name]["first"]
                assert parse_timestamp(channel["last"]) >= parse_timestamp(before[name]["last"])
            wait_for_samples_after(stack, client, time.time_ns())
    assert stack.execute("ca", "cat", "ledger.jsonl").count('"kind": "node"') == issued


def test_all_that_is_killed_at_once_starts_again(stack: Stack) -> None:
    before = messages(stack)
    stack.compose("kill")
    stack.compose("start", seconds=600)
    for service in stack.services:
        stack.wait_healthy(service)
    assert messages(stack) >= before
    with stack.client("cloud3") as client:
        wait_for_samples_after(stack, client, time.time_ns())
    wait_until_whole(stack)


def test_missing_source_is_one_clear_line() -> None:
    environment = {name: each for name, each in os.environ.items() if name != "CITUS_SOURCE"}
    files = ["-f", str(REPOSITORY / "docker-compose.yml"), "-f", str(CLUSTER_FILE)]
    done = subprocess.run(
        ["docker-compose", *files, "config"],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode != 0
    assert "set CITUS_SOURCE=build/citus" in done.stderr
    assert done.stderr.strip().count("\n") == 0
