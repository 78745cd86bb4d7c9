"""A broker, a gateway, a cloud and nodes that obey: all real but for what the nodes measure."""

from __future__ import annotations

import time
from datetime import timedelta
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from eskin_cloud.access import Scope, create_token
from eskin_cloud.store import Store
from eskin_gateway.service import Gateway
from eskin_gateway.settings import (
    BrokerSection,
    CloudSection,
    CommandsSection,
    GatewaySettings,
    HttpSection,
    SpoolSection,
)
from eskin_gateway.settings import IdentitySection as GatewayIdentity
from eskin_sensor_node.link.publisher import Publisher
from eskin_sensor_node.machine.radio import Radio
from eskin_sensor_node.node.commands import CommandReceiver
from eskin_sensor_node.node.factory import build_outbox
from eskin_sensor_node.settings import BrokerSection as NodeBroker
from eskin_sensor_node.settings import IdentitySection as NodeIdentity
from eskin_sensor_node.settings import RadioSection

from eskin.identity import Identity, IdentityKind
from eskin.identity.certificates import pem
from tests.support.brokers import Mosquitto
from tests.support.processes import accepts, wait_until
from tests.unit.cloud.service import Service
from tests.unit.sensor_node.controls import SimpleControls
from tests.unit.sensor_node.designs import settings as node_settings
from tests.unit.sensor_node.flashes import open_flash
from tests.unit.sensor_node.stores import DESCRIBED
from tests.unit.sensor_node.traffic import Traffic

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_sensor_node.settings import NodeSettings

    from tests.support.identities import Identities


class ObedientNode:
    """Flash, commander and publisher of a node, with simple controls."""

    def __init__(self, folder: Path, identity: Identity, site: Identity, port: int) -> None:
        self._folder = folder
        self._identity = identity
        self._site = folder / f"{identity.name}-site.pem"
        self._site.write_bytes(pem([site.certificate]))
        self._port = port
        self.controls = SimpleControls()

    def __enter__(self) -> Self:
        broker = NodeBroker(port=self._port, resend_s=0.5, drain_s=5.0)
        self.flash = open_flash(
            self._folder / f"{self._identity.name}.sqlite", epoch=None, node=self._identity.name
        )
        self.outbox = build_outbox(self.flash, capacity=10**6, broker=broker, described=DESCRIBED)
        self.controls = SimpleControls()
        commander = CommandReceiver(
            self.outbox,
            own=self._identity,
            cloud="server.cloud",
            controls=self.controls,
            enclosure=lambda: (time.time_ns() - 10**6, time.time_ns() + 10**6),
        )
        commander.start()
        self._publisher = Publisher(
            self.outbox,
            record_status=self._record_status,
            take_command=commander.take,
            radio=Radio(
                RadioSection(),
                now=time.monotonic_ns,
                random=np.random.default_rng(1),
                meter=Traffic(),
            ),
            broker=broker,
            identity=NodeIdentity(directory=self._identity.directory, site=self._site),
        )
        self._publisher.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._publisher.stop()
        self.flash.close()

    def _record_status(self) -> None:
        now = time.time_ns()
        with self.outbox.batch() as batch:
            usage = self.outbox.usage()
            batch.take([self.outbox.message_writer.status((now, now), "p", "d", 1, usage, 1)])


class Chain:
    """Broker, gateway and cloud, running; and an operator's client."""

    def __init__(self, folder: Path, identities: Identities) -> None:
        self._folder = folder
        self._identities = identities
        self.broker = Mosquitto(folder / "broker", identities)
        self.cloud = Service(folder, identities)
        self.settings = GatewaySettings(
            broker=BrokerSection(host="127.0.0.1", port=self.broker.gateway_port),
            identity=GatewayIdentity(
                directory=identities.gateway.directory, site=identities.site.directory
            ),
            cloud=CloudSection(
                url=f"https://127.0.0.1:{self.cloud.ingest_port}/api/v1/ingest",
                retry_s=0.05,
                retry_max_s=0.2,
            ),
            commands=CommandsSection(resend_s=0.5),
            spool=SpoolSection(path=folder / "spool.db"),
            http=HttpSection(port=0),
        )

    def __enter__(self) -> Self:
        self.broker.begin()
        self.cloud.start()
        with Store(self.cloud.place) as store:
            token = create_token(
                store,
                scopes=[Scope.READ, Scope.OPERATE],
                name="operator",
                lifetime=timedelta(hours=1),
            )
        self.client = self.cloud.people(token)
        self.start_gateway()
        return self

    def __exit__(self, *_: object) -> None:
        self.gateway.stop()
        self.client.close()
        self.cloud.stop()
        self.broker.stop()

    def start_gateway(self) -> None:
        """A gateway that remembers what its spool holds, and nothing else."""
        self.gateway = Gateway(self.settings)
        self.published: list[tuple[str, bytes]] = []
        publish = self.gateway.broker.publish

        def watching(publications: Any) -> None:
            listed = list(publications)
            self.published += [(topic, payload) for topic, payload, _ in listed]
            publish(listed)

        self.gateway.broker.publish = watching  # type: ignore[method-assign]  # what a broker sees
        self.gateway.start()
        wait_until(lambda: self.gateway.broker.connected, "the gateway is connected")

    def restart_cloud(self) -> None:
        """End the cloud, and start it on the same ports."""
        self.cloud.stop()
        self.cloud.start()
        wait_until(lambda: accepts(self.cloud.port), "the cloud is back")

    def node(self, name: str = "fingertip") -> ObedientNode:
        """A node; its flash outlasts it."""
        known = self._identities.node
        own = known if name == known.name else self._identities.make(IdentityKind.NODE, name)
        return ObedientNode(self._folder, own, self._identities.site, self.broker.node_port)

    def emulated_node(self, name: str, **sections: Any) -> NodeSettings:
        """Settings of a whole node, with an identity of its own."""
        own = self._identities.make(IdentityKind.NODE, name)
        site = self._folder / f"{name}-site.pem"
        site.write_bytes(pem([self._identities.site.certificate]))
        folder = self._folder / name
        folder.mkdir()
        return node_settings(
            folder,
            node={"name": name},
            identity={"directory": own.directory, "site": site},
            broker={"port": self.broker.node_port},
            **sections,
        )

    def ask(self, name: str, *, node: str = "fingertip", expires: float = 600, **what: Any) -> int:
        """Give a command."""
        body = {"name": name, "arguments": what, "expires_s": expires}
        answer = self.client.post(f"/api/v1/nodes/{node}/commands", json=body)
        assert answer.status_code == 202, answer.text
        number: int = answer.json()["id"]
        return number

    def stated(self, number: int, *, node: str = "fingertip") -> Any:
        """What became of a command."""
        return self.client.get(f"/api/v1/nodes/{node}/commands/{number}").json()

    def wait_for(self, number: int, state: str, *, node: str = "fingertip") -> None:
        """Wait until a command is done, refused, …."""
        wait_until(lambda: self.stated(number, node=node)["state"] == state, f"{number} is {state}")

    def wait_for_node(self, node: str = "fingertip") -> None:
        """Wait until the cloud has heard how a node is set."""
        path = f"/api/v1/nodes/{node}/state"
        wait_until(lambda: self.client.get(path).json().get("reported") is not None, "it reports")
