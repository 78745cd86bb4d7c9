"""COSE_Encrypt0: envelopes with any byte or any header changed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin.errors import EnvelopeError
from eskin.wire.envelope import Opener, introduction
from eskin.wire.messages import Position
from eskin.wire.topics import Stream, node_topic
from tests.robustness.fuzz.mutations.trees import mutate_tree
from tests.robustness.fuzz.target import Target
from tests.support.identities import Identities
from tests.unit.gateway.messages import status
from tests.unit.gateway.skins import SMALL
from tests.unit.gateway.wire_node import Seal

if TYPE_CHECKING:
    from pathlib import Path

TOPIC = node_topic("fingertip", Stream.STATUS)


def make(folder: Path) -> Target:
    """Only `EnvelopeError`; what opens is what was sealed."""
    identities = Identities(folder / "identities")
    seal = Seal(identities.node, identities.site)
    said = [status(0).encode(), SMALL.frame(1).encode()]
    seeds = [
        seal("fingertip", Stream.STATUS, plaintext, held=held, introduce=introduce)
        for plaintext in said
        for held, introduce in ((None, False), (Position(1, 0), True))
    ]
    node = identities.node
    opener = Opener([identities.site], sender={node.thumbprint: node.certificate}.get, capacity=64)

    def check(data: bytes) -> None:
        try:
            introduction(data)
            opened = opener.open(data, topic=TOPIC)
        except EnvelopeError:
            return
        assert opened.plaintext in said, "something opened that no one sealed"
        assert opened.sender == "fingertip"

    return Target(tuple(seeds), mutate_tree, check)
