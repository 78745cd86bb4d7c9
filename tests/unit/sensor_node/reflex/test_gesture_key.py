"""A node signs a challenge once its gestures were certain, and counts what was wrong."""

from __future__ import annotations

import base64
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import pytest
from eskin_sensor_node.node.commands import CommandReceiver, NodeControls
from pydantic import ValidationError

from eskin.client import verify_release
from eskin.errors import CommandError, EnvelopeError, FlashError, IdentityError, MonitorError
from eskin.identity.identity import ROOT_FILE
from eskin.wire.envelope import sign
from eskin.wire.frames import Statements
from eskin.wire.messages import ResetCause, Result
from eskin.wire.messages.command import KEY_PLACE
from eskin.wire.topics import Stream, node_topic
from tests.unit.sensor_node.designs import Bench, settings, table
from tests.unit.sensor_node.messages import decode

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from eskin.wire.messages.command import Value
    from tests.support.identities import Identities

TOPIC: Final = node_topic("fingertip", Stream.COMMANDS)
NONCE: Final = "00112233445566778899aabbccddeeff"
OTHER: Final = "ff112233445566778899aabbccddeeff"
GESTURES: Final = {
    "high": "t01.capacitance > 70 pF",
    "low": "t01.capacitance < 20 pF",
    **{f"never{k}": f"t01.capacitance > {200 + k} pF" for k in range(6)},
}
"""The scenario presses and releases twice a second: high, low, high, low."""
RIGHT: Final = ("high", "low", "high", "low", "high")
WRONG: Final = ("high", "low", "high", "low", "never0")


def key_of(given: tuple[str, ...], /, **changes: Any) -> dict[str, Any]:
    return {
        "monitor": [{"name": name, "formula": text} for name, text in GESTURES.items()],
        "gesture_key": {"gestures": list(GESTURES), "sequence": list(given)} | changes,
        "taxel": [table("capacitive", sampling_Hz=100.0)],
    }


class KeyBench(Bench):
    """A node with a gesture key, whose commander stores its state in flash."""

    def __init__(self, folder: Path, identities: Identities, **sections: Any) -> None:
        folder.mkdir(exist_ok=True)
        super().__init__(folder, **sections)
        self.controls = NodeControls(self.node)
        self.commander = CommandReceiver(
            self.outbox,
            own=identities.node,
            cloud="server.cloud",
            controls=self.controls,
            enclosure=lambda: self.clock.known.enclosure(self.clock.ticks()),
        )
        self.commander.start()
        self.node.at_start = self.commander.start
        self.node.gesture_key.sign = partial(sign, own=identities.node, topic=TOPIC)
        self.node.gesture_key.report = self.commander.report
        self.root = identities.node.directory / ROOT_FILE

    def challenge(self, nonce: str = NONCE) -> None:
        self.controls.apply("challenge", {"nonce": nonce})

    @property
    def key(self) -> dict[str, Value]:
        """The place of the key in the state that flash keeps."""
        kept = self.flash.answer()
        assert kept is not None
        return Result.decode(kept).state[KEY_PLACE]


@pytest.fixture
def bench(tmp_path: Path, identities: Identities) -> Iterator[KeyBench]:
    made = KeyBench(tmp_path, identities, **key_of(RIGHT))
    yield made
    made.close()


@pytest.fixture
def wrong(tmp_path: Path, identities: Identities) -> Iterator[KeyBench]:
    made = KeyBench(tmp_path, identities, **key_of(WRONG, attempts=2, lockout_s=30.0))
    yield made
    made.close()


def test_certain_gestures_release_a_signature_over_the_challenge(bench: KeyBench) -> None:
    bench.challenge()
    bench.run_to(1.0)
    assert "signature" not in bench.key
    bench.run_to(4.0)
    key = bench.key
    assert (key["outcome"], key["failures"], key["nonce"]) == ("released", 0.0, NONCE)
    signature = str(key["signature"])
    release = verify_release(signature, node="fingertip", nonce=NONCE, root=bench.root)
    begin, end = (bench.clock.known.enclosure(s * 10**9)[s // 4] for s in (0, 4))
    assert begin < release.time[0] <= release.time[1] < end


def test_a_signature_is_good_for_its_challenge_and_node_alone(bench: KeyBench) -> None:
    bench.challenge()
    bench.run_to(4.0)
    signature = str(bench.key["signature"])
    forged = bytearray(base64.b64decode(signature))
    forged[-1] ^= 1
    for text, node, nonce in (
        (signature, "fingertip", OTHER),
        (signature, "palm", NONCE),
        (base64.b64encode(bytes(forged)).decode(), "fingertip", NONCE),
        ("no base64", "fingertip", NONCE),
    ):
        with pytest.raises((EnvelopeError, IdentityError)):
            verify_release(text, node=node, nonce=nonce, root=bench.root)
    # The next challenge is answered by new gestures alone.
    bench.challenge(OTHER)
    bench.run_to(4.5)
    assert "signature" not in bench.controls.state[KEY_PLACE]
    bench.run_to(8.0)
    signature = str(bench.key["signature"])
    release = verify_release(signature, node="fingertip", nonce=OTHER, root=bench.root)
    assert release.nonce.hex() == OTHER


def test_without_a_challenge_nothing_is_signed_or_counted(bench: KeyBench) -> None:
    bench.run_to(5.0)
    assert bench.controls.state[KEY_PLACE] == {"outcome": "none", "failures": 0.0, "unclear": 0.0}


def test_verdicts_of_its_gestures_are_not_stated(bench: KeyBench) -> None:
    bench.challenge()
    bench.run_to(4.0)
    messages = [decode(body) for body in bench.bodies()]
    assert not [v for one in messages if isinstance(one, Statements) for v in one.verdicts]


def test_wrong_entries_lock_the_node_also_over_a_reset(wrong: KeyBench) -> None:
    wrong.run_to(0.1)
    for failures in (1.0, 2.0):
        wrong.challenge()
        wrong.run_to(4.0 * failures)
        assert (wrong.key["outcome"], wrong.key["failures"]) == ("wrong", failures)
        assert "signature" not in wrong.key
    with pytest.raises(CommandError):
        wrong.challenge()
    wrong.node.machine.reset(ResetCause.BROWN_OUT)
    wrong.run_to(20.0)
    assert wrong.controls.state[KEY_PLACE]["failures"] == 2.0
    with pytest.raises(CommandError):
        wrong.challenge()
    wrong.controls.apply("reset", {})
    with pytest.raises(CommandError):
        wrong.challenge()
    wrong.run_to(40.0)
    wrong.challenge()


def test_an_entry_that_cannot_be_counted_is_not_judged(
    bench: KeyBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.challenge()
    bench.run_to(0.5)

    def fail(*_: object) -> None:
        raise FlashError("worn out")

    with monkeypatch.context() as patched:
        patched.setattr(type(bench.flash), "commit", fail)
        bench.run_to(4.0)
    state = bench.controls.state[KEY_PLACE]
    assert (state["outcome"], state["failures"]) == ("wrong", 1.0)
    assert "signature" not in state


def test_a_key_that_cannot_be_read_releases_nothing_and_sampling_goes_on(bench: KeyBench) -> None:
    def fail(_: bytes) -> bytes:
        raise IdentityError("half written")

    signed, bench.node.gesture_key.sign = bench.node.gesture_key.sign, fail
    bench.challenge()
    bench.run_to(4.0)
    assert (bench.key["outcome"], bench.key["failures"]) == ("wrong", 0.0)
    assert "signature" not in bench.key
    bench.node.gesture_key.sign = signed
    bench.challenge(OTHER)
    bench.run_to(8.0)
    assert bench.key["outcome"] == "released"


def test_commands_do_not_change_its_gestures(bench: KeyBench) -> None:
    before = bench.controls.state
    with pytest.raises(MonitorError):
        bench.controls.apply("monitor", {"monitor": "high", "on": "never"})
    easy: dict[str, Value] = {
        "formula": "t01.capacitance > 1 pF",
        "on": "certain",
        "output": "none",
    }
    with pytest.raises(MonitorError):
        bench.controls.apply("monitor", {"monitor": "high", **easy})
    assert bench.controls.state == before
    bench.controls.restore({"monitor:high": easy})
    assert bench.controls.state["monitor:high"]["formula"] == GESTURES["high"]


def test_a_node_without_a_key_refuses_a_challenge(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    with pytest.raises(CommandError):
        NodeControls(bench.node).apply("challenge", {"nonce": NONCE})
    assert KEY_PLACE not in NodeControls(bench.node).state
    bench.close()


@pytest.mark.parametrize(
    "changes",
    [
        {"sequence": ("high", "high", "low", "high", "low")},
        {"sequence": ("high", "low", "high", "low", "other")},
        {"sequence": ("high", "low", "high", "low")},  # 11.4 bits
        {"gestures": ["high", "high", "low"]},
        {"gestures": [*GESTURES, "unknown"]},
    ],
)
def test_keys_that_are_none_are_refused(tmp_path: Path, changes: dict[str, Any]) -> None:
    settings(tmp_path, **key_of(RIGHT))
    with pytest.raises(ValidationError):
        settings(tmp_path, **key_of(RIGHT, **changes))


def test_a_fleet_has_no_key(tmp_path: Path) -> None:
    with pytest.raises(ValidationError):
        settings(tmp_path, fleet={"count": 3}, **key_of(RIGHT))
