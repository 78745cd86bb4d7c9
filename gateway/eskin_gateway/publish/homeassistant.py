"""Announces channels to Home Assistant by MQTT discovery: one retained topic for each.

Source: home-assistant.io/integrations/mqtt (discovery) and /integrations/sensor.mqtt.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import orjson

from eskin.privacy import is_biometric
from eskin.wire.messages.block_header import MOST_SAMPLES
from eskin.wire.timestamp import SECOND
from eskin.wire.topics import live_topic
from eskin_gateway.publish.presence import latest_statuses

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from eskin.wire.messages import ChannelInfo, Status
    from eskin_gateway.mqtt.transport import Publication
    from eskin_gateway.spool.node_certificates import NodeCertificates
    from eskin_gateway.spool.spool import Spool

_CHECKED_AT_ONCE: Final = 64
"""Nodes whose certificates are checked in one periodic run."""
_DEVICE_CLASSES: Final = {
    "A": ("current", "A"),
    "V": ("voltage", "V"),
    "Hz": ("frequency", "Hz"),
    "Pa": ("pressure", "Pa"),
    "m": ("distance", "m"),
    "Cel": ("temperature", "°C"),
    "%": ("humidity", "%"),
}
"""UCUM code: Home Assistant's device class and its unit. It has no class for F, H and J."""
_UNITS: Final = {"m2": "m²", "1": None}
_SLACK_S: Final = 60
_LATE: Final = f"{{% set late = as_timestamp(now()) - as_timestamp(value_json.t1) > {_SLACK_S} %}}"
"""Whether a block was delayed: Home Assistant would show it as the present state."""
_STATE: Final = (
    _LATE + "{% set lo, hi = value_json.lo, value_json.hi %}"
    "{{ none if late or lo is none or hi is none else lo + (hi - lo) / 2 }}"
)
"""The midpoint, which Home Assistant draws. The attributes ``lo`` and ``hi`` are the interval."""
_ATTRIBUTES: Final = _LATE + "{{ ({} if late else value_json) | tojson }}"
_ONLINE: Final = "{{ 'online' if value_json.online else 'offline' }}"


class Discovery:
    """Announces the public channels of each node until the node expires. Not thread-safe.

    A node expires when its certificate is revoked or expired, or after ``expire_ns`` without a
    status. Its next status announces it again.

    Args:
        prefix: Home Assistant's discovery topic.
        expire_ns: Age in ns of a node's latest status at which it expires.
        spool: Stores nodes over restarts.
        node_certificates: Checks certificates.
        now: UTC ns.
    """

    def __init__(
        self,
        prefix: str,
        *,
        expire_ns: int,
        spool: Spool,
        node_certificates: NodeCertificates,
        now: Callable[[], int],
    ) -> None:
        self._prefix = prefix
        self._expire_ns = expire_ns
        self._node_certificates = node_certificates
        self._now = now
        self._announced = latest_statuses(spool)
        self._due: list[str] = []
        self._again: set[str] = set()

    def update(self, node: str, status: Status) -> Iterator[Publication]:
        """Announce a node whose status is new or changed."""
        if self._is_expired(status):
            return
        before = self._announced.get(node)
        self._announced[node] = status
        if before is not None and _identity(before) == _identity(status):
            return
        present = {channel.channel for channel in status.channels}
        for channel in () if before is None else before.channels:
            if channel.channel not in present:
                yield self._removal(node, channel.channel)
        yield from self._announce(node, status)

    def announce_all(self) -> None:
        """Announce all nodes again: the broker may have lost retained messages."""
        self._due = list(self._announced)
        self._again = set(self._announced)

    def run_periodic(self) -> Iterator[Publication]:
        """Check some nodes, and publish what changed."""
        self._due = self._due or list(self._announced)
        due, self._due = self._due[:_CHECKED_AT_ONCE], self._due[_CHECKED_AT_ONCE:]
        for node in due:
            status = self._announced[node]
            if self._is_expired(status) or self._node_certificates.find_latest(node) is None:
                del self._announced[node]
                for channel in status.channels:
                    yield self._removal(node, channel.channel)
            elif node in self._again:
                yield from self._announce(node, status)
            self._again.discard(node)

    def _announce(self, node: str, status: Status) -> Iterator[Publication]:
        for channel in status.channels:
            if not is_biometric(channel.channel):
                topic = config_topic(self._prefix, node, channel.channel)
                yield topic, config(node, status, channel), True

    def _removal(self, node: str, channel: str) -> Publication:
        return config_topic(self._prefix, node, channel), b"", True

    def _is_expired(self, status: Status) -> bool:
        return status.time[1] < self._now() - self._expire_ns


def config_topic(prefix: str, node: str, channel: str) -> str:
    """Topic of a channel's configuration. An empty message on it removes the channel.

    Home Assistant allows no dot. A quantity has no dash, so the last dash stands for the dot.
    """
    return f"{prefix}/sensor/{node}/{channel.replace('.', '-')}/config"


def config(node: str, status: Status, channel: ChannelInfo) -> bytes:
    """JSON configuration of a channel as a sensor of a device, which is the node.

    Texts that the node sent are values, never templates.
    """
    topic = live_topic(node, channel.channel)
    taxel, _, quantity = channel.channel.partition(".")
    device_class, unit = _DEVICE_CLASSES.get(
        channel.unit, (None, _UNITS.get(channel.unit, channel.unit))
    )
    item: dict[str, Any] = {
        "name": f"{taxel} {quantity.replace('_', ' ')}",
        "unique_id": f"eskin_{node}_{channel.channel}",
        "object_id": f"{node}_{taxel}_{quantity}",
        "state_topic": topic,
        "value_template": _STATE,
        "json_attributes_topic": topic,
        "json_attributes_template": _ATTRIBUTES,
        "state_class": "measurement",
        "expire_after": _expiry(channel),
        "availability_topic": live_topic(node, "status"),
        "availability_template": _ONLINE,
        "device": {
            "identifiers": [f"eskin_{node}"],
            "name": node,
            "model": status.description or status.profile,
            "manufacturer": "eskin",
        },
        "origin": {"name": "eskin"},
    }
    item |= {} if device_class is None else {"device_class": device_class}
    item |= {} if unit is None else {"unit_of_measurement": unit}
    return orjson.dumps(item)


def _expiry(channel: ChannelInfo) -> int:
    """Seconds after which the state is unknown: the longest block, and some slack."""
    return _SLACK_S + math.ceil(MOST_SAMPLES * channel.dt / SECOND)


def _identity(status: Status) -> tuple[object, ...]:
    """What an announcement depends on."""
    return status.profile, status.description, status.channels
