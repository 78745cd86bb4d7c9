"""What a broker delivers to a gateway: any topic with any payload, sealed or not."""

from __future__ import annotations

import logging
from contextlib import ExitStack
from typing import TYPE_CHECKING

import cbor2
from eskin_gateway.mqtt.transport import ReceivedMessage

from eskin.wire.envelope import Sealer
from eskin.wire.topics import Stream, node_topic
from tests.robustness.fuzz.mutations.trees import mutate_tree, read_input
from tests.robustness.fuzz.target import Target
from tests.support.identities import Identities
from tests.unit.gateway.in_memory import Inside
from tests.unit.gateway.messages import result, status
from tests.unit.gateway.skins import SMALL

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.wire.frames import Frame, Statements
    from eskin.wire.messages import Message

_ANEW = 1000
"""Arrivals after which the spool is emptied, and what is known of the node is forgotten."""


def make(folder: Path) -> Target:
    """The input is ``[topic, sealed, payload]``; no error, and each arrival is answered for."""
    logging.getLogger("eskin_gateway").setLevel(logging.CRITICAL)
    identities = Identities(folder / "identities")
    sealer = Sealer(identities.node, identities.site.certificate)
    inside = Inside(folder, identities)
    stack = ExitStack()
    stack.callback(inside.spool.close)
    known = sealer.seal(
        status(0).encode(), topic=node_topic("fingertip", Stream.STATUS), introduce=True
    )
    inside.arrive(Stream.STATUS, known)
    for each in SMALL.descriptions:
        topic = node_topic("fingertip", Stream.LAYOUTS)
        inside.arrive(Stream.LAYOUTS, sealer.seal(each, topic=topic))
    count = 0

    def check(data: bytes) -> None:
        nonlocal count
        topic, sealed, payload = read_input(data, 3)
        if not isinstance(topic, str) or not isinstance(payload, bytes):
            return
        count += 1
        if sealed is True:
            payload = sealer.seal(payload, topic=topic, introduce=topic.endswith("status"))
        inside.commit_loop.process(
            [ReceivedMessage(topic, payload, count, qos=1, retained=False, connection=1)]
        )
        assert inside.broker.released == [count], "the broker waits for an answer"
        inside.broker.released.clear()
        inside.broker.published.clear()
        if count % _ANEW == 0:
            inside.spool.settle(inside.spool.take(10_000, 10**9))
            inside.spool._ingest.execute("DELETE FROM nodes")
            inside.node_states.reset()

    inside.broker.released.clear()
    said: list[tuple[Stream, Message | Frame | Statements]] = [
        (Stream.FRAMES, SMALL.frame(1)),
        (Stream.EVENTS, SMALL.peaks(2)),
        (Stream.EVENTS, SMALL.statements(3)),
        (Stream.EVENTS, result(5, 1)),
        (Stream.STATUS, status(4)),
    ]
    inputs = [[node_topic("fingertip", stream), True, one.encode()] for stream, one in said]
    layouts = node_topic("fingertip", Stream.LAYOUTS)
    inputs += [[layouts, True, each] for each in SMALL.descriptions]
    inputs.append([node_topic("fingertip", Stream.STATUS), False, known])
    return Target(tuple(cbor2.dumps(one) for one in inputs), mutate_tree, check, stack)
