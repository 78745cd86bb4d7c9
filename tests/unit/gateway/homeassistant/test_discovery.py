"""Channels appear in Home Assistant by themselves, and go with their node."""

from __future__ import annotations

import json
import subprocess
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_gateway.publish import public_payloads
from eskin_gateway.publish.frame_hulls import HullCollector
from eskin_gateway.publish.homeassistant import config, config_topic, configs
from eskin_gateway.service import Gateway
from eskin_gateway.settings import PublicSection
from hypothesis import given
from hypothesis import strategies as st

from eskin.identity import IdentityKind
from eskin.wire.frames import Controller, DescribedLayout, EncodedFrame, Patch
from eskin.wire.messages.header import CHANNEL as CHANNEL_NAME
from eskin.wire.topics import Stream, live_topic
from tests.support.identities import Identities
from tests.support.processes import wait_until
from tests.unit.gateway.in_memory import DAY_NS, Inside
from tests.unit.gateway.messages import CHANNEL, EPOCH, PATCH, status
from tests.unit.gateway.skins import LARGE, MIXED, PERIOD, SMALL, WEARER, SkinNode, SkinOf
from tests.unit.gateway.wire_node import Listener, Seal, WireNode

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin_gateway.mqtt.transport import Publication
    from eskin_gateway.settings import GatewaySettings

    from eskin.wire.frames import Frame
    from eskin.wire.messages import Status
    from tests.support.brokers import Mosquitto

PYTHON = Path(__file__).parents[4] / ".venv" / "homeassistant" / "bin" / "python"
EVALUATE = Path(__file__).with_name("evaluate.py")
TOPIC = "homeassistant/sensor/fingertip/t01-capacitance/config"
OTHER = "homeassistant/sensor/fingertip/t02-current/config"

UNITS = ["F", "A", "V", "m2", "J", "m", "Pa", "Hz", "H", "1", "rad", "Cel", "%"]


def asked(topic: str, payload: bytes, *, states: list[bytes], statuses: list[bytes]) -> Any:
    """A question to Home Assistant."""
    return {
        "prefix": "homeassistant",
        "topic": topic,
        "config": payload.decode(),
        "now": time.time(),
        "states": [state.decode() for state in states],
        "statuses": [each.decode() for each in statuses],
    }


def judged(*questions: Any) -> list[Any]:
    """What Home Assistant itself makes of them."""
    assert PYTHON.exists(), "Home Assistant is missing: run make test"
    done = subprocess.run(
        [PYTHON, EVALUATE], input=json.dumps(questions), capture_output=True, text=True,
        check=False, timeout=250,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return list(json.loads(done.stdout))


def now_status(sequence: int) -> Status:
    """A status of this instant."""
    return replace(status(sequence), time=(time.time_ns() - 10**9, time.time_ns()))


def now_frame(sequence: int, skin: SkinOf) -> Frame:
    """A frame that ends at this instant."""
    now = time.time_ns() - 5 * PERIOD
    return replace(skin.frame(sequence), time=(now, now))


def published(frame: Frame, skin: SkinOf, node: str = "n") -> list[Publication]:
    """What is published of a frame."""
    data = frame.encode()
    described = DescribedLayout.of(skin.layout, skin.patches)
    due = HullCollector().add(node, EncodedFrame.decode(data), described, now=1.0)
    return [each for _, hull in due for each in public_payloads.hulls(node, hull, senml=False)]


ONE = SkinOf(PATCH)
BOTH = SkinOf(PATCH, Patch("wire", "current", "A", ("t02",), 1.0), WEARER, pages=(2, 1))


@pytest.fixture
def gateway(settings: GatewaySettings) -> Iterator[Gateway]:
    running = Gateway(settings.model_copy(update={"public": PublicSection(homeassistant=True)}))
    running.start()
    wait_until(lambda: running.broker.connected, "the gateway is connected")
    yield running
    running.stop()


@pytest.mark.usefixtures("gateway")
def test_home_assistant_accepts_channels_with_bounds_and_availability(
    identities: Identities, broker: Mosquitto, node: WireNode
) -> None:
    client = identities.make(IdentityKind.CLIENT, "client.home")
    with Listener(client, broker.client_port) as listener:
        node.say(Stream.STATUS, now_status(0))
        SkinNode(node, BOTH).describe()
        node.say(Stream.FRAMES, now_frame(1, BOTH))
        node.say(Stream.FRAMES, BOTH.frame(3))
        state = live_topic("fingertip", CHANNEL)
        wait_until(lambda: len(listener.on(state)) > 1, "both hulls are public")
        statuses = live_topic("fingertip", "status")
        silent = "silent, so offline"
        wait_until(lambda: not json.loads(listener.on(statuses)[-1])["online"], silent)
        stated = listener.on(statuses)
        heard = listener.on(state), [stated[0], stated[-1]]
    # Home Assistant may start later: the broker retains the announcements.
    with Listener(client, broker.client_port, "homeassistant/#") as late:
        wait_until(lambda: len(late.received) >= 2, "both channels are announced")
        assert {(topic, kept) for topic, _, kept in late.received} == {(TOPIC, True), (OTHER, True)}
        (one,) = judged(asked(TOPIC, late.on(TOPIC)[0], states=heard[0], statuses=heard[1]))
        assert float(one["states"][0]) == pytest.approx(1050.0)
        assert {"lo", "hi", "t0", "t1", "coverage", "unit"} <= set(one["attributes"][0])
        # A delayed frame is not the present state.
        assert (one["states"][1:], one["attributes"][1:]) == (["None"], [[]])
        assert one["available"] == [True, False]
        assert (one["component"], one["node_id"], one["unit"]) == ("sensor", "fingertip", "F")
        assert one["expire_after"] == 120
        SkinNode(node, ONE).describe()
        node.say(Stream.FRAMES, now_frame(4, ONE))
        wait_until(lambda: late.on(OTHER) == [late.on(OTHER)[0], b""], "the channel went")
    with Listener(client, broker.client_port, "homeassistant/#") as last:
        node.say(Stream.STATUS, replace(now_status(5), description="another finger"))
        anew = "the other channel is announced anew, after all that was kept"
        wait_until(lambda: any(not kept for _, _, kept in list(last.received)), anew)
        assert [topic for topic, _, _ in last.received] == [TOPIC, TOPIC]


def test_home_assistant_accepts_every_unit_and_unbounded_sides() -> None:
    body = json.loads(published(now_frame(0, ONE), ONE)[0][1])
    open_above = json.dumps(body | {"hi": None}).encode()
    topic = config_topic("homeassistant", "n", "t01.humidity")
    announced = [config("n", status(0), "t01.humidity", unit) for unit in UNITS]
    answers = judged(*(asked(topic, each, states=[open_above], statuses=[]) for each in announced))
    stated = {"m2": "m²", "Cel": "°C", "1": None}
    assert [one["unit"] for one in answers] == [stated.get(unit, unit) for unit in UNITS]
    # Its unknown state; the attributes still hold the other bound.
    assert [one["states"] for one in answers] == [["None"]] * len(UNITS)
    assert all("lo" in one["attributes"][0] for one in answers)


names = st.builds(
    lambda taxel, quantity: f"a{taxel}.b{quantity}",
    st.text("b-_", max_size=3),
    st.text("b_", max_size=3),
).filter(lambda name: CHANNEL_NAME.fullmatch(name) is not None)


@given(one=names, two=names)
def test_no_two_channels_share_a_topic(one: str, two: str) -> None:
    topics = {config_topic("homeassistant", "n", name) for name in (one, two)}
    assert len(topics) == len({one, two})
    assert all("." not in topic for topic in topics)


def test_texts_of_a_node_are_no_templates() -> None:
    evil = "{{ states.light | list }}"
    said = json.loads(config("n", status(0, description=evil), CHANNEL, "F"))
    assert said["device"]["model"] == evil
    assert [name for name, value in said.items() if evil in str(value)] == ["device"]


def announced(inside: Inside) -> list[bool]:
    """Whether each publication for the channel announces it (and does not remove it)."""
    return [payload != b"" for payload in inside.broker.on(TOPIC)]


def introduce(inside: Inside, seal: Seal, number: int, **changes: Any) -> None:
    stated = replace(status(number), **changes)
    envelope = seal("fingertip", Stream.STATUS, stated.encode(), introduce=True)
    inside.arrive(Stream.STATUS, envelope)
    if not number:
        describe(inside, seal, ONE, 100)


@pytest.fixture
def own(tmp_path: Path) -> Identities:
    return Identities(tmp_path / "own")


@pytest.fixture
def home(tmp_path: Path, own: Identities) -> Iterator[Inside]:
    crl = own.authority.write_revocations(IdentityKind.NODE)
    made = Inside(tmp_path, own, revocations=crl, homeassistant=True)
    yield made
    made.spool.close()


def test_channel_is_announced_once_and_again_when_it_changes(home: Inside, own: Identities) -> None:
    seal = Seal(own.node, own.site)
    introduce(home, seal, 0)
    introduce(home, seal, 1, uptime=7)
    assert announced(home) == [True]
    introduce(home, seal, 2, description="another finger")
    assert announced(home) == [True, True]


def test_channels_of_a_revoked_node_are_removed(home: Inside, own: Identities) -> None:
    introduce(home, Seal(own.node, own.site), 0)
    home.post_commit.run_periodic()
    home.clock.seconds += 1.5
    home.post_commit.run_periodic()
    assert False not in announced(home)
    own.authority.revoke("fingertip")
    home.clock.seconds += 1.5
    home.post_commit.run_periodic()
    assert announced(home)[-1] is False
    home.post_commit.run_periodic()
    assert announced(home).count(False) == 1


def test_channels_of_a_silent_node_expire_and_return(home: Inside, own: Identities) -> None:
    seal = Seal(own.node, own.site)
    introduce(home, seal, 0)
    home.clock.seconds += 86_399
    home.post_commit.run_periodic()
    assert announced(home)[-1] is True
    home.clock.seconds += 2
    home.post_commit.run_periodic()
    assert announced(home)[-1] is False
    introduce(home, seal, 1, time=(EPOCH + 5, EPOCH + 5))  # it had been held in its flash
    assert announced(home)[-1] is False
    introduce(home, seal, 2, time=(EPOCH + 5, EPOCH + 2 * DAY_NS))
    assert announced(home)[-1] is True


def test_channels_are_announced_again_after_a_reconnect(home: Inside, own: Identities) -> None:
    introduce(home, Seal(own.node, own.site), 0)
    home.post_commit.run_periodic()
    before = len(announced(home))
    home.broker.connected = False
    home.post_commit.run_periodic()
    assert len(announced(home)) == before
    home.broker.connected = True
    home.post_commit.run_periodic()
    assert announced(home)[before:] == [True]


def test_restarted_gateway_removes_expired_channels(
    tmp_path: Path, home: Inside, own: Identities
) -> None:
    introduce(home, Seal(own.node, own.site), 0)
    home.spool.close()
    crl = own.authority.write_revocations(IdentityKind.NODE)
    later = Inside(tmp_path, own, revocations=crl, homeassistant=True)
    later.post_commit.run_periodic()
    assert announced(later) == [True]
    later.clock.seconds += 86_402
    later.post_commit.run_periodic()
    assert announced(later) == [True, False]
    later.spool.close()


def describe(inside: Inside, seal: Seal, skin: SkinOf, sequence: int) -> None:
    """Send a layout and a frame of it."""
    for each in skin.descriptions:
        inside.arrive(Stream.LAYOUTS, seal("fingertip", Stream.LAYOUTS, each))
    frame = skin.frame(sequence).encode()
    inside.arrive(Stream.FRAMES, seal("fingertip", Stream.FRAMES, frame))


def present(inside: Inside) -> set[str]:
    """What is announced and was not removed."""
    found: dict[str, bytes] = {}
    for topic, body, retained in inside.broker.published:
        if topic.startswith("homeassistant/"):
            assert retained
            found[topic] = body
    return {topic.split("/")[3] for topic, body in found.items() if body}


def test_patches_of_a_large_skin_are_announced_and_not_its_channels(
    tmp_path: Path, home: Inside, own: Identities
) -> None:
    seal = Seal(own.node, own.site)
    introduce(home, seal, 0)
    describe(home, seal, SMALL, 1)
    small = {"p000c00-pressure", "p000c01-pressure", "p000c02-pressure"}
    small |= {"p001c00-pressure", "p001c01-pressure"}
    assert present(home) == small
    describe(home, seal, LARGE, 2)
    large = {f"{mark}pad00{number}" for number in range(4) for mark in ("_", "__")}
    assert present(home) == large
    before = len(home.broker.published)
    home.arrive(Stream.FRAMES, seal("fingertip", Stream.FRAMES, LARGE.frame(3).encode()))
    assert not [on for on, *_ in home.broker.published[before:] if on.startswith("homeassistant")]
    home.spool.close()
    crl = own.authority.write_revocations(IdentityKind.NODE)
    later = Inside(tmp_path, own, revocations=crl, homeassistant=True)
    later.post_commit.run_periodic()
    assert present(later) == large, "also of a node that sends nothing after a restart"
    later.clock.seconds += 86_402
    later.post_commit.run_periodic()
    assert present(later) == set()
    later.spool.close()


def test_biometric_patches_and_those_of_other_controllers_are_not_announced(
    home: Inside, own: Identities
) -> None:
    seal = Seal(own.node, own.site)
    introduce(home, seal, 0)
    describe(home, seal, MIXED, 1)
    assert present(home) == {"p000c00-pressure", "p000c01-pressure", "p000c02-pressure"}
    shared = SkinOf(*LARGE.patches, pages=(2, 2))
    shared.layout = replace(
        shared.layout, controllers=(Controller("fingertip", 1), Controller("palm", 1))
    )
    describe(home, seal, shared, 2)
    assert present(home) == {"_pad000", "__pad000", "_pad001", "__pad001"}


def test_home_assistant_accepts_patches_and_contacts() -> None:
    skin = DescribedLayout.of(LARGE.layout, LARGE.patches)
    announced = configs("homeassistant", "n", now_status(0), skin)
    late = LARGE.frame(0, {0: np.full(20, 3500.0), 1: np.full(20, 10.0)})
    now = time.time_ns() - 5 * PERIOD
    fresh = published(replace(late, time=(now, now)), LARGE)
    states = [fresh[0][1], published(late, LARGE)[0][1]]
    sides = json.loads(states[0])
    states.append(json.dumps(sides | {"hull": sides["hull"] | {"hi": None}}).encode())
    answers = judged(
        *(
            asked(
                f"homeassistant/sensor/n/{leaf}/config", announced[on], states=states, statuses=[]
            )
            for leaf in ("_pad000", "__pad000")
            for on in [f"homeassistant/sensor/n/{leaf}/config"]
        )
    )
    patch, contact = answers
    assert patch["states"] == ["3550.0", "None", "None"]
    assert (patch["unit"], patch["device_class"]) == ("Pa", "pressure")
    assert patch["attributes"][0] == ["coverage", "hi", "lo", "t0", "t1", "unit"]
    assert patch["attributes"][1] == []
    assert contact["states"] == ["certain", "None", "certain"]
    assert contact["unit"] is None
    assert (
        json.loads(announced["homeassistant/sensor/n/_pad000/config"])["state_topic"] == fresh[0][0]
    )


def test_discovery_is_off_by_default(inside: Inside, identities: Identities) -> None:
    introduce(inside, Seal(identities.node, identities.site), 0)
    inside.post_commit.run_periodic()
    assert [topic for topic, _, _ in inside.broker.published if "homeassistant" in topic] == []
