"""The store: each message once, in any order, all or nothing."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from random import Random
from typing import TYPE_CHECKING, Any

import cbor2
import pytest
from eskin_cloud.store import Store
from eskin_cloud.store.damage import RowHeader
from eskin_cloud.store.schema.tables import blocks, channels, dead_letters, events, nodes, sequences
from eskin_cloud.store.schema.tile_tables import stale_chunks
from eskin_cloud.store.write.parsed_message import ParsedMessage
from eskin_cloud.store.write.presence import mark_silent_offline
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import event, select, update

from eskin.runtime.digest import digest
from eskin.wire.messages import ResetCause
from eskin.wire.sequence_set import SequenceRanges
from eskin.wire.timestamp import SECOND
from tests.unit.cloud.clouds import Clock, emptied, put, put_items
from tests.unit.cloud.messages import CHANNEL, NODE, START, gap, lying, peak, status, stretch

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin_cloud.store.location import StoreLocation
    from sqlalchemy import Connection, Table


def rows(store: Store, table: Table) -> list[dict[str, Any]]:
    """All rows of a table."""
    with store.read() as connection:
        return [dict(row) for row in connection.execute(select(table)).mappings()]


def results(outcome: Any) -> list[str]:
    """What became of each item."""
    return [result.result for result in outcome.results]


def test_blocks_are_kept_byte_for_byte(store: Store) -> None:
    said = stretch(5, [1.0, 2.0], [3.0, 4.0], boot=2, time=(START, START + 3), coverage=0.5)
    put(store, said)
    (row,) = rows(store, blocks)
    assert row == {
        "node": NODE,
        "boot": 2,
        "sequence": 5,
        "cursor": 1,
        "channel": CHANNEL,
        "t": START + 1,
        "t_end": START + 1 + 1_000_000,
        "error": 2,
        "t_lo": START,
        "t_hi": START + 3,
        "dt": 1_000_000,
        "n": 2,
        "lo": 1.0,
        "hi": 4.0,
        "coverage": 0.5,
        "received": START,
        "data": said.encode(),
        "digest": digest(said.encode()),
        "packed": None,
        "head": RowHeader.of(row).checksum(),
    }


@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    batches=st.lists(
        st.lists(st.tuples(st.integers(1, 2), st.integers(0, 12)), max_size=8), max_size=6
    ),
    reopen=st.booleans(),
)
def test_each_message_is_stored_once_in_any_order_also_after_reopening(
    place: StoreLocation,
    batches: list[list[tuple[int, int]]],
    reopen: bool,  # noqa: FBT001 - drawn by hypothesis
) -> None:
    seen: set[tuple[int, int]] = set()
    with ExitStack() as stack:
        store = emptied(stack.enter_context(Store(place)))
        for keys in batches:
            if reopen:
                stack.close()
                store = stack.enter_context(Store(place))
            outcome = put(store, *(stretch(sequence, boot=boot) for boot, sequence in keys))
            for key, result in zip(keys, results(outcome), strict=True):
                assert result == ("duplicate" if key in seen else "stored")
                seen.add(key)
        assert {(row["boot"], row["sequence"]) for row in rows(store, blocks)} == seen
        for boot in (1, 2):
            expected = SequenceRanges((s, s) for b, s in seen if b == boot)
            kept = [(r["first"], r["last"]) for r in rows(store, sequences) if r["boot"] == boot]
            assert sorted(kept) == list(expected)
        cursors = sorted(row["cursor"] for row in rows(store, blocks))
        assert cursors == list(range(1, len(seen) + 1))


@pytest.mark.parametrize("seed", range(4))
def test_batch_leaves_what_its_messages_leave_one_by_one(seed: int, place: StoreLocation) -> None:
    """Any sequence of nodes, boots, channels, units and times."""
    items = list(drawn_items(Random(seed)))  # noqa: S311 - no secret
    assert left_by(place, [items]) == left_by(place, [[item] for item in items])


def drawn_items(draw: Random) -> Iterator[ParsedMessage]:
    """Blocks, some of them twice, late or of another unit, and a few statuses."""
    for _ in range(40):
        node, boot, sequence = draw.choice(["n1", "n2"]), draw.randint(1, 2), draw.randint(0, 15)
        time = START + draw.randint(-3, 20) * SECOND
        made = stretch(
            sequence,
            [draw.random(), 1.0],
            [30.0, 40.0 + draw.random()],
            boot=boot,
            time=(time, time + sequence),
            dt=draw.choice([1_000_000, 2_000_000]),
            channel=draw.choice(["t01.a", "t02.b", "t03.c"]),
            unit=draw.choice("FFFH"),
            coverage=draw.random(),
        )
        yield ParsedMessage.parse(node, made.encode())
        if draw.random() < 0.2:
            yield ParsedMessage.parse(node, status(sequence + 20, boot=boot).encode())


def left_by(place: StoreLocation, batches: list[list[ParsedMessage]]) -> list[Any]:
    """The results of batches, and the rows after them, partly built and compacted."""
    late = {"built": START + 5 * SECOND, "packed": START + 4 * SECOND}
    with Store(place, clock=Clock(START + 3600 * SECOND)) as store:
        emptied(store)
        for node in ("n1", "n2"):
            put(store, stretch(99, channel="t01.a"), node=node)
        store.write(lambda connection: connection.execute(update(channels), late)).result()
        store.cache.clear()
        told = [result for each in batches for result in put_items(store, each).results]
        tables = (blocks, nodes, channels, events, sequences, dead_letters, stale_chunks)
        kept = [[row | {"mark": None} for row in rows(store, table)] for table in tables]
        return [told, *(sorted(map(repr, each)) for each in kept)]


def test_invalid_message_becomes_a_dead_letter_alone(store: Store) -> None:
    items = [
        ParsedMessage.parse(NODE, stretch(0).encode()),
        ParsedMessage.parse(NODE, b"\xff\x00poison"),
        ParsedMessage.parse("No Such Name", stretch(1).encode()),
        ParsedMessage.parse("nul\x00", stretch(1).encode()),
        ParsedMessage.parse(NODE, stretch(1, unit="H").encode()),
        ParsedMessage.parse(
            NODE, stretch(2, time=(2**63 - 5, 2**63 - 1), lo=[1, 1], hi=[1, 1]).encode()
        ),
        ParsedMessage.parse(NODE, peak(3, unit="H").encode()),
        ParsedMessage.parse(NODE, status(4, unit="H").encode()),
        ParsedMessage.parse(NODE, lying(stretch(6, [1.0, 2.0], [3.0, 4.0]))),
        ParsedMessage.parse(NODE, stretch(5).encode()),
    ]
    outcome = put_items(store, items)
    assert results(outcome) == ["stored", *["rejected"] * 8, "stored"]
    letters = rows(store, dead_letters)
    assert {letter["data"] for letter in letters} == {item.data for item in items[1:-1]}
    reasons = {letter["data"]: letter["reason"] for letter in letters}
    assert "keeps its unit" in reasons[items[4].data]
    assert "2262" in reasons[items[5].data]
    assert "hull" in reasons[items[8].data]
    assert all(result.reason for result in outcome.results[1:-1])


def test_dead_letters_are_unique_and_bounded(store: Store, clock: Clock) -> None:
    for number in range(5):
        clock.turn(1)
        poison = [ParsedMessage.parse(NODE, cbor2.dumps({4: "t01.a", 5: number}))] * 2
        outcome = put_items(store, poison, dead_letters=3)
    assert outcome.dropped == 1
    assert sorted(row["data"] for row in rows(store, dead_letters)) == [
        cbor2.dumps({4: "t01.a", 5: number}) for number in (2, 3, 4)
    ]


def test_dead_letter_without_data_states_its_size(store: Store) -> None:
    for size in (5, 6, 6):
        put_items(store, [ParsedMessage.parse(NODE, b"\xff" * size)])
    letters = rows(store, dead_letters)
    assert {letter["data"] for letter in letters} == {b""}
    reasons = " ".join(letter["reason"] for letter in letters)
    assert [reasons.count(f"{size} bytes") for size in (5, 6)] == [1, 1]


def test_later_unit_in_the_same_batch_is_rejected(store: Store) -> None:
    assert results(put(store, stretch(0), stretch(1, unit="H"), stretch(2))) == [
        "stored",
        "rejected",
        "stored",
    ]


def test_new_boot_is_an_event_and_a_late_status_changes_nothing(store: Store) -> None:
    put(store, status(0, boot=2), status(1, boot=2), status(9, boot=1))
    assert [row["detail"] for row in rows(store, events)] == ["started: boot 2, fingertip"]
    (node,) = rows(store, nodes)
    assert (node["status_boot"], node["status_sequence"]) == (2, 1)
    assert (node["boot"], node["sequence"]) == (2, 1)


def test_new_boot_states_its_cause(store: Store) -> None:
    put(store, replace(status(0, boot=2), cause=ResetCause.BROWN_OUT))
    assert [row["detail"] for row in rows(store, events)] == [
        "started: boot 2, fingertip, brown-out"
    ]


def test_silence_and_return_are_events(store: Store, clock: Clock) -> None:
    put(store, stretch(0))
    clock.turn(20)

    def judge(connection: Connection) -> int:
        return len(
            mark_silent_offline(connection, store.cache, silent_since=START + 1, now=clock())
        )

    assert store.write(judge).result(120) == 1
    assert store.write(judge).result(120) == 0
    put(store, stretch(1))
    told = rows(store, events)
    assert [(row["kind"], row["detail"]) for row in told] == [
        ("status", "offline"),
        ("status", "online again"),
    ]
    assert told[0]["t_lo"] == START


def test_clock_of_another_cloud_marks_no_node_silent(store: Store, clock: Clock) -> None:
    put(store, stretch(0))

    def judge(connection: Connection) -> int:
        silent_since = clock() - 15 * SECOND
        return len(
            mark_silent_offline(connection, store.cache, silent_since=silent_since, now=clock())
        )

    clock.turn(-0.05)
    assert store.write(judge).result(120) == 0
    clock.turn(-3600)  # set back: that it was heard then says nothing of now
    assert store.write(judge).result(120) == 1


def test_gap_and_peak_are_events(store: Store) -> None:
    put(store, gap(0), peak(1))
    first, second = rows(store, events)
    assert first["detail"] == "flash full: 3 messages and 1500 samples lost"
    assert second["height_hi"] == float("inf")
    assert second["data"] == peak(1).encode()


def test_batch_of_many_nodes_needs_few_queries(store: Store) -> None:
    items = [
        ParsedMessage.parse(f"node{number}", said.encode())
        for number in range(100)
        for said in (status(0), stretch(1), peak(2))
    ]
    asked: list[str] = []
    store.cache.clear()
    event.listen(
        store._writing, "before_cursor_execute", lambda *words: asked.append(str(words[2]))
    )
    assert results(put_items(store, items)) == ["stored"] * 300
    store.cache.clear()  # as after another process wrote
    assert results(put_items(store, items)) == ["duplicate"] * 300
    assert len(asked) < 50, asked
