"""What each fast lane of the gateway saves: ``python -m benchmarks.gateway_lanes``.

The gateway as a process takes frames from Mosquitto (TLS, QoS 1), and forwards them to a cloud that
answers at once. Each variant replaces one part by the plain way. Variants alternate, so that a
noisy machine is noisy for all, and the ratio is that to the gateway as it is in the same round.
"""

from __future__ import annotations

import argparse
import logging
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import cbor2
import numpy as np
import orjson
import paho.mqtt.client as paho
from eskin_gateway import service
from eskin_gateway.mqtt.sealer_cache import SealerCache
from eskin_gateway.mqtt.transport import ReceivedMessage
from eskin_gateway.service import run
from eskin_gateway.settings import (
    BrokerSection,
    CloudSection,
    GatewaySettings,
    HttpSection,
    IdentitySection,
    SpoolSection,
)
from paho.mqtt.enums import CallbackAPIVersion

from benchmarks.pipeline import cpu_seconds
from eskin.identity import IdentityKind, client_context
from eskin.identity.identity import ROOT_FILE
from eskin.wire.envelope import Sealer
from eskin.wire.frames import EncodedFrame, Frame
from eskin.wire.messages import Position
from eskin.wire.topics import FROM_NODE, Stream, node_topic
from tests.support.brokers import Mosquitto
from tests.support.identities import Identities
from tests.support.processes import Running, wait_until
from tests.unit.gateway.messages import status
from tests.unit.gateway.skins import SkinOf, patch
from tests.unit.gateway.stub_cloud import StubCloud

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from eskin_gateway.mqtt.receive_queue import ReceiveQueue
    from eskin_gateway.mqtt.transport import Publication


class PlainTransport:
    """paho's own thread, socket and packets.

    Args:
        settings: Address.
        name: Client id.
        context: Shows the gateway's certificate.
        receive_queue: Takes what arrives.
    """

    def __init__(
        self,
        settings: BrokerSection,
        *,
        name: str,
        context: Any,
        receive_queue: ReceiveQueue,
        **_: Any,
    ) -> None:
        self._settings = settings
        self._receive_queue = receive_queue
        self.connected, self.fault, self.dropped, self.connection = False, None, 0, 1
        self._client = paho.Client(CallbackAPIVersion.VERSION2, client_id=name, manual_ack=True)
        self._client.tls_set_context(context)
        self._client.on_connect = self._on_connect
        self._client.on_subscribe = self._on_subscribe
        self._client.on_message = self._on_message

    def start(self) -> None:
        """Connect, and read in a thread."""
        self._client.connect(self._settings.host, self._settings.port)
        self._client.loop_start()

    def pause(self) -> None:
        """Do nothing: a benchmark stops with nothing on its way."""

    def stop(self) -> None:
        """Disconnect."""
        self._client.disconnect()
        self._client.loop_stop()

    def acknowledge(self, received_messages: Sequence[ReceivedMessage]) -> None:
        """Send a PUBACK for each message."""
        for message in received_messages:
            self._client.ack(message.mid, message.qos)

    def publish(self, publications: Iterable[Publication]) -> None:
        """Publish each at QoS 0."""
        for topic, payload, retain in publications:
            self._client.publish(topic, payload, retain=retain)

    def _on_connect(self, client: paho.Client, *_: Any) -> None:
        client.subscribe([(node_topic("+", stream), 1) for stream in FROM_NODE])

    def _on_subscribe(self, *_: Any) -> None:
        self.connected = True
        logging.getLogger(__name__).info("broker connected")

    def _on_message(self, _client: paho.Client, _data: object, each: paho.MQTTMessage) -> None:
        self._receive_queue.put(
            [ReceivedMessage(each.topic, bytes(each.payload), each.mid, each.qos, each.retain, 1)]
        )


def _plain_transport() -> None:
    vars(service)["MqttTransport"] = PlainTransport


def _no_sealer_cache() -> None:
    def seal(self: SealerCache, plaintext: bytes, *, topic: str, to: Any, thumbprint: bytes) -> Any:
        return Sealer(self._find_site(thumbprint), to).seal(plaintext, topic=topic)

    SealerCache.seal = seal  # type: ignore[method-assign]


def _whole_frames() -> None:
    summary = EncodedFrame.decode

    def decode(data: bytes) -> EncodedFrame:
        Frame.decode(data)
        return summary(data)

    EncodedFrame.decode = staticmethod(decode)  # type: ignore[method-assign]


_VARIANTS: Final = {
    "as it is": lambda: None,
    "paho's thread, socket and packets": _plain_transport,
    "no cache of sealers": _no_sealer_cache,
    "frames decoded besides": _whole_frames,
}


class Load(NamedTuple):
    """What nodes send.

    Attributes:
        name: For people.
        nodes: How many.
        rate: Frames a second of each.
        skin: Of each.
    """

    name: str
    nodes: int
    rate: float
    skin: SkinOf


_LOADS: Final = {
    "fleet": Load("500 nodes, 2 frames of 5 channels a second each", 500, 2.0,
                  SkinOf(patch(0, 3), patch(1, 2))),
    "skins": Load("20 nodes, 20 frames of 83 channels a second each", 20, 20.0,
                  SkinOf(patch(0, 50), patch(1, 33))),
}  # fmt: skip


class FastCloud(StubCloud):
    """Takes everything at once.

    Attributes:
        taken: How many messages.
    """

    taken = 0

    def _answer(self, body: bytes) -> tuple[int, bytes]:
        count = len(cbor2.loads(body))
        self.taken += count
        return 200, orjson.dumps({"items": [{"result": "stored", "reason": None}] * count})


class Site:
    """Broker, cloud and the messages of all nodes."""

    def __init__(self, folder: Path, load: Load, seconds: float) -> None:
        self._folder, self._load = folder, load
        self._identities = Identities(folder / "identities")
        self.broker = Mosquitto(folder / "broker", self._identities)
        # One connection sends for all nodes.
        file = folder / "broker" / "mosquitto.conf"
        lines = file.read_text().splitlines()
        allowed = folder / "acl"
        allowed.write_text("pattern readwrite #\n")
        is_nodes = [line.startswith("acl_file") and line.endswith("/nodes") for line in lines]
        changed = (f"acl_file {allowed}" if own else line for own, line in zip(is_nodes, lines))  # noqa: B905
        file.write_text("\n".join(changed) + "\n")
        self.cloud = FastCloud(self._identities.make(IdentityKind.SERVER, "server.cloud"))
        self._introductions: list[tuple[str, bytes]] = []
        self._frames: list[tuple[str, bytes]] = []
        self._seal(max(1, round(load.rate * seconds)))

    def _seal(self, each: int) -> None:
        random = np.random.default_rng(1)
        skin, site = self._load.skin, self._identities.site.certificate
        frames = []
        for sequence in range(1, each + 1):
            values = {
                k: 1000 + random.normal(0, 10, (5, len(one.taxels)))
                for k, one in enumerate(skin.patches)
            }
            frames.append(skin.frame(sequence, values).encode())
        by_node = []
        for number in range(self._load.nodes):
            name = f"n{number}"
            sealer = Sealer(self._identities.make(IdentityKind.NODE, name), site)
            topics = {stream: node_topic(name, stream) for stream in FROM_NODE}
            topic = topics[Stream.STATUS]
            introduction = sealer.seal(status(0).encode(), topic=topic, introduce=True)
            self._introductions.append((topic, introduction))
            topic = topics[Stream.LAYOUTS]
            self._introductions += [
                (topic, sealer.seal(one, topic=topic)) for one in skin.descriptions
            ]
            topic = topics[Stream.FRAMES]
            by_node.append(
                [
                    (topic, sealer.seal(one, topic=topic, held=Position(1, number)))
                    for number, one in enumerate(frames, start=1)
                ]
            )
        self._frames = [one for row in zip(*by_node, strict=True) for one in row]

    def measure(self, variant: str, number: int) -> float:
        """µs of CPU a frame."""
        folder = self._folder / f"gateway-{number}"
        folder.mkdir()
        argv = [sys.executable, "-m", "benchmarks.gateway_lanes", "--serve", variant]
        argv += [str(self._identities.gateway.directory), str(self._identities.site.directory)]
        argv += [str(self.broker.gateway_port), self.cloud.url, str(folder)]
        node = self._identities.node
        client = paho.Client(CallbackAPIVersion.VERSION2, client_id=f"all-{number}")
        client.tls_set_context(client_context(node.directory / ROOT_FILE, node))
        client.max_inflight_messages_set(500)
        self.cloud.taken = 0
        with Running(argv, log=folder / "log") as running:
            running.wait_for(lambda: "broker connected" in running.output(), "it is connected")
            client.connect("127.0.0.1", self.broker.node_port)
            client.loop_start()
            self._send(client, self._introductions, 400.0)
            wait_until(lambda: self.cloud.taken >= self._load.nodes, "all are known", seconds=120)
            time.sleep(1.0)
            used = cpu_seconds(running)
            self._send(client, self._frames, self._load.nodes * self._load.rate)
            whole = self._load.nodes + len(self._frames)
            wait_until(lambda: self.cloud.taken >= whole, "all are stored", seconds=120)
            spent = cpu_seconds(running) - used
            client.disconnect()
            client.loop_stop()
        return spent / len(self._frames) * 1e6

    @staticmethod
    def _send(client: paho.Client, messages: Sequence[tuple[str, bytes]], rate: float) -> None:
        begun = time.monotonic()
        for number, (topic, envelope) in enumerate(messages):
            time.sleep(max(0.0, begun + number / rate - time.monotonic()))
            client.publish(topic, envelope, qos=1)


def serve(variant: str, gateway: str, site: str, port: str, url: str, folder: str) -> None:
    """Run a gateway with a part replaced."""
    logging.basicConfig(level="INFO")
    logging.getLogger("httpx").setLevel("WARNING")
    _VARIANTS[variant]()
    run(
        GatewaySettings(
            broker=BrokerSection(host="127.0.0.1", port=int(port)),
            identity=IdentitySection(directory=Path(gateway), site=Path(site)),
            cloud=CloudSection(url=url),
            spool=SpoolSection(path=Path(folder) / "spool.db"),
            http=HttpSection(port=0),
        )
    )


def measure(load: Load, *, rounds: int, seconds: float, variants: Sequence[str]) -> None:
    """Measure, and print medians."""
    print(load.name)
    with tempfile.TemporaryDirectory(prefix="eskin-lanes-") as folder:
        site = Site(Path(folder), load, seconds)
        with site.broker, site.cloud:
            found = [
                [site.measure(each, len(variants) * number + k) for k, each in enumerate(variants)]
                for number in range(rounds)
            ]
    for name, used in zip(variants, zip(*found, strict=True), strict=True):
        ratios = [one / row[0] for one, row in zip(used, found, strict=True)]
        spread = " ".join(f"{each:.2f}" for each in ratios)
        print(f"  {name}: {median(used):.0f} us a frame, {median(ratios):.2f} times ({spread})")


def main() -> None:
    """Measure all variants with a load, or serve one."""
    if sys.argv[1:2] == ["--serve"]:
        serve(*sys.argv[2:])
        return
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gateway_lanes", description=__doc__)
    parser.add_argument("--load", choices=_LOADS, default="fleet")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--variant", action="append", choices=_VARIANTS)
    options = parser.parse_args()
    variants = ["as it is", *(options.variant or list(_VARIANTS)[1:])]
    measure(_LOADS[options.load], rounds=options.rounds, seconds=options.seconds, variants=variants)


if __name__ == "__main__":
    main()
