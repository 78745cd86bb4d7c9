"""Commands and results come back as they went; what is not allowed is named with what is."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import cbor2
import pycddl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.errors import CommandError, MessageError
from eskin.wire.messages import (
    Command,
    CommandName,
    Mode,
    Outcome,
    Position,
    Result,
    decode_message,
)
from eskin.wire.messages.cbor_map import dump
from eskin.wire.messages.command import RANGES, check_arguments

NAMES = st.from_regex(r"[a-z0-9][a-z0-9_-]{0,30}", fullmatch=True)
CHANNELS = st.from_regex(r"[a-z0-9][a-z0-9_-]{0,30}\.[a-z][a-z0-9_]{0,30}", fullmatch=True)


def number(setting: str) -> st.SearchStrategy[float]:
    return st.floats(RANGES[setting].least, RANGES[setting].most)


OF_TAXELS = {name: number(name) for name in ("gain", "smoothing", "rate")} | {
    "mode": st.sampled_from([str(mode) for mode in Mode])
}
SETS = st.one_of(
    st.fixed_dictionaries({"threshold": number("threshold"), "channel": CHANNELS}),
    st.fixed_dictionaries({}, optional=OF_TAXELS | {"taxel": NAMES}).filter(
        lambda found: bool(found.keys() - {"taxel"})
    ),
)
ORDERS: st.SearchStrategy[Any] = st.one_of(
    st.tuples(st.just(CommandName.SET), SETS),
    st.tuples(st.just(CommandName.CALIBRATE), st.fixed_dictionaries({}, optional={"taxel": NAMES})),
    st.tuples(st.just(CommandName.RESET), st.just({})),
)
COUNTS = st.integers(0, 2**53 - 1)
VALUES = st.floats(allow_nan=False, allow_infinity=False) | st.sampled_from(["peaks", "ü"])
STATES = st.dictionaries(
    st.just("*") | NAMES | CHANNELS,
    st.dictionaries(st.sampled_from(["threshold", "gain", "mode", "rate"]), VALUES),
    max_size=5,
)


def command(name: CommandName, arguments: dict[str, Any], number: int = 7) -> Command:
    return Command(number, "fingertip", 10**18, 10**18 + 5, name, arguments)


@given(order=ORDERS, number=COUNTS.filter(bool))
def test_command_comes_back_equal(order: tuple[CommandName, dict[str, Any]], number: int) -> None:
    sent = command(*order, number)
    assert Command.decode(sent.encode()) == sent
    assert check_arguments(*order) == order[1]


@given(state=STATES, where=COUNTS, what=COUNTS, outcome=st.sampled_from(Outcome))
def test_result_comes_back_equal(
    state: dict[str, dict[str, Any]], where: int, what: int, outcome: Outcome
) -> None:
    reason = None if outcome is Outcome.DONE else "rate: too high"
    said = Result(Position(1, where), (-5, 5), what, outcome, reason, state)
    assert decode_message(said.encode()) == said


@given(data=st.binary(max_size=200))
def test_random_bytes_are_no_command(data: bytes) -> None:
    with pytest.raises(MessageError):
        Command.decode(data)


@given(order=ORDERS, state=STATES, changes=st.lists(st.tuples(COUNTS, st.integers(0, 255))))
def test_mutated_bytes_are_refused_or_mean_what_they_say(
    order: tuple[CommandName, dict[str, Any]],
    state: dict[str, dict[str, Any]],
    changes: list[tuple[int, int]],
) -> None:
    said = Result(Position(1, 2), (1, 2), 3, Outcome.REFUSED, "no", state)
    readers: tuple[tuple[bytes, Any], ...] = (
        (command(*order).encode(), Command.decode),
        (said.encode(), decode_message),
    )
    for good, decode in readers:
        mutated = bytearray(good)
        for at, value in changes:
            mutated[at % len(mutated)] = value
        try:
            back = decode(bytes(mutated))
        except MessageError:
            continue
        assert back.encode() == bytes(mutated)


@pytest.mark.parametrize(
    ("name", "arguments", "says"),
    [
        ("set", {"rate": 2e6}, "rate is 2000000.0; allowed: 0.001 to 1e+06"),
        ("set", {"rate": math.nan}, "rate is nan"),
        ("set", {"rate": True}, "rate is True; allowed: a number"),
        ("set", {"gain": "loud"}, "gain is 'loud'; allowed: a number from 0.001 to 1000"),
        ("set", {"smoothing": 1.0}, "smoothing is 1.0; allowed: 0 to 0.99"),
        ("set", {"mode": "quiet"}, "mode is 'quiet'; allowed: samples, peaks, adaptive"),
        ("set", {"volume": 1.0}, "volume is 1.0; allowed: set takes threshold, gain"),
        ("set", {}, "arguments is {}; allowed: set takes at least one of threshold"),
        ("set", {"taxel": "t01"}, "arguments is {'taxel': 't01'}; allowed: set takes at least one"),
        ("set", {"threshold": 1e-12}, "channel is missing; allowed: the threshold's"),
        ("set", {"threshold": 0.0, "channel": "t01.c"}, "threshold is 0.0"),
        ("set", {"threshold": 1.0, "channel": "t01.c", "rate": 1.0}, "rate is 1.0; allowed: a"),
        ("set", {"threshold": 1.0, "channel": "t01"}, "channel is 't01'; allowed: a channel such"),
        ("set", {"rate": 1.0, "channel": "t01.c"}, "rate is of a taxel"),
        ("set", {"rate": 1.0, "taxel": "T 1"}, "taxel is 'T 1'"),
        ("calibrate", {"rate": 1.0}, "calibrate takes taxel"),
        ("reset", {"taxel": "t01"}, "reset takes nothing"),
        ("monitor", {}, "monitor is missing; allowed: the name of a monitor"),
        ("challenge", {}, "nonce is missing; allowed: 16 bytes"),
        ("set", {"rate": 10**5000}, "rate is a very long int"),
    ],
)
def test_what_is_not_allowed_is_named(name: str, arguments: dict[str, Any], says: str) -> None:
    with pytest.raises(CommandError) as caught:
        check_arguments(CommandName(name), arguments)
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({1: 1}, "expected a command"),
        ({2: 0}, "allowed is 1 to"),
        ({3: "gateway.g1"}, "no name of a node"),
        ({5: 2**63}, "field 5"),
        ({6: "explode"}, "calibrate, set, reset"),
        ({7: {"rate": 5}}, "expected a float"),
        ({7: {"rate": 5e9}}, "allowed: 0.001 to"),
        ({7: {1: 2.0}}, "text keys"),
        ({7: {"smoothing": 0.5, "rate": 5.0}}, "deterministic"),
        ({7: {f"x{i:02d}": 1.0 for i in range(17)}}, "at most 16"),
        ({8: 1}, "field 8 is unknown"),
    ],
)
def test_invalid_command_is_refused(change: dict[int, object], says: str) -> None:
    good = cbor2.loads(command(CommandName.SET, {"rate": 5.0}).encode())
    with pytest.raises(MessageError, match=says):
        Command.decode(dump(good | change))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({6: 3}, "allowed is 0 to 2"),
        ({7: "but why"}, "stands where a command was not done"),
        ({6: 1}, "stands where a command was not done"),
        ({8: {"no place": {}}}, "expected a taxel"),
        ({8: {"t01": 5}}, "text keys"),
        ({8: {"t01": {"rate": math.inf}}}, "finite"),
        ({8: {"t01": {"rate": None}}}, "expected a float"),
        ({9: 1}, "field 9 is unknown"),
    ],
)
def test_invalid_result_is_refused(change: dict[int, object], says: str) -> None:
    good = Result(Position(1, 2), (1, 2), 3, Outcome.DONE, None, {"t01": {"rate": 5.0}})
    with pytest.raises(MessageError, match=says):
        decode_message(dump(cbor2.loads(good.encode()) | change))


RULES = (Path(__file__).parents[3] / "docs" / "eskin.cddl").read_text()
OF_A_COMMAND = pycddl.Schema("start = command\n" + RULES)
OF_A_MESSAGE = pycddl.Schema(RULES)


@settings(max_examples=30)
@given(order=ORDERS, state=STATES)
def test_both_are_as_the_documented_cddl_says(
    order: tuple[CommandName, dict[str, Any]], state: dict[str, dict[str, Any]]
) -> None:
    encoded = command(*order).encode()
    OF_A_COMMAND.validate_cbor(encoded)
    with pytest.raises(pycddl.ValidationError):
        OF_A_COMMAND.validate_cbor(dump(cbor2.loads(encoded) | {77: 1}))
    OF_A_MESSAGE.validate_cbor(
        Result(Position(1, 2), (1, 2), 3, Outcome.DONE, None, state).encode()
    )
