"""The gateway's peers that bring messages to a second broker: their CPU and their rate.

Mosquitto's own bridge, and thingsboard-gateway with its defaults (storage in memory) and with its
SQLite storage, for which the second broker stands in for ThingsBoard. All read from the site's
broker and write to the second, over TLS at QoS 1. None opens, checks or acknowledges anything to a
node.
"""

from __future__ import annotations

import json
import signal
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple, Self

import paho.mqtt.client as mqtt
from paho.mqtt.enums import CallbackAPIVersion

from benchmarks.pipeline import cpu_seconds
from benchmarks.relay import NAME
from benchmarks.said import FEW
from eskin.identity import Identity, IdentityKind, client_context
from eskin.identity.identity import CHAIN_FILE, KEY_FILE, ROOT_FILE
from eskin.wire.topics import Stream, node_topic
from tests.support.brokers import mosquitto
from tests.support.processes import Running, accepts, free_port, wait_until

if TYPE_CHECKING:
    from collections.abc import Mapping
    from types import TracebackType

    from benchmarks.flood import Flood
    from tests.support.stacks import RealStack

THINGSBOARD: Final = Path(sys.prefix) / "thingsboard" / "bin" / "thingsboard-gateway"
_MEMORY: Final = {"type": "memory", "read_records_count": 100, "max_records_count": 100_000}
_SQLITE: Final = {
    "type": "sqlite",
    "data_file_path": "./data/",
    "messages_ttl_check_in_hours": 1,
    "messages_ttl_in_days": 7,
    "max_read_records_count": 1000,
    "writing_batch_size": 1000,
    "size_limit": 1024,
    "max_db_amount": 10,
    "oversize_check_period": 1,
}
"""As its own configuration has it; WAL, synchronous = NORMAL: a power cut takes the last."""


class FarPeer(NamedTuple):
    """One that brings messages to a second broker.

    Attributes:
        storage: Of thingsboard-gateway; ``None`` for a bridge.
        rows: Rows of samples that a message states as values, as a frame has them; 0: it has one
            text of the size of a frame, which nothing reads.
    """

    storage: Mapping[str, object] | None
    rows: int = 0


FAR_PEERS: Final = {
    "Mosquitto bridge": FarPeer(None),
    "thingsboard-gateway (memory)": FarPeer(_MEMORY),
    "thingsboard-gateway (SQLite)": FarPeer(_SQLITE),
    "thingsboard-gateway (memory), samples as values": FarPeer(_MEMORY, FEW.rows),
}
"""By name."""
_COUNTER: Final = "gateway.counter"
_KEY: Final = "samples"
_ASKED: Final = "v1/devices/me/rpc/request/"
_LIMITS: Final = json.dumps(
    {
        "rateLimits": {},
        "gatewayRateLimits": {},
        "maxInflightMessages": 10_000,
        "maxPayloadSize": 2**17,
    }
)
_QUIET_S: Final = 1.5
_GIVEN_UP_S: Final = 5.0
_SITE_TOPIC: Final = node_topic("+", Stream.FRAMES)

_UPSTREAM: Final = """user root
max_inflight_messages 1000
max_queued_messages 0
log_type error
log_dest stderr
listener {port} 127.0.0.1
cafile {anchor}
certfile {server}/chain.pem
keyfile {server}/key.pem
require_certificate true
use_identity_as_username true
"""
_BRIDGE: Final = """user root
max_inflight_messages 1000
max_queued_messages 0
log_type error
log_dest stderr
listener {own} 127.0.0.1
allow_anonymous false
connection site
local_clientid site
address 127.0.0.1:{site}
topic {topic} in 1
{identity}
connection far
local_clientid far
address 127.0.0.1:{far}
topic {topic} out 1
{identity}
"""
_BRIDGED_BY: Final = """remote_clientid {name}
bridge_cafile {folder}/root.pem
bridge_certfile {folder}/chain.pem
bridge_keyfile {folder}/key.pem
cleansession true
notifications false
try_private false"""


class Relayed(NamedTuple):
    """CPU µs a message that came, messages a second, and how many never came."""

    cpu: float
    rate: float
    lost: float


class Upstream(Running):
    """The second broker, and a subscriber that counts what comes to it."""

    def __init__(self, stack: RealStack) -> None:
        folder = stack.folder / "upstream"
        folder.mkdir()
        self.port = free_port()
        server = stack.pki / "server.broker"
        anchor = stack.identities.authority.anchor_file(IdentityKind.GATEWAY)
        file = folder / "mosquitto.conf"
        file.write_text(_UPSTREAM.format(port=self.port, anchor=anchor, server=server))
        super().__init__([str(mosquitto()), "-c", str(file)], log=folder / "mosquitto.log")
        self._identity = stack.identities.make(IdentityKind.GATEWAY, _COUNTER)
        self.count = 0
        self.heard = 0.0
        self._subscribed = threading.Event()
        self._client = mqtt.Client(CallbackAPIVersion.VERSION2, client_id=_COUNTER)

    def __enter__(self) -> Self:
        self.start()
        self.wait_for(lambda: accepts(self.port), "the second broker listens")
        own = self._identity
        self._client.tls_set_context(client_context(own.directory / ROOT_FILE, own))
        self._client.on_message = self._on_message
        self._client.on_subscribe = lambda *_: self._subscribed.set()
        self._client.connect("127.0.0.1", self.port)
        self._client.subscribe("#", qos=1)
        self._client.loop_start()
        assert self._subscribed.wait(60)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._client.disconnect()
        self._client.loop_stop()
        super().__exit__(kind, error, trace)

    def done(self, before: int, messages: int) -> bool:
        """Whether all came, or nothing comes any more: thingsboard-gateway loses some."""
        came = self.count - before
        return came >= messages or (came > 0 and time.monotonic() > self.heard + _GIVEN_UP_S)

    def _on_message(self, client: mqtt.Client, _data: object, message: mqtt.MQTTMessage) -> None:
        if message.topic.startswith(_ASKED):
            # thingsboard-gateway sends nothing before it knows its limits: it has none.
            client.publish(message.topic.replace("/request/", "/response/"), _LIMITS, qos=1)
            return
        self.count += message.payload.count(f'"{_KEY}"'.encode())
        self.heard = time.monotonic()


def measure_far(
    stack: RealStack, flood: Flood, upstream: Upstream, peer: str, messages: int
) -> Relayed:
    """What one of `FAR_PEERS` costs, and how fast it is."""
    storage, rows = FAR_PEERS[peer]
    if storage is None:
        made = _bridge(stack, upstream)
    else:
        made = _thingsboard(stack, upstream, storage, values=rows > 0)
    with made as running:
        _await_flow(running, flood, upstream, rows)
        before, used = upstream.count, cpu_seconds(running)
        running.signal(signal.SIGSTOP)
        try:
            flood.fill([_message(number, rows) for number in range(messages)])
            begun = time.monotonic()
        finally:
            running.signal(signal.SIGCONT)
        keys = messages * max(1, rows)
        running.wait_for(lambda: upstream.done(before, keys), "all relayed", seconds=300)
        spent, came = cpu_seconds(running) - used, (upstream.count - before) / max(1, rows)
        return Relayed(spent / came * 1e6, came / (upstream.heard - begun), messages - came)


def _message(number: int, rows: int) -> bytes:
    """1.1 kB, or rows; of one key and one millisecond thingsboard-gateway keeps one value only."""
    first = 1_700_000_000_000 + number * max(1, rows)
    if rows == 0:
        return json.dumps({"ts": first, _KEY: "5a" * 550}).encode()
    (columns,) = FEW.columns
    # Both bounds of each channel, with as many digits as they are worth.
    names = [_KEY, *(f"c{k}" for k in range(1, 2 * columns))]
    stated = [
        {"ts": first + row, "values": {name: 1000.0 + row % 64 + k for k, name in enumerate(names)}}
        for row in range(rows)
    ]
    return json.dumps(stated).encode()


def _await_flow(running: Running, flood: Flood, upstream: Upstream, rows: int) -> None:
    """Send until one comes through, and wait until no more come."""

    def through() -> bool:
        before = upstream.count
        flood.fill([_message(-1, rows)])
        deadline = time.monotonic() + 1.0
        while upstream.count == before and time.monotonic() < deadline:
            time.sleep(0.05)
        return upstream.count > before

    running.wait_for(through, f"{running.argv[0]} relays", seconds=120)
    wait_until(lambda: time.monotonic() > upstream.heard + _QUIET_S, "nothing more comes")


def _bridge(stack: RealStack, upstream: Upstream) -> Running:
    folder = _folder(stack, "bridge")
    identity = _BRIDGED_BY.format(name=NAME, folder=stack.pki / NAME)
    file = folder / "mosquitto.conf"
    file.write_text(
        _BRIDGE.format(
            own=free_port(),
            site=stack.broker.gateway_port,
            far=upstream.port,
            topic=_SITE_TOPIC,
            identity=identity,
        )
    )
    return Running([str(mosquitto()), "-c", str(file)], log=folder / "mosquitto.log")


def _thingsboard(
    stack: RealStack, upstream: Upstream, storage: Mapping[str, object], *, values: bool
) -> Running:
    """Start thingsboard-gateway; rows of values pass its converter in the cheapest way it has."""
    text = {"type": "string", "key": _KEY, "value": f"${{{_KEY}}}"}
    folder = _folder(stack, "thingsboard")
    own = Identity.load(stack.pki / NAME).directory
    root, key, chain = (str(own / file) for file in (ROOT_FILE, KEY_FILE, CHAIN_FILE))
    _write(folder / "tb_gateway.json", {
        "thingsboard": {
            "host": "127.0.0.1",
            "port": upstream.port,
            "remoteShell": False,
            "remoteConfiguration": False,
            "statistics": {"enable": False},
            "security": {"caCert": root, "privateKey": key, "cert": chain},
            "qos": 1,
        },
        "storage": storage,
        "grpc": {"enabled": False},
        "connectors": [{"type": "mqtt", "name": "site", "configuration": "mqtt.json"}],
    })  # fmt: skip
    security = {"pathToCACert": root, "pathToPrivateKey": key, "pathToClientCert": chain}
    _write(folder / "mqtt.json", {
        "broker": {
            "host": "127.0.0.1",
            "port": stack.broker.gateway_port,
            "clientId": NAME,
            "version": 5,
            "maxMessageNumberPerWorker": 10,
            "maxNumberOfWorkers": 100,
            "security": {"type": "certificates", **security},
        },
        "mapping": [{
            "topicFilter": _SITE_TOPIC,
            "subscriptionQos": 1,
            "converter": {
                "type": "json",
                "deviceInfo": {
                    "deviceNameExpressionSource": "constant",
                    "deviceNameExpression": "fingertip",
                    "deviceProfileExpressionSource": "constant",
                    "deviceProfileExpression": "default",
                },
                "timeseries": ["*" if values else text],
            },
        }],
    })  # fmt: skip
    log = folder / "thingsboard-gateway.log"
    # It writes logs of its own to where it runs.
    argv = ["env", f"--chdir={folder}", str(THINGSBOARD)]
    return Running(argv, log=log, env={"TB_GW_CONFIG_DIR": str(folder)})


def _folder(stack: RealStack, peer: str) -> Path:
    folder = stack.folder / f"{peer}-{time.time_ns()}"
    folder.mkdir()
    return folder


def _write(file: Path, content: object) -> None:
    file.write_text(json.dumps(content, indent=2))
