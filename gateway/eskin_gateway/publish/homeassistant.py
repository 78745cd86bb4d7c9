"""Announces channels to Home Assistant by MQTT discovery: one retained topic for each.

Source: home-assistant.io/integrations/mqtt (discovery) and /integrations/sensor.mqtt.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import orjson

from eskin.wire.topics import live_topic
from eskin_gateway.publish.frame_hulls import LARGE
from eskin_gateway.publish.presence import latest_statuses

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from eskin.wire.frames import DescribedLayout, Patch
    from eskin.wire.messages import Status
    from eskin_gateway.mqtt.transport import Publication
    from eskin_gateway.spool.descriptions import Descriptions
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
"""Whether a frame was delayed: Home Assistant would show it as the present state."""
_STATE: Final = (
    _LATE + "{% set lo, hi = value_json.lo, value_json.hi %}"
    "{{ none if late or lo is none or hi is none else lo + (hi - lo) / 2 }}"
)
"""The midpoint, which Home Assistant draws. The attributes ``lo`` and ``hi`` are the interval."""
_ATTRIBUTES: Final = _LATE + "{{ ({} if late else value_json) | tojson }}"
_PATCH_STATE: Final = (
    _LATE + "{% set lo, hi = value_json.hull.lo, value_json.hull.hi %}"
    "{{ none if late or lo is none or hi is none else lo + (hi - lo) / 2 }}"
)
_PATCH_ATTRIBUTES: Final = (
    _LATE + "{% set shown = {'lo': value_json.hull.lo, 'hi': value_json.hull.hi, "
    "'coverage': value_json.hull.coverage, 't0': value_json.t0, 't1': value_json.t1, "
    "'unit': value_json.unit} %}{{ ({} if late else shown) | tojson }}"
)
_CONTACT: Final = _LATE + "{{ none if late else value_json.contact }}"
_EXPIRY_S: Final = 120
"""Seconds without a hull after which a state is unknown: two of the longest stretches of a node."""
_ONLINE: Final = "{{ 'online' if value_json.online else 'offline' }}"


class Discovery:
    """Announces the public channels of each node until the node expires. Not thread-safe.

    Of a large skin, patches are announced, and whether something touches them.

    A node expires when its certificate is revoked or expired, or after ``expire_ns`` without a
    status. Its next status announces it again.

    Args:
        prefix: Home Assistant's discovery topic.
        expire_ns: Age in ns of a node's latest status at which it expires.
        spool: Stores nodes over restarts.
        node_certificates: Checks certificates.
        descriptions: Finds the skins of nodes.
        now: UTC ns.
    """

    def __init__(
        self,
        prefix: str,
        *,
        expire_ns: int,
        spool: Spool,
        node_certificates: NodeCertificates,
        descriptions: Descriptions,
        now: Callable[[], int],
    ) -> None:
        self._prefix = prefix
        self._expire_ns = expire_ns
        self._node_certificates = node_certificates
        self._now = now
        self._announced = latest_statuses(spool)
        skins = {node: descriptions.latest(node) for node in self._announced}
        self._skins = {node: skin for node, skin in skins.items() if skin is not None}
        self._due: list[str] = []
        self._again: set[str] = set()

    def update(self, node: str, status: Status) -> Iterator[Publication]:
        """Announce a node whose status is new or changed."""
        if self._is_expired(status):
            return
        before, skin = self._announced.get(node), self._skins.get(node)
        self._announced[node] = status
        if before is not None and _identity(before) == _identity(status):
            return
        earlier = {} if before is None else configs(self._prefix, node, before, skin)
        yield from self._replace(node, earlier)

    def describe(self, node: str, skin: DescribedLayout) -> Iterator[Publication]:
        """Announce a node whose skin is new or changed, if it has sent a status."""
        before = self._skins.get(node)
        if before is skin:
            return
        self._skins[node] = skin
        status = self._announced.get(node)
        if status is not None and (before is None or before.layout != skin.layout):
            yield from self._replace(node, configs(self._prefix, node, status, before))

    def _replace(self, node: str, earlier: Mapping[str, bytes]) -> Iterator[Publication]:
        """Announce a node, and remove what it does not have any more."""
        present = configs(self._prefix, node, self._announced[node], self._skins.get(node))
        for topic in earlier.keys() - present.keys():
            yield topic, b"", True
        for topic, body in present.items():
            yield topic, body, True

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
                for topic in configs(self._prefix, node, status, self._skins.get(node)):
                    yield topic, b"", True
            elif node in self._again:
                yield from self._replace(node, {})
            self._again.discard(node)

    def _is_expired(self, status: Status) -> bool:
        return status.time[1] < self._now() - self._expire_ns


def configs(
    prefix: str, node: str, status: Status, skin: DescribedLayout | None
) -> dict[str, bytes]:
    """Topics and JSON configurations of all that is announced of a node."""
    if skin is None:
        return {}
    if skin.channels < LARGE:
        return {
            config_topic(prefix, node, channel): config(node, status, channel, patch.unit)
            for patch in skin.public_patches(node)
            for channel in patch.channels
        }
    found = {}
    for patch in skin.public_patches(node):
        # No taxel begins with "_", so these are no topics of channels.
        leaf = f"{prefix}/sensor/{node}/_{patch.patch_id}/config"
        found[leaf] = patch_config(node, status, patch)
        if patch.threshold is not None:
            leaf = f"{prefix}/sensor/{node}/__{patch.patch_id}/config"
            found[leaf] = contact_config(node, status, patch)
    return found


def config_topic(prefix: str, node: str, channel: str) -> str:
    """Topic of a channel's configuration. An empty message on it removes the channel.

    Home Assistant allows no dot. A quantity has no dash, so the last dash stands for the dot.
    """
    return f"{prefix}/sensor/{node}/{channel.replace('.', '-')}/config"


def config(node: str, status: Status, channel: str, unit: str) -> bytes:
    """JSON configuration of a channel as a sensor of a device, which is the node.

    Texts that the node sent are values, never templates.
    """
    taxel, _, quantity = channel.partition(".")
    item = {
        "name": f"{taxel} {quantity.replace('_', ' ')}",
        "unique_id": f"eskin_{node}_{channel}",
        "object_id": f"{node}_{taxel}_{quantity}",
        "value_template": _STATE,
        "json_attributes_template": _ATTRIBUTES,
    }
    return _sensor(node, status, channel, item | _measurement(unit))


def patch_config(node: str, status: Status, patch: Patch) -> bytes:
    """JSON configuration of a patch: its state is the middle of the hull of all its columns."""
    item = {
        "name": f"{patch.patch_id} {patch.quantity.replace('_', ' ')}",
        "unique_id": f"eskin_{node}_patch_{patch.patch_id}",
        "object_id": f"{node}_{patch.patch_id}_{patch.quantity}",
        "value_template": _PATCH_STATE,
        "json_attributes_template": _PATCH_ATTRIBUTES,
    }
    leaf = f"patches/{patch.patch_id}"
    return _sensor(node, status, leaf, item | _measurement(patch.unit))


def contact_config(node: str, status: Status, patch: Patch) -> bytes:
    """JSON configuration of whether something touches a patch: one of three verdicts."""
    item = {
        "name": f"{patch.patch_id} contact",
        "unique_id": f"eskin_{node}_contact_{patch.patch_id}",
        "object_id": f"{node}_{patch.patch_id}_contact",
        "value_template": _CONTACT,
        "json_attributes_template": _PATCH_ATTRIBUTES,
    }
    return _sensor(node, status, f"patches/{patch.patch_id}", item)


def _measurement(unit: str) -> dict[str, str]:
    device_class, shown = _DEVICE_CLASSES.get(unit, (None, _UNITS.get(unit, unit)))
    item = {"state_class": "measurement"}
    item |= {} if device_class is None else {"device_class": device_class}
    return item | ({} if shown is None else {"unit_of_measurement": shown})


def _sensor(node: str, status: Status, leaf: str, item: dict[str, Any]) -> bytes:
    topic = live_topic(node, leaf)
    item |= {
        "state_topic": topic,
        "json_attributes_topic": topic,
        "expire_after": _EXPIRY_S,
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
    return orjson.dumps(item)


def _identity(status: Status) -> tuple[object, ...]:
    """What an announcement depends on."""
    return status.profile, status.description
