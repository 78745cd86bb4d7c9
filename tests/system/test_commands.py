"""Commands from the API to the node and back, through everything that may go wrong between."""

from __future__ import annotations

import time
from secrets import randbelow, token_hex
from typing import TYPE_CHECKING, Any

import paho.mqtt.client as paho
import pytest
from paho.mqtt.enums import CallbackAPIVersion

from eskin.client import verify_release
from eskin.identity import IdentityKind, client_context
from eskin.identity.identity import ROOT_FILE
from eskin.wire.messages.command import KEY_PLACE
from eskin.wire.topics import Stream, node_topic
from tests.support.processes import wait_until
from tests.system.commands import Chain
from tests.unit.sensor_node.reflex.test_gesture_key import RIGHT, key_of
from tests.unit.sensor_node.services import serving

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tests.support.identities import Identities

TOPIC = node_topic("fingertip", Stream.COMMANDS)


@pytest.fixture(scope="module")
def chain(tmp_path_factory: pytest.TempPathFactory, identities: Identities) -> Iterator[Chain]:
    with Chain(tmp_path_factory.mktemp("chain"), identities) as running:
        yield running


def test_node_signs_a_challenge_once_its_gestures_were_entered(
    chain: Chain, identities: Identities
) -> None:
    node = chain.emulated_node("lid", **key_of(RIGHT, attempts=100))

    def key() -> Any:
        state = chain.client.get("/api/v1/nodes/lid/state").json()
        return (state.get("reported") or {}).get(KEY_PLACE, {})

    with serving(node, epoch=None):
        chain.wait_for_node("lid")
        for _ in range(40):
            nonce = token_hex(16)
            number = chain.ask("challenge", node="lid", nonce=nonce)
            chain.wait_for(number, "done", node="lid")
            wait_until(lambda: key()["outcome"] in {"released", "wrong"}, "it is judged")
            if key()["outcome"] == "released":
                break
            # The scenario repeats each half second, and an entry is right if the challenge came
            # before it presses. An entry that is judged wrong ends at one phase of it: without a
            # random time, the next challenge might come at the same wrong one each time.
            time.sleep(randbelow(500) / 1000)
    found = key()
    root = identities.node.directory / ROOT_FILE
    assert (found["outcome"], found["nonce"]) == ("released", nonce)
    assert verify_release(found["signature"], node="lid", nonce=nonce, root=root).node == "lid"
    events = chain.client.get("/api/v1/events", params={"kind": "verdict", "node": "lid"}).json()
    assert events["items"] == []


def test_command_is_done_and_the_state_shows_it(chain: Chain) -> None:
    with chain.node() as node:
        chain.wait_for_node()
        number = chain.ask("set", rate=50)
        chain.wait_for(number, "done")
        assert node.controls.calls == [("set", {"rate": 50.0})]
    state = chain.client.get("/api/v1/nodes/fingertip/state").json()
    assert state["desired"] == {"*": {"rate": 50.0}}
    assert state["reported"] == {"t01": {"rate": 50.0}, "t02": {"rate": 50.0}}
    assert (state["settled"], state["reported_by"]) == (True, number)
    stated = chain.stated(number)
    assert stated["issued"] < stated["answered"]["hi"] < stated["expires"]
    events = chain.client.get("/api/v1/events", params={"kind": "command"}).json()["items"]
    assert events[0]["detail"] == "set rate 50: done"


def test_node_that_was_away_catches_up_in_order(chain: Chain) -> None:
    with chain.node():
        chain.wait_for_node()
    first = chain.ask("calibrate", taxel="t01")
    second = chain.ask("set", rate=5e3)
    third = chain.ask("set", rate=20, taxel="t02")
    chain.wait_for(first, "delivered")
    assert chain.stated(second)["state"] == "pending"
    with chain.node() as node:
        chain.wait_for(third, "done")
        assert [name for name, _ in node.controls.calls] == ["calibrate", "set", "set"]
    assert chain.stated(first)["state"] == "done"
    refused = chain.stated(second)
    assert refused["state"] == "refused"
    assert refused["reason"].startswith("rate is 5000.0; allowed: at most 1000")


def test_command_expires_while_its_node_is_away(chain: Chain) -> None:
    with chain.node():
        chain.wait_for_node()
    number = chain.ask("calibrate", expires=1)
    chain.wait_for(number, "expired")
    later = chain.ask("set", smoothing=0.5)
    with chain.node() as node:
        chain.wait_for(later, "done")
        assert [name for name, _ in node.controls.calls] == ["set"]
    assert chain.stated(number)["state"] == "expired"


@pytest.mark.nightly
def test_restarted_gateway_and_cloud_deliver_what_waits(chain: Chain) -> None:
    with chain.node():
        chain.wait_for_node()
    first, second = chain.ask("calibrate"), chain.ask("calibrate")
    chain.wait_for(first, "delivered")
    chain.gateway.stop()
    chain.restart_cloud()
    with chain.node() as node:
        # The broker has kept the first; the second needs gateway and cloud.
        wait_until(lambda: len(node.controls.calls) == 1, "the first is done")
        chain.start_gateway()
        chain.wait_for(second, "done")
        assert len(node.controls.calls) == 2
    assert chain.stated(first)["state"] == "done"


def test_broker_can_neither_read_nor_replay_nor_redirect_nor_forge(
    chain: Chain, identities: Identities, caplog: pytest.LogCaptureFixture
) -> None:
    with chain.node() as node, chain.node("palm") as palm:
        chain.wait_for_node("palm")
        chain.published.clear()
        chain.wait_for(chain.ask("calibrate"), "done")
        sealed = next(data for topic, data in chain.published if topic == TOPIC and data)
        assert b"calibrate" not in sealed
        assert len(node.controls.calls) == 1
        mutant = bytearray(sealed)
        mutant[-1] ^= 1
        evil = identities.make(IdentityKind.GATEWAY, "gateway.evil")
        client = paho.Client(CallbackAPIVersion.VERSION2, client_id=evil.name)
        client.tls_set_context(client_context(evil.directory / ROOT_FILE, evil))
        client.connect("127.0.0.1", chain.broker.gateway_port)
        client.loop_start()
        for topic, payload in (
            (TOPIC, sealed),
            (TOPIC, bytes(mutant)),
            (TOPIC, b"rubbish"),
            (node_topic("palm", Stream.COMMANDS), sealed),
        ):
            client.publish(topic, payload, qos=1).wait_for_publish(60)
        client.disconnect()
        client.loop_stop()
        wait_until(lambda: caplog.text.count("command rejected") == 3, "three are rejected")
        chain.wait_for(chain.ask("set", gain=2), "done")
        chain.wait_for(chain.ask("set", gain=2, node="palm"), "done", node="palm")
        assert [name for name, _ in node.controls.calls] == ["calibrate", "set"]
        assert [name for name, _ in palm.controls.calls] == ["set"]
