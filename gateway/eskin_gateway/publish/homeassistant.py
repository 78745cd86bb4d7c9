"""Channels as Home Assistant's MQTT discovery takes them: one retained topic each.

Source: home-assistant.io/integrations/mqtt (discovery) and /integrations/sensor.mqtt.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import orjson

from eskin.wire.messages.block_header import MOST_SAMPLES
from eskin.wire.timestamp import SECOND
from eskin.wire.topics import live_topic

if TYPE_CHECKING:
    from eskin.wire.messages import ChannelInfo, Status

_KINDS: Final = {
    "A": ("current", "A"),
    "V": ("voltage", "V"),
    "Hz": ("frequency", "Hz"),
    "Pa": ("pressure", "Pa"),
    "m": ("distance", "m"),
    "Cel": ("temperature", "°C"),
    "%": ("humidity", "%"),
}
"""UCUM code: Home Assistant's device class and its unit. It knows no class for F, H and J."""
_UNITS: Final = {"m2": "m²", "1": None}
_SLACK_S: Final = 60
_LATE: Final = f"{{% set late = as_timestamp(now()) - as_timestamp(value_json.t1) > {_SLACK_S} %}}"
"""Whether a block waited, while its node was away: Home Assistant would take it for the present."""
_MIDDLE: Final = (
    _LATE + "{% set lo, hi = value_json.lo, value_json.hi %}"
    "{{ none if late or lo is none or hi is none else lo + (hi - lo) / 2 }}"
)
"""Where the state is drawn. The claim is the interval in the attributes ``lo`` and ``hi``."""
_ATTRIBUTES: Final = _LATE + "{{ ({} if late else value_json) | tojson }}"
_ONLINE: Final = "{{ 'online' if value_json.online else 'offline' }}"


def config_topic(prefix: str, node: str, channel: str) -> str:
    """Where a channel is announced; an empty message there takes it away.

    Home Assistant allows no dot. A quantity holds no dash, so the last one stands for it alone.
    """
    return f"{prefix}/sensor/{node}/{channel.replace('.', '-')}/config"


def config(node: str, status: Status, channel: ChannelInfo) -> bytes:
    """JSON of a channel: a sensor of the node, which is a device.

    What the node says of itself stands in plain texts alone, never in a template.
    """
    topic = live_topic(node, channel.channel)
    taxel, _, quantity = channel.channel.partition(".")
    kind, unit = _KINDS.get(channel.unit, (None, _UNITS.get(channel.unit, channel.unit)))
    item: dict[str, Any] = {
        "name": f"{taxel} {quantity.replace('_', ' ')}",
        "unique_id": f"eskin_{node}_{channel.channel}",
        "object_id": f"{node}_{taxel}_{quantity}",
        "state_topic": topic,
        "value_template": _MIDDLE,
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
    item |= {} if kind is None else {"device_class": kind}
    item |= {} if unit is None else {"unit_of_measurement": unit}
    return orjson.dumps(item)


def _expiry(channel: ChannelInfo) -> int:
    """Seconds after which nothing is known any more: the longest block, and then some."""
    return _SLACK_S + math.ceil(MOST_SAMPLES * channel.dt / SECOND)
