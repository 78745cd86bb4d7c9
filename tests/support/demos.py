"""A running demo for tests: the whole stack, real processes, on free ports."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import httpx
import psutil

from tests.support.files import ask
from tests.support.processes import ESKIN, PLAIN, Running, free_port, wait_until

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


class RunningDemo(Running):
    """``eskin demo`` on a data folder of its own.

    Args:
        data: The folder; made.
        options: Of the command.
        env: More of the environment.
    """

    def __init__(
        self,
        data: Path,
        *options: str,
        env: Mapping[str, str] | None = None,
    ) -> None:
        self.data = data
        self.port = free_port()
        argv = [ESKIN, "demo", "--data", str(data), "--port", str(self.port), *options]
        more = {"COLUMNS": "200"}
        super().__init__(argv, log=data.with_suffix(".log"), env=more | dict(env or {}))

    def start(self) -> None:
        """Start it and wait until all is up."""
        before = self.log.read_text().count("eskin is running") if self.log.exists() else 0
        super().start()
        self.wait_for(
            lambda: self.output().count("eskin is running") > before, "the demo is up", seconds=200
        )

    @property
    def store(self) -> Path:
        """The cloud's database."""
        return self.data / "cloud" / "store.sqlite"

    @property
    def access(self) -> dict[str, Any]:
        """What ``access.json`` says."""
        content: dict[str, Any] = json.loads((self.data / "access.json").read_text())
        return content

    @property
    def login_url(self) -> str:
        """The latest one-time login URL."""
        found: list[str] = re.findall(r"http://\S+/login\?code=\S+", self.output())
        return found[-1]

    def client(self) -> httpx.Client:
        """An HTTP client with the token."""
        access = self.access
        return httpx.Client(
            base_url=access["url"],
            headers={"Authorization": f"Bearer {access['token']}"},
            timeout=60,
            verify=PLAIN,
        )

    def get(self, path: str, **parameters: object) -> Any:
        """The JSON answer of the REST API."""
        with self.client() as client:
            answer = client.get(f"/api/v1{path}", params={k: str(v) for k, v in parameters.items()})
            answer.raise_for_status()
            return answer.json()

    def children(self) -> dict[str, psutil.Process]:
        """Its processes: broker, cloud, gateway, and each node by name."""
        assert self.process is not None
        found = {}
        for child in psutil.Process(self.process.pid).children():
            try:
                line = child.cmdline()
            except psutil.Error:  # it is ending just now
                continue
            if "eskin.demo.broker" in line or (line and Path(line[0]).name == "mosquitto"):
                found["broker"] = child
            elif "node" in line:
                found[line[-1].split("/")[-2]] = child
            elif "eskin" in line:  # else a fork that has not become its program yet
                found[line[line.index("eskin") + 1]] = child
        return found

    def samples(self) -> dict[str, int]:
        """How many samples are stored in the clear, by node."""
        query = (
            "SELECT node, sum(samples) FROM "
            "(SELECT node, samples FROM pages UNION ALL SELECT node, samples FROM patches) "
            "GROUP BY node"
        )
        return {str(node): int(count) for node, count in ask(self.store, query)}

    def wait_for_more(self, nodes: Sequence[str], *, seconds: float = 120.0) -> None:
        """Wait until each node has stored more samples than now."""
        before = self.samples()
        wait_until(
            lambda: all(self.samples().get(node, 0) > before.get(node, 0) for node in nodes),
            f"more samples of {', '.join(nodes)}",
            seconds=seconds,
        )

    def sequences(self) -> dict[tuple[str, int], list[tuple[int, int]]]:
        """Ranges of sequence numbers that the cloud stored, by node and boot."""
        found: dict[tuple[str, int], list[tuple[int, int]]] = {}
        query = "SELECT node, boot, first, last FROM sequences ORDER BY 1, 2, 3"
        for node, boot, first, last in ask(self.store, query):
            found.setdefault((node, boot), []).append((first, last))
        return found
