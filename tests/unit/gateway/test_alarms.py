"""Alarms are published until the broker has each, in their order, and are never lost or stale."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest
from eskin_gateway.publish.alarms import RESEND_S, AlarmPublisher
from hypothesis import given
from hypothesis import strategies as st

from eskin.identity import IdentityKind
from eskin.wire.topics import alarm_topic
from tests.support.processes import wait_until
from tests.unit.gateway.homeassistant.test_discovery import asked, judged
from tests.unit.gateway.wire_node import Listener

if TYPE_CHECKING:
    from eskin_gateway.service import Gateway

    from tests.support.brokers import Mosquitto
    from tests.support.identities import Identities
    from tests.unit.gateway.stub_cloud import StubCloud

MONITORS = ("squeeze", "slip")


def document(number: int, monitor: str, *, state: str = "raised") -> str:
    """What the cloud gives of a change."""
    alarm = {"id": number, "monitor": monitor, "verdict": "certain"}
    said = {
        "number": number,
        "transition": "deleted" if state == "deleted" else state,
        "monitor": monitor,
        "state": "cleared" if state == "deleted" else state,
        "alarm": None if state == "deleted" else alarm,
    }
    return json.dumps(said)


def change(number: int, monitor: str, *, state: str = "raised") -> tuple[int, str, bytes]:
    return number, monitor, document(number, monitor, state=state).encode()


STEPS = st.lists(
    st.one_of(
        st.sampled_from(MONITORS),
        st.sampled_from(("publish", "lose", "answer", "reconnect", "ask")),
    ),
    max_size=60,
)


class World:
    """A cloud, a gateway and a broker, between which publications are lost."""

    def __init__(self) -> None:
        self.publisher = AlarmPublisher(None)
        self.made: list[tuple[int, str, bytes]] = []
        self.retained: dict[str, bytes] = {}
        self.seen: list[tuple[str, bytes]] = []
        self._sent_back: list[tuple[str, bytes]] = []
        self._delivered, self._now = 0, 0.0

    def take(self, step: str) -> None:
        """One thing happens."""
        if step in MONITORS:
            self.made.append(change(len(self.made) + 1, step))
        else:
            getattr(self, step)()

    def ask(self) -> None:
        """The cloud answers as `find_for_site` does."""
        published = self.publisher.published
        self._delivered = max(self._delivered, published or 0)
        latest = {monitor: number for number, monitor, _ in self.made}
        after = self._delivered if published is None else published
        chosen = {n for n, _, _ in self.made if n > after}
        chosen |= set(latest.values()) if published is None else set()
        self.publisher.give(each for each in self.made if each[0] in chosen)

    def publish(self) -> None:
        self._now += RESEND_S
        for topic, payload, retain in self.publisher.due(self._now):
            assert retain
            self.retained[topic] = payload
            self.seen.append((topic, payload))
            self._sent_back.append((topic, payload))

    def lose(self) -> None:
        self._now += RESEND_S
        self.publisher.due(self._now)

    def answer(self) -> None:
        if self._sent_back:
            self.publisher.confirm(*self._sent_back.pop(0))

    def reconnect(self) -> None:
        self.publisher.restart()
        self._sent_back.clear()


@given(STEPS)
def test_each_change_is_seen_in_order_and_the_last_one_stays(drawn: list[str]) -> None:
    play(drawn)


def test_change_that_was_given_and_not_published_is_given_again() -> None:
    begun = ["squeeze", "ask", "publish", "answer", "ask"]
    play([*begun, "squeeze", "squeeze", "ask", "ask", "reconnect"])
    play([*begun, "squeeze", "squeeze", "ask", "lose", "ask", "reconnect", "squeeze"])


def play(steps: list[str]) -> None:
    """Let things happen, then all be well; check what the broker and its clients have seen."""
    world = World()
    for step in steps:
        world.take(step)
    for _ in range(3 * len(world.made) + 3):
        for step in ("ask", "publish", "answer", "answer"):
            world.take(step)
    assert world.publisher.idle
    assert world.publisher.published == (len(world.made) or None)
    for monitor in MONITORS:
        wanted = [data for _, name, data in world.made if name == monitor]
        got = [data for topic, data in world.seen if topic == alarm_topic(monitor)]
        assert list(dict.fromkeys(got)) == wanted, "each at least once, first in their order"
        assert world.retained.get(alarm_topic(monitor)) == (wanted[-1] if wanted else None)


def test_deleted_monitor_leaves_nothing_at_the_broker() -> None:
    publisher = AlarmPublisher("homeassistant")
    publisher.give([change(1, "squeeze"), change(2, "squeeze", state="deleted")])
    first = publisher.due(0.0)
    publisher.confirm(alarm_topic("squeeze"), first[1][1])
    found = {topic: payload for topic, payload, _ in publisher.due(1.0)}
    assert set(found.values()) == {b""}
    assert len(found) == 2
    publisher.confirm(alarm_topic("squeeze"), b"")
    assert (publisher.published, publisher.idle) == (2, True)


@pytest.mark.usefixtures("gateway")
def test_alarms_reach_clients_retained_and_the_cloud_learns_of_it(
    cloud: StubCloud, broker: Mosquitto, identities: Identities
) -> None:
    cloud.alarms.append((3, "squeeze", document(3, "squeeze")))
    wait_until(lambda: cloud.published == 3, "the cloud knows that it is published")
    client = identities.make(IdentityKind.CLIENT, "client.robot")
    with Listener(client, broker.client_port, alarm_topic("+")) as listener:
        wait_until(lambda: bool(listener.received), "it is retained")
        for number, state in ((4, "cleared"), (5, "raised"), (7, "cleared")):
            cloud.alarms.append((number, "squeeze", document(number, "squeeze", state=state)))
        wait_until(lambda: cloud.published == 7, "the cloud knows of the last one")
        wait_until(lambda: len(listener.received) == 4, "all are heard")
        numbers = [json.loads(payload)["number"] for _, payload, _ in listener.received]
    assert numbers == [3, 4, 5, 7]


def test_home_assistant_reads_a_binary_sensor() -> None:
    publisher = AlarmPublisher("homeassistant")
    publisher.give([change(1, "squeeze-1")])
    (topic, payload, _), _ = publisher.due(0.0)
    states = [document(1, "squeeze-1"), document(2, "squeeze-1", state="cleared")]
    states.append(document(3, "squeeze-1", state="deleted"))
    (found,) = judged(asked(topic, payload, states=[s.encode() for s in states], statuses=[]))
    assert found["component"] == "binary_sensor"
    assert found["device_class"] == "problem"
    assert found["states"] == [True, False, False]
    assert found["attributes"][2] == []
    assert "id" in found["attributes"][0]


def test_gateway_without_alarms_asks_for_them_once(gateway: Gateway, cloud: StubCloud) -> None:
    wait_until(lambda: gateway.command_poller.fault is None, "it has asked")
    assert cloud.published is None
