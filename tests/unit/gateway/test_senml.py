"""SenML on its topic, over the real broker."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_gateway.service import Gateway
from eskin_gateway.settings import PublicSection

from eskin.identity import IdentityKind
from eskin.wire.topics import Stream
from tests.support.processes import wait_until
from tests.unit.eskin.senml import read_senml
from tests.unit.gateway.messages import CHANNEL, block, status
from tests.unit.gateway.wire_node import Listener, WireNode

if TYPE_CHECKING:
    from eskin_gateway.settings import GatewaySettings

    from tests.support.brokers import Mosquitto
    from tests.support.identities import Identities


def test_senml_is_published_for_channels_that_are_not_biometric(
    settings: GatewaySettings, broker: Mosquitto, identities: Identities, node: WireNode
) -> None:
    running = Gateway(settings.model_copy(update={"public": PublicSection(senml=True)}))
    running.start()
    client = identities.make(IdentityKind.CLIENT, "client.senml")
    with Listener(client, broker.client_port, "eskin/v1/senml/#") as listening:
        wait_until(lambda: running.broker.connected, "the gateway is connected")
        node.say(Stream.STATUS, status(0))
        node.say(Stream.BLOCKS, block(1, channel="t01.bioelectric"))
        node.say(Stream.BLOCKS, block(2))
        wait_until(lambda: bool(listening.received), "the block is public")
        ((topic, pack, kept),) = listening.received
    running.stop()
    assert (topic, kept) == (f"eskin/v1/senml/fingertip/{CHANNEL}", False)
    told = dict(read_senml(pack.decode(), f"fingertip/{CHANNEL}/"))
    assert (told["lo"], told["hi"]) == block(2).bounds
