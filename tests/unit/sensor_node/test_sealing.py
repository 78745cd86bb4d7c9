"""A record as it lies on the chip: it comes back whole, from its own place, or not at all."""

from __future__ import annotations

from eskin_sensor_node.firmware.chip import StoredMessage
from eskin_sensor_node.firmware.message_writer import FRAME
from eskin_sensor_node.machine.flash.sealing import (
    UNREADABLE,
    Cipher,
    Row,
    Sealing,
    lost_record_gap,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.wire.frames import Statements
from tests.unit.sensor_node.flashes import KEY, NODE

SECRET = b"what must stay secret"
LONG = st.integers(-(2**63), 2**63 - 1)
COUNT = st.integers(0, 2**53 - 1)
KEPT = st.builds(
    StoredMessage,
    st.tuples(COUNT, COUNT),
    st.integers(1, 5),
    st.binary(max_size=300),
    st.tuples(LONG, LONG).map(lambda time: (min(time), max(time))),
    COUNT,
    COUNT,
)


def sealing(node: str = NODE, key: bytes = KEY) -> Sealing:
    return Sealing(Cipher(key), node)


def reported(kept: StoredMessage) -> tuple[object, ...]:
    return tuple(getattr(kept, name) for name in StoredMessage.__slots__)


@settings(max_examples=40)
@given(KEPT)
def test_record_comes_back_as_it_was_written(kept: StoredMessage) -> None:
    found = sealing().open(sealing().seal(kept))
    assert found is not None
    assert reported(found) == reported(kept)


@settings(max_examples=40)
@given(KEPT, st.data())
def test_changed_record_never_opens(kept: StoredMessage, data: st.DataObject) -> None:
    row = sealing().seal(kept)
    place = data.draw(st.integers(0, 8 * len(row.body) - 1))
    body = bytearray(row.body)
    body[place // 8] ^= 1 << place % 8
    assert sealing().open(row._replace(body=bytes(body))) is None
    cut = data.draw(st.integers(0, len(row.body) - 1))
    assert sealing().open(row._replace(body=row.body[:cut])) is None


@settings(max_examples=40)
@given(KEPT)
def test_record_opens_in_its_own_place_alone(kept: StoredMessage) -> None:
    row = sealing().seal(kept)
    for moved in (
        row._replace(boot=row.boot + 1),
        row._replace(sequence=row.sequence + 1),
        row._replace(kind=row.kind + 1),
    ):
        assert sealing().open(moved) is None
    assert sealing(node="palm").open(row) is None
    assert sealing(key=bytes(32)).open(row) is None
    # What stands in the clear is not believed.
    other = sealing().open(row._replace(earliest=0, latest=0, samples=1, stands_for=9))
    assert other is not None
    assert reported(other) == reported(kept)


def test_last_ones_are_not_exchanged_for_each_other() -> None:
    sealed = sealing().seal_last("answer", SECRET)
    assert sealing().open_last("answer", sealed) == SECRET
    assert sealing().open_last("charge", sealed) is None
    assert sealing(node="palm").open_last("answer", sealed) is None


@settings(max_examples=40)
@given(LONG, LONG, LONG, LONG)
def test_what_stands_for_a_lost_record_is_a_gap_that_everybody_reads(
    earliest: int, latest: int, samples: int, stands_for: int
) -> None:
    row = Row(3, 7, FRAME, b"", earliest, latest, samples, stands_for)
    stated = Statements.decode(lost_record_gap(row, bytes(range(32))).body)
    (gap,) = stated.gaps
    assert (stated.position, gap.reason, gap.lost) == ((3, 7), UNREADABLE, ((3, 7, 7),))
