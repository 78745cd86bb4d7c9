"""Public JSON encloses the node's values in exact numbers."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import orjson
import pytest
from eskin_gateway.publish import public_payloads
from eskin_gateway.publish.presence import Presence
from hypothesis import given
from hypothesis import strategies as st

from eskin.interval import Interval, Verdict
from eskin.tube import Tube
from eskin.wire.messages import (
    Block,
    BlockSummary,
    Encoding,
    Position,
    TaxelFaults,
    decode_summary,
)
from eskin.wire.timestamp import parse_timestamp
from tests.unit.eskin.senml import read_senml
from tests.unit.gateway.messages import EPOCH, gap, peak, status

if TYPE_CHECKING:
    from eskin.wire.messages import Gap, Peak

_EVENT = {
    "id", "node", "channel", "kind", "verdict", "time", "height", "prominence", "count", "unit",
    "coverage", "boot", "sequence", "detail",
}  # fmt: skip


def summary(packed: Block) -> BlockSummary:
    said = decode_summary(packed.encode())
    assert isinstance(said, BlockSummary)
    return said


@given(
    lo=st.floats(-1e300, 1e300),
    width=st.floats(0, 1e300),
    early=st.integers(0, 10**6),
    n=st.integers(1, 50),
)
def test_hull_and_times_enclose_the_block(lo: float, width: float, early: int, n: int) -> None:
    values = Interval(np.full(n, lo), np.full(n, lo + width))
    tube = Tube((EPOCH, EPOCH + early), 1_000_003, values, "F", 1.0)
    packed = Block.pack(Position(1, 2), "t01.capacitance", 0, tube, Encoding.F64)
    topic, body = public_payloads.live("fingertip", summary(packed))
    said = orjson.loads(body)
    assert topic == "eskin/v1/live/fingertip/t01.capacitance"
    assert (said["lo"], said["hi"]) == packed.bounds
    assert parse_timestamp(said["t0"]) == EPOCH
    assert parse_timestamp(said["t1"]) == EPOCH + early + (n - 1) * 1_000_003
    assert (said["unit"], said["n"], said["coverage"]) == ("F", n, 1.0)


def test_status_lists_faulty_taxels() -> None:
    told = replace(status(1), faults=(TaxelFaults("t05", Verdict.IMPOSSIBLE, Verdict.CERTAIN),))
    said = orjson.loads(public_payloads.status("n", told, online=True)[1])
    assert said["faults"] == [{"taxel": "t05", "dead": "impossible", "stuck": "certain"}]
    assert "faults" not in orjson.loads(public_payloads.status("n", status(1), online=True)[1])


def test_unbounded_side_is_null() -> None:
    values = Interval([1.0, 2.0], [3.0, np.inf])
    tube = Tube((EPOCH, EPOCH), 1, values, "F", 1.0)
    packed = Block.pack(Position(1, 2), "t01.capacitance", 0, tube, Encoding.F64)
    said = orjson.loads(public_payloads.live("n", summary(packed))[1])
    assert (said["lo"], said["hi"]) == (1.0, None)


def test_senml_holds_the_hull_and_for_how_long() -> None:
    values = Interval([1.0, 2.0], [3.0, 4.0])
    packed = Block.pack(
        Position(1, 2), "t01.capacitance", 0, Tube((EPOCH, EPOCH + 7), 3, values, "F", 1.0),
        Encoding.F64,
    )  # fmt: skip
    ((topic, body),) = public_payloads.live_senml("n", summary(packed))
    assert topic == "eskin/v1/senml/n/t01.capacitance"
    told = [("coverage", 1.0), ("span", 1e-8), ("lo", 1.0), ("hi", 4.0)]
    assert read_senml(body.decode(), "n/t01.capacitance/") == told
    assert orjson.loads(body)[0]["bt"] * 10**9 == EPOCH


def test_senml_omits_times_that_it_reads_as_relative() -> None:
    packed = Block.pack(
        Position(1, 2), "t01.capacitance", 0, Tube((9, 9), 3, Interval([1.0], [2.0]), "F", 1.0),
        Encoding.F64,
    )  # fmt: skip
    assert list(public_payloads.live_senml("n", summary(packed))) == []


@pytest.mark.parametrize("message", [peak(4), gap(4)])
def test_event_has_the_fields_of_rest(message: Peak | Gap) -> None:
    topic, body = public_payloads.event("fingertip", message)
    said = orjson.loads(body)
    assert topic == "eskin/v1/live/fingertip/events"
    assert set(said) == _EVENT
    assert said["id"] == "fingertip/1/4"


def test_gap_states_what_was_lost() -> None:
    said = orjson.loads(public_payloads.event("n", gap(4))[1])
    assert said["detail"] == "flash full: 2 messages and 200 samples lost"


def test_presence_publishes_changes_and_every_status() -> None:
    presence = Presence(10.0)

    def said(*messages: tuple[str, bytes, bool]) -> list[bool]:
        assert all(kept for _, _, kept in messages)
        return [orjson.loads(body)["online"] for _, body, _ in messages]

    assert said(*presence.update("n", None, live=True, now=0.0)) == []
    assert said(*presence.update("n", status(1), live=True, now=1.0)) == [True]
    assert said(*presence.update("n", None, live=True, now=2.0)) == []
    assert said(*presence.expire(11.9)) == []
    assert presence.online == 1
    assert said(*presence.expire(12.0)) == [False]
    assert said(*presence.expire(13.0)) == []
    assert said(*presence.update("n", status(2), live=False, now=14.0)) == [False]
    assert said(*presence.update("n", None, live=True, now=15.0)) == [True]
