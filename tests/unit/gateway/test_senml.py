"""SenML on its topic, over the real broker."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_gateway.service import Gateway
from eskin_gateway.settings import PublicSection

from eskin.identity import IdentityKind
from eskin.wire.topics import Stream
from tests.support.processes import wait_until
from tests.unit.eskin.senml import read_senml
from tests.unit.gateway.messages import status
from tests.unit.gateway.skins import MIXED, SkinNode
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
        SkinNode(node, MIXED).describe()
        node.say(Stream.FRAMES, MIXED.frame(1, page=1))
        node.say(Stream.FRAMES, MIXED.frame(2))
        channels = MIXED.patches[0].channels
        wait_until(lambda: len(listening.received) >= len(channels), "the frame is public")
        received = listening.received
    running.stop()
    assert [(topic, kept) for topic, _, kept in received] == [
        (f"eskin/v1/senml/fingertip/{channel}", False) for channel in channels
    ]
    stated = dict(read_senml(received[0][1].decode(), f"fingertip/{channels[0]}/"))
    assert (stated["lo"], stated["hi"]) == (1000.0, 1100.0)
