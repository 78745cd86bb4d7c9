"""MQTT topics of the wire contract.

Private, sealed: ``eskin/v1/nodes/{node}/STREAM``, the streams as in `Stream`.
Public, read only, plain JSON: ``eskin/v1/live/{node}/{channel}`` of a small skin,
``…/patches/{patch}`` of a large one, ``…/events``, ``…/status``; as SenML the same below
``eskin/v1/senml``; ``eskin/v1/alarms/{monitor}``; for Home Assistant ``homeassistant/#``.
"""

from __future__ import annotations

import re
from enum import StrEnum
from functools import lru_cache

from eskin.errors import MessageError

ROOT = "eskin/v1"
LIVE = f"{ROOT}/live"
SENML = f"{ROOT}/senml"
ALARMS = f"{ROOT}/alarms"
HOME_ASSISTANT = "homeassistant"
PUBLIC = (LIVE, SENML, ALARMS, HOME_ASSISTANT)
"""What gateways write, and clients read."""
NODES = f"{ROOT}/nodes"
RENEWAL = f"{ROOT}/renewal"
"""No topic of a broker: the external data of a request to renew a certificate."""

_NODE_TOPIC = re.compile(rf"{NODES}/([a-z0-9][a-z0-9_-]{{0,62}})/([a-z]+)")


class Stream(StrEnum):
    """What a private topic of a node carries."""

    FRAMES = "frames"
    LAYOUTS = "layouts"
    EVENTS = "events"
    STATUS = "status"
    ACKS = "acks"
    COMMANDS = "commands"


FROM_NODE = (Stream.FRAMES, Stream.LAYOUTS, Stream.EVENTS, Stream.STATUS)
"""The streams that a node writes."""


def node_topic(node: str, stream: Stream) -> str:
    """The private topic of one node's stream; ``+`` as the node subscribes to all."""
    return f"{NODES}/{node}/{stream}"


@lru_cache(maxsize=16_384)
def parse_node_topic(topic: str) -> tuple[str, Stream]:
    """The node and the stream of a private topic.

    Raises:
        MessageError: It is no topic of a node.
    """
    found = _NODE_TOPIC.fullmatch(topic)
    if found is None or found[2] not in Stream.__members__.values():
        raise MessageError(f"{topic[:200]!r} is no topic of a node; expected {NODES}/NODE/STREAM")
    return found[1], Stream(found[2])


@lru_cache(maxsize=16_384)
def live_topic(node: str, leaf: str) -> str:
    """The public topic of a node's channel or patch, or of its ``events`` or ``status``."""
    return f"{LIVE}/{node}/{leaf}"


def senml_topic(node: str, leaf: str) -> str:
    """The public topic of a channel's or patch's hulls as SenML."""
    return f"{SENML}/{node}/{leaf}"


def alarm_topic(monitor: str) -> str:
    """The public topic of a monitor's alarms; ``+`` for those of all."""
    return f"{ALARMS}/{monitor}"
