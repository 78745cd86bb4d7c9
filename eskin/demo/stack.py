"""The demo's processes, in the order in which they start; they end in the reverse order."""

from __future__ import annotations

import ssl
import sys
import time
from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING, Final

import httpx

from eskin.demo.mosquitto import Mosquitto
from eskin.demo.ports import LOOPBACK, accepts
from eskin.demo.settings_files import (
    Ports,
    broker_identity,
    node_environment,
    write_cloud,
    write_gateway,
    write_node,
)
from eskin.demo.supervised_process import SupervisedProcess, SupervisedProcessError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from eskin.demo.layout import DemoFolder

_PATIENCE_S: Final = 600.0
_POLL_S: Final = 0.05
_DRAIN_S: Final = 10.0


@dataclass(frozen=True, slots=True)
class Stage:
    """One step of the start: what runs, and how to see that it is up."""

    title: str
    children: Sequence[SupervisedProcess]
    ready: Callable[[], bool]


class Stack:
    """All processes of one demo.

    Args:
        layout: Its folder.
        ports: Where they listen.
        nodes: The nodes' profiles by their names.
        speed: Emulated seconds per second; ``None`` leaves it to each node's file.
        revoked: Names that are not let in.
        mosquitto: Program of the broker; ``None`` for the embedded one.
    """

    def __init__(
        self,
        layout: DemoFolder,
        ports: Ports,
        nodes: Mapping[str, str],
        *,
        speed: float | None,
        revoked: Sequence[str],
        mosquitto: Path | None,
    ) -> None:
        self._layout = layout
        self._ports = ports
        self._expected = set(nodes) - set(revoked)
        self._token = ""
        # Loopback needs no roots, and to read those of the web takes 20 ms in each look.
        self._http = httpx.Client(
            timeout=2.0, trust_env=False, verify=ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        )
        eskin = [sys.executable, "-m", "eskin"]
        self.broker: SupervisedProcess = (
            self._child(
                "broker",
                [
                    *(sys.executable, "-m", "eskin.demo.broker"),
                    *(broker_identity(layout), layout.authority, ports.broker.nodes),
                ],
            )
            if mosquitto is None
            else Mosquitto(mosquitto, layout=layout, ports=ports)
        )
        self.cloud = self._child("cloud", [*eskin, "cloud", "--config", write_cloud(layout, ports)])
        self.gateway = self._child(
            "gateway", [*eskin, "gateway", "--config", write_gateway(layout, ports)]
        )
        self.nodes = [
            self._child(
                name,
                [*eskin, "node", "--config", write_node(layout, name, profile)],
                node_environment(ports, speed),
            )
            for name, profile in nodes.items()
        ]

    def stages(self, token: str) -> list[Stage]:
        """The steps of the start.

        Args:
            token: Reads the cloud's API, to see when data arrives.
        """
        self._token = token
        return [
            Stage("broker", [self.broker], self._broker_listens),
            Stage("cloud", [self.cloud], self._cloud_is_ready),
            Stage("gateway", [self.gateway], self._gateway_is_healthy),
            Stage(f"{len(self.nodes)} sensor nodes", self.nodes, self._nodes_report),
        ]

    @property
    def children(self) -> list[SupervisedProcess]:
        """All processes, in the order of their start."""
        return [self.broker, self.cloud, self.gateway, *self.nodes]

    def start(self, stage: Stage) -> None:
        """Start a stage and wait until it is up.

        Raises:
            ChildError: A process died, or the stage is not up after ten minutes.
        """
        for child in stage.children:
            child.start()
        deadline = time.monotonic() + _PATIENCE_S
        while not stage.ready():
            for child in stage.children:
                child.require_alive()
            if time.monotonic() > deadline:
                raise SupervisedProcessError(
                    f"{stage.title} not up after {_PATIENCE_S:g} s; see {self._layout.logs}"
                )
            time.sleep(_POLL_S)

    def keep_alive(self) -> None:
        """Start again whatever died."""
        for child in self.children:
            child.keep_alive()

    def stop(self) -> None:
        """End the nodes, let the gateway empty its spool, then end the rest in order."""
        for node in self.nodes:
            node.terminate()
        for node in self.nodes:
            node.stop()
        self._drain()
        self._http.close()
        for child in (self.gateway, self.cloud, self.broker):
            child.stop()

    def _drain(self) -> None:
        deadline = time.monotonic() + _DRAIN_S
        while self.gateway.pid and self.cloud.pid and time.monotonic() < deadline:
            answer = self._ask(f"http://{LOOPBACK}:{self._ports.gateway}/healthz")
            if answer is None or answer.json().get("spool", {}).get("messages") == 0:
                return
            time.sleep(_POLL_S)

    def _child(
        self, name: str, argv: Sequence[object], environment: dict[str, str] | None = None
    ) -> SupervisedProcess:
        return SupervisedProcess(
            name,
            [str(part) for part in argv],
            log_file=self._layout.logs / f"{name}.log",
            environment=environment,
        )

    def _broker_listens(self) -> bool:
        return all(accepts(port) for port in set(astuple(self._ports.broker)))

    def _cloud_is_ready(self) -> bool:
        return self._is_ok(f"http://{LOOPBACK}:{self._ports.people}/readyz")

    def _gateway_is_healthy(self) -> bool:
        return self._is_ok(f"http://{LOOPBACK}:{self._ports.gateway}/healthz")

    def _nodes_report(self) -> bool:
        answer = self._ask(f"http://{LOOPBACK}:{self._ports.people}/api/v1/nodes")
        if answer is None or not answer.is_success:
            return False
        online = {item["id"] for item in answer.json()["items"] if item["health"] == "online"}
        return online.issuperset(self._expected)

    def _is_ok(self, url: str) -> bool:
        answer = self._ask(url)
        return answer is not None and answer.is_success

    def _ask(self, url: str) -> httpx.Response | None:
        try:
            return self._http.get(url, headers={"Authorization": f"Bearer {self._token}"})
        except httpx.TransportError:
            return None
