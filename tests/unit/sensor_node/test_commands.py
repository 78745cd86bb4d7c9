"""Commands at the node: from the cloud only, once, in time, answered; also over a restart."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import pytest
from eskin_sensor_node.firmware.gap_reasons import OVERRUN
from eskin_sensor_node.machine.flash.flash import Flash
from eskin_sensor_node.node.commands import CommandReceiver
from eskin_sensor_node.node.factory import build_outbox
from eskin_sensor_node.settings import BrokerSection
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eskin.errors import FlashError
from eskin.identity import IdentityKind
from eskin.wire.envelope import sign
from eskin.wire.messages import Command, CommandName, Kind, Outcome, Result
from eskin.wire.topics import Stream, node_topic
from tests.unit.sensor_node.controls import SimpleControls
from tests.unit.sensor_node.designs import waiting
from tests.unit.sensor_node.flashes import open_flash
from tests.unit.sensor_node.stores import DESCRIBED

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from eskin.identity import Identity
    from eskin.wire.messages.command import Arguments
    from tests.support.identities import Identities

TOPIC = node_topic("fingertip", Stream.COMMANDS)
HOUR = 3600 * 10**9


class Rig:
    """A node's flash and commander, and the cloud that commands it."""

    def __init__(self, folder: Path, identities: Identities, server: Identity, now: int) -> None:
        self.path = folder / "flash.sqlite"
        self.identities = identities
        self.server = server
        self.now = now
        self.begin()

    def begin(self) -> None:
        """Switch the node on."""
        self.flash = open_flash(self.path, epoch=None)
        self.outbox = build_outbox(
            self.flash, capacity=10**6, broker=BrokerSection(), described=DESCRIBED
        )
        self.controls = SimpleControls()
        self.commander = CommandReceiver(
            self.outbox,
            own=self.identities.node,
            cloud="server.cloud",
            controls=self.controls,
            enclosure=lambda: (self.now - 1000, self.now + 1000),
        )
        self.commander.start()

    def restart(self) -> None:
        """Switch it off and on."""
        self.flash.close()
        self.begin()

    def signed(
        self,
        number: int,
        arguments: Arguments,
        *,
        name: CommandName = CommandName.SET,
        node: str = "fingertip",
        lifetime: int = HOUR,
        own: Identity | None = None,
        topic: str = TOPIC,
    ) -> bytes:
        """A command as it comes out of the gateway's envelope."""
        command = Command(number, node, self.now, self.now + lifetime, name, arguments)
        return sign(command.encode(), own=own or self.server, topic=topic)

    def results(self) -> list[Result]:
        """All results that wait in flash."""
        return [Result.decode(k.body) for k in waiting(self.flash) if k.kind == Kind.RESULT]


@pytest.fixture(scope="module")
def server(identities: Identities) -> Identity:
    return identities.make(IdentityKind.SERVER, "server.cloud")


@pytest.fixture
def rig(tmp_path: Path, identities: Identities, server: Identity) -> Iterator[Rig]:
    made = Rig(tmp_path, identities, server, time.time_ns())
    yield made
    made.flash.close()


def test_command_is_done_and_answered(rig: Rig) -> None:
    rig.commander.take(rig.signed(7, {"rate": 50.0}))
    assert rig.controls.calls == [("set", {"rate": 50.0})]
    first, second = rig.results()
    assert (first.command, first.outcome, first.state["t01"]) == (0, Outcome.DONE, {"rate": 100.0})
    assert (second.command, second.outcome, second.reason) == (7, Outcome.DONE, None)
    assert second.state == {"t01": {"rate": 50.0}, "t02": {"rate": 50.0}}
    assert second.time == (rig.now - 1000, rig.now + 1000)


def test_command_has_one_effect_however_often_it_comes_and_over_restarts(rig: Rig) -> None:
    calibrate = rig.signed(7, {"taxel": "t01"}, name=CommandName.CALIBRATE)
    for _ in range(3):
        rig.commander.take(calibrate)
        rig.commander.take(rig.signed(6, {"rate": 9.0}))
    assert len(rig.controls.calls) == 1
    rig.restart()
    rig.commander.take(calibrate)
    assert rig.controls.calls == []
    assert rig.controls.state["t01"] == {"rate": 100.0, "baselines": 1.0}
    # At its start the node states its last result again, and how it is set.
    assert [(r.command, r.state["t01"].get("baselines")) for r in rig.results()] == [
        (0, None),
        (7, 1.0),
        (7, 1.0),
    ]
    rig.commander.take(rig.signed(8, {}, name=CommandName.RESET))
    assert rig.results()[-1].state["t01"] == {"rate": 100.0}


def test_last_command_is_known_after_its_result_was_acknowledged(rig: Rig) -> None:
    rig.commander.take(rig.signed(7, {"rate": 5e3}))
    rig.outbox.acknowledge([(rig.flash.boot, 0, 10)])
    assert rig.outbox.messages == 0
    rig.restart()
    (again,) = rig.results()
    assert (again.command, again.outcome) == (7, Outcome.REFUSED)
    assert again.reason == r"rate is 5000.0; allowed: at most 1000\nat this taxel"


def test_refused_value_changes_nothing_and_has_a_reason(rig: Rig) -> None:
    rig.commander.take(rig.signed(7, {"rate": 5e3}))
    stated = rig.results()[-1]
    assert (stated.outcome, stated.state["t01"]) == (Outcome.REFUSED, {"rate": 100.0})
    rig.commander.take(rig.signed(7, {"rate": 5e3}))
    assert len(rig.controls.calls) == 1


def test_argument_that_is_not_allowed_is_refused_by_name(rig: Rig) -> None:
    asked = Command(7, "fingertip", rig.now, rig.now + HOUR, CommandName.SET, {"colour": "red"})
    rig.commander.take(sign(asked.encode(), own=rig.server, topic=TOPIC))
    stated = rig.results()[-1]
    assert (stated.command, stated.outcome) == (7, Outcome.REFUSED)
    assert stated.reason is not None
    assert stated.reason.startswith("colour is 'red'; allowed: set takes threshold, gain")
    assert rig.controls.calls == []


@pytest.mark.parametrize(
    ("lifetime", "outcome"),
    [(1001, Outcome.DONE), (1000, Outcome.EXPIRED), (-1000, Outcome.EXPIRED)],
)
def test_command_that_may_have_expired_is_not_done(
    rig: Rig, lifetime: int, outcome: Outcome
) -> None:
    rig.commander.take(rig.signed(7, {"rate": 5.0}, lifetime=lifetime))
    stated = rig.results()[-1]
    assert stated.outcome is outcome
    assert len(rig.controls.calls) == (outcome is Outcome.DONE)
    assert (stated.reason is None) is (outcome is Outcome.DONE)
    if stated.reason is not None:
        late = "0.000000000" if lifetime == 1000 else "0.000002000"
        assert stated.reason == f"it may have come {late} s too late"


def test_other_signers_are_refused(
    rig: Rig, identities: Identities, caplog: pytest.LogCaptureFixture
) -> None:
    arguments: Arguments = {"rate": 5.0}
    palm = node_topic("palm", Stream.COMMANDS)
    broker = identities.make(IdentityKind.SERVER, "server.broker")
    mutant = bytearray(rig.signed(7, arguments))
    mutant[-1] ^= 1
    forged = {
        "wrong": rig.signed(7, arguments, topic=palm),
        "it is for palm": rig.signed(7, arguments, node="palm"),
        "only 'server.cloud' may sign here": rig.signed(7, arguments, own=broker),
        "is a site, not a server": rig.signed(7, arguments, own=identities.site),
        "signature of": bytes(mutant),
        "no CBOR": b"",
        "no CBOR map": sign(b"\x01", own=rig.server, topic=TOPIC),
    }
    for says, signed in forged.items():
        caplog.clear()
        rig.commander.take(signed)
        assert says in caplog.text
    assert rig.controls.calls == []
    assert len(rig.results()) == 1


def test_signer_s_certificate_is_judged_by_the_node_s_own_clock(
    rig: Rig, caplog: pytest.LogCaptureFixture
) -> None:
    signed = rig.signed(7, {"rate": 5.0}, lifetime=24 * 365 * HOUR)
    rig.now += 24 * 100 * HOUR
    rig.commander.take(signed)
    assert "is valid from" in caplog.text
    rig.now = 2**63 - 2000
    rig.commander.take(signed)
    assert rig.controls.calls == []


def test_result_that_found_no_room_is_written_later_and_the_effect_is_one(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any) -> None:
        raise FlashError("disk full")

    calibrate = rig.signed(7, {}, name=CommandName.CALIBRATE)
    with monkeypatch.context() as patch:
        patch.setattr(rig.flash, "commit", fail)
        for _ in range(2):
            with pytest.raises(FlashError):
                rig.commander.take(calibrate)
    assert len(rig.results()) == 1
    rig.commander.take(calibrate)
    rig.commander.take(calibrate)
    assert len(rig.controls.calls) == 1
    assert [stated.command for stated in rig.results()] == [0, 7]


def test_power_cut_before_the_commit_undoes_the_effect(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    def cut(*_: Any) -> None:
        raise KeyboardInterrupt

    calibrate = rig.signed(7, {"taxel": "t01"}, name=CommandName.CALIBRATE)
    with monkeypatch.context() as patch:
        patch.setattr(rig.flash, "commit", cut)
        with pytest.raises(KeyboardInterrupt):
            rig.commander.take(calibrate)
    rig.restart()
    assert rig.controls.state["t01"] == {"rate": 100.0}
    rig.commander.take(calibrate)
    assert rig.controls.state["t01"] == {"rate": 100.0, "baselines": 1.0}


def test_full_disk_at_the_start_does_not_keep_the_node_from_living(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(*_: Any) -> None:
        raise FlashError("disk full")

    rig.flash.close()
    with monkeypatch.context() as patch:
        patch.setattr(Flash, "commit", fail)
        rig.begin()
    assert "state not reported yet" in caplog.text
    rig.commander.take(rig.signed(7, {"rate": 5.0}))
    assert rig.results()[-1].command == 7


def test_result_gives_way_last_in_a_full_flash(rig: Rig) -> None:
    rig.commander.take(rig.signed(7, {"rate": 5.0}))
    results = rig.results()
    # Room for them, and for the gap that states what gave way.
    rig.outbox.capacity = 2048 + sum(len(stated.encode()) for stated in results)
    with rig.outbox.batch() as batch:
        batch.take(rig.outbox.message_writer.gap(OVERRUN, (0, 1), 1) for _ in range(100))
    kinds = [kept.kind for kept in waiting(rig.flash)]
    assert kinds == [Kind.RESULT, Kind.RESULT, Kind.STATEMENTS]
    assert rig.results() == results


COMING = st.lists(st.sampled_from(["cut", 1, 2, 3, 4, 5]), max_size=12)


@settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
@given(coming=COMING)
def test_any_order_and_restarts_leave_each_command_one_effect_at_most(
    tmp_path_factory: pytest.TempPathFactory,
    identities: Identities,
    server: Identity,
    coming: list[Any],
) -> None:
    rig = Rig(tmp_path_factory.mktemp("node"), identities, server, time.time_ns())
    last = 0
    expected = 0.0
    for event in coming:
        if event == "cut":
            rig.restart()
            continue
        rig.commander.take(rig.signed(event, {"taxel": "t01"}, name=CommandName.CALIBRATE))
        if event > last:
            last, expected = event, expected + 1.0
    assert rig.controls.state["t01"].get("baselines", 0.0) == expected
    assert rig.results()[-1].command == last
    rig.flash.close()
