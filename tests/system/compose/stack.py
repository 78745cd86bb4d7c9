"""The stack of docker-compose.yml on an engine."""

from __future__ import annotations

import json
import shutil
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import httpx

from eskin.identity import client_context
from tests.support.processes import free_port, wait_until
from tests.system.compose.engine import run

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

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
FILES: Final = (REPOSITORY / "docker-compose.yml", Path(__file__).with_name("patience.yml"))


class Stack:
    """All containers of one project.

    Args:
        environment: Of docker and docker-compose.
        folder: Takes the root certificate.
        project: Its name at the engine.
        files: What describes it; a later one adds to those before it.
        clouds: Which services are clouds, each with the variable that names its port.
        services: Those that run, and must be healthy.

    Attributes:
        services: Those that run.
    """

    def __init__(
        self,
        environment: Mapping[str, str],
        folder: Path,
        *,
        project: str = "eskin-test",
        files: Sequence[Path] = FILES,
        clouds: Mapping[str, str] = {"cloud": "ESKIN_PORT"},
        services: Sequence[str] = SERVICES,
    ) -> None:
        self._ports = {cloud: free_port() for cloud in clouds}
        named = {clouds[cloud]: str(port) for cloud, port in self._ports.items()}
        self._environment = {**environment, **named}
        self._root = folder / "root.pem"
        self.services = services
        old = shutil.which("docker-compose")
        self._compose = [*(["docker-compose"] if old else ["docker", "compose"]), "-p", project]
        for file in files:
            self._compose += ["-f", str(file)]
        self._token = ""

    @property
    def port(self) -> int:
        """Where the first cloud's dashboard is on this machine."""
        return next(iter(self._ports.values()))

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
        for service in self.services:
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

    def client(self, cloud: str = "cloud", *, signed_in: bool = True) -> httpx.Client:
        """Of a cloud's API, as people reach it."""
        self._root.write_text(self.execute("ca", "cat", "root.pem"))
        if signed_in and not self._token:
            self._token = self.execute(cloud, "eskin", "cloud", "token", "--name", "test")
        return httpx.Client(
            base_url=f"https://localhost:{self._ports[cloud]}",
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


@contextmanager
def brought_up(stack: Stack, say: Callable[[str], None]) -> Iterator[None]:
    """Build a stack and start it until all nodes are known; take it away in the end.

    Args:
        stack: What is started.
        say: Shows the progress.
    """
    healthy = False
    try:
        say("building the images ...")
        stack.build()
        say("starting the stack ...")
        stack.up()
        say("the stack is healthy")
        # On a fresh machine kernels are compiled first.
        wait_until(lambda: _knows_all(stack), "each node has reported", seconds=300)
        healthy = True
        yield
    finally:
        if not healthy:
            say(stack.logs())
        stack.compose("down", "--volumes", "--timeout", "10", seconds=120)
        say("the stack is down")


def _knows_all(stack: Stack) -> bool:
    with stack.client() as client:
        return {node["id"] for node in items(client, "/api/v1/nodes")} == set(NODES)


def items(client: httpx.Client, path: str) -> list[dict[str, Any]]:
    """The items of a list of the API.

    Raises:
        httpx.HTTPStatusError: The answer is another than 200.
    """
    answer = client.get(path)
    answer.raise_for_status()
    listed: list[dict[str, Any]] = answer.json()["items"]
    return listed
