"""The stack of docker-compose.yml on an engine."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import httpx

from eskin.identity import client_context
from tests.support.processes import free_port, wait_until
from tests.system.compose.engine import run

if TYPE_CHECKING:
    from collections.abc import Mapping

REPOSITORY = Path(__file__).parents[3]
NODES = ("fingertip", "forearm", "palm")
IDENTIFIED = (
    "ca",
    "broker",
    "cloud",
    "gateway",
    *(f"sensor_node_{node}" for node in NODES),
)
"""Services with a private key."""
SERVICES = ("database", *IDENTIFIED)
IMAGES = ("ca", "broker", "client", "cloud", "database", "gateway", "sensor-node")


class Stack:
    """All containers of one project.

    Args:
        environment: Of docker and docker-compose.
        folder: Takes the root certificate.
    """

    def __init__(self, environment: Mapping[str, str], folder: Path) -> None:
        self.port = free_port()
        self._environment = {**environment, "ESKIN_PORT": str(self.port)}
        self._root = folder / "root.pem"
        old = shutil.which("docker-compose")
        self._compose = [
            *(["docker-compose"] if old else ["docker", "compose"]),
            "-p",
            "eskin-test",
        ]
        for file in (REPOSITORY / "docker-compose.yml", Path(__file__).with_name("patience.yml")):
            self._compose += ["-f", str(file)]
        self._token = ""

    def compose(self, *words: str, seconds: float = 60.0, errors: bool = True) -> str:
        """Run docker-compose."""
        return run([*self._compose, *words], self._environment, seconds=seconds, errors=errors)

    def docker(self, *words: str, seconds: float = 60.0) -> str:
        """Run docker."""
        return run(["docker", *words], self._environment, seconds=seconds)

    def build(self) -> None:
        """Build all images."""
        for services in ((), ("client",)):
            self.compose("build", *services, seconds=1200)

    def up(self) -> None:
        """Start everything, and wait until all is healthy."""
        self.compose("up", "--detach", "--no-build", seconds=900)
        for service in SERVICES:
            self.wait_healthy(service)

    def execute(self, service: str, *argv: str) -> str:
        """Run a command in a service's container; gives its standard output."""
        return self.compose("exec", "-T", service, *argv, errors=False).strip()

    def inspect(self, service: str) -> dict[str, Any]:
        """What the engine knows of a service's container."""
        container = self.compose("ps", "-q", service, errors=False).strip()
        known: list[dict[str, Any]] = json.loads(self.docker("inspect", container))
        return known[0]

    def wait_healthy(self, service: str) -> None:
        """Wait until its health check passes."""
        wait_until(
            lambda: self.inspect(service)["State"].get("Health", {}).get("Status") == "healthy",
            f"{service} is healthy",
            seconds=120,
        )

    def kill(self, service: str) -> None:
        """Kill everything in a container but its first process, which ends with the rest."""
        before = self.inspect(service)["RestartCount"]
        # The shell that kills goes too, so that its end says nothing.
        self.compose("exec", "-T", "-d", service, "sh", "-c", "kill -9 -1")
        wait_until(
            lambda: self.inspect(service)["RestartCount"] > before,
            f"{service} starts again",
            seconds=60,
        )

    def client(self, *, signed_in: bool = True) -> httpx.Client:
        """Of the cloud's API, as people reach it."""
        self._root.write_text(self.execute("ca", "cat", "root.pem"))
        if signed_in and not self._token:
            self._token = self.execute("cloud", "eskin", "cloud", "token", "--name", "test")
        return httpx.Client(
            base_url=f"https://localhost:{self.port}",
            verify=client_context(self._root),
            headers={"Authorization": f"Bearer {self._token}"} if signed_in else {},
            trust_env=False,
            timeout=20.0,
        )

    def channels(self, client: httpx.Client) -> dict[str, dict[str, Any]]:
        """All channels of all nodes, by ``node/channel``."""
        return {
            f"{node}/{channel['id']}": channel
            for node in NODES
            for channel in items(client, f"/api/v1/nodes/{node}/channels")
        }

    def logs(self) -> str:
        """State of the services, and the end of their logs."""
        return self.compose("ps") + self.compose("logs", "--no-color", "--tail", "40")


def items(client: httpx.Client, path: str) -> list[dict[str, Any]]:
    """The items of a list of the API."""
    answer = client.get(path)
    assert answer.status_code == httpx.codes.OK, f"{path}: {answer.status_code} {answer.text}"
    listed: list[dict[str, Any]] = answer.json()["items"]
    return listed
