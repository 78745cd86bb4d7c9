"""The store: each message once, in any order, all or nothing."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from dataclasses import replace
from random import Random
from typing import TYPE_CHECKING, Any

import pytest
from eskin_cloud.store import Store
from eskin_cloud.store.schema.frame_tables import frames, pages, stale_patch_chunks
from eskin_cloud.store.schema.tables import dead_letters, events, nodes, sequences
from eskin_cloud.store.write.parsed_message import ParsedMessage
from eskin_cloud.store.write.presence import find_silent, mark_silent_offline
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import Engine, event, select, update

from eskin.wire.messages import ResetCause
from eskin.wire.sequence_set import SequenceRanges
from eskin.wire.timestamp import SECOND
from tests.support.examples import examples
from tests.unit.cloud.clouds import Clock, emptied, numbers, put, put_items
from tests.unit.cloud.messages import NODE, START, gap, lying, peak, skin_of, status, stretch
from tests.unit.cloud.skins import bring_all, describe

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin_cloud.store.location import StoreLocation
    from eskin_cloud.store.write.write_cache import WriteCache
    from sqlalchemy import Connection, Table

    from tests.unit.cloud.clouds import Said


def rows(store: Store, table: Table) -> list[dict[str, Any]]:
    """All rows of a table."""
    with store.read() as connection:
        return [dict(row) for row in connection.execute(select(table)).mappings()]


def results(outcome: Any) -> list[str]:
    """What became of each item."""
    return [result.result for result in outcome.results]


@settings(
    max_examples=examples(25),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
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
        assert {(row["boot"], row["sequence"]) for row in rows(store, frames)} == seen
        for boot in (1, 2):
            expected = SequenceRanges((s, s) for b, s in seen if b == boot)
            kept = [(r["first"], r["last"]) for r in rows(store, sequences) if r["boot"] == boot]
            assert sorted(kept) == list(expected)
        cursors = sorted(row["cursor"] for row in rows(store, frames))
        assert numbers(cursors) == list(range(1, len(seen) + 1))


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(n, marks=pytest.mark.nightly) for n in range(1, 4))]
)
def test_batch_leaves_what_its_messages_leave_one_by_one(seed: int, place: StoreLocation) -> None:
    """Any sequence of nodes, boots, channels, units and times."""
    items = list(drawn_items(Random(seed)))  # noqa: S311 - no secret
    assert left_by(place, [items]) == left_by(place, [[item] for item in items])


def drawn_items(draw: Random) -> Iterator[ParsedMessage]:
    """Frames, some of them twice, late or of another unit, and a few statuses."""
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
    """The results of batches, and the rows after them, partly compacted."""
    late = {"compacted": START + 4 * SECOND}
    with Store(place, clock=Clock(START + 3600 * SECOND)) as store:
        emptied(store)
        for node in ("n1", "n2"):
            put(store, stretch(99, channel="t01.a"), node=node)
        store.write(lambda connection: connection.execute(update(pages), late)).result()
        store.clear_caches()
        results = [result for each in batches for result in put_items(store, each).results]
        tables = (frames, nodes, pages, events, sequences, dead_letters, stale_patch_chunks)
        kept = [[row | {"mark": None} for row in rows(store, table)] for table in tables]
        return [results, *(sorted(map(repr, each)) for each in kept)]


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
        ParsedMessage.parse(NODE, replace(stretch(4), page=1).encode()),
        ParsedMessage.parse(NODE, lying(stretch(6, [1.0, 2.0], [3.0, 4.0]))),
        ParsedMessage.parse(NODE, stretch(5).encode()),
    ]
    outcome = put_items(store, items)
    assert results(outcome) == ["stored", *["rejected"] * 8, "stored"]
    letters = rows(store, dead_letters)
    # The cloud keeps the bytes of a dead letter only if no person can be their subject.
    assert {letter["data"] for letter in letters} == {b"", items[5].data, items[7].data}
    reasons = [str(result.reason) for result in outcome.results]
    assert "keeps its unit" in reasons[4]
    assert "2262" in reasons[5]
    assert all(result.reason for result in outcome.results[1:-1])


def test_dead_letters_are_unique_and_bounded(store: Store, clock: Clock) -> None:
    for number in range(5):
        clock.turn(1)
        poison = [ParsedMessage.parse(NODE, replace(stretch(number), page=1).encode())] * 2
        outcome = put_items(store, poison, dead_letters=3)
    assert outcome.dropped == 1
    assert sorted(row["data"] for row in rows(store, dead_letters)) == [
        replace(stretch(number), page=1).encode() for number in (2, 3, 4)
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

    def judge(connection: Connection, cache: WriteCache) -> int:
        silent = mark_silent_offline(connection, cache, [NODE], silent_since=START + 1, now=clock())
        return len(silent)

    assert store.write_node(NODE, judge).result(120) == 1
    assert store.write_node(NODE, judge).result(120) == 0
    put(store, stretch(1))
    stored = rows(store, events)
    assert [(row["kind"], row["detail"]) for row in stored] == [
        ("status", "offline"),
        ("status", "online again"),
    ]
    assert stored[0]["t_lo"] == START


def test_clock_of_another_cloud_marks_no_node_silent(store: Store, clock: Clock) -> None:
    put(store, stretch(0))

    def judge(connection: Connection, cache: WriteCache) -> int:
        since = clock() - 15 * SECOND
        found = find_silent(connection, silent_since=since, now=clock())
        assert mark_silent_offline(
            connection, cache, [NODE], silent_since=since, now=clock()
        ) == [] or found == [NODE]
        return len(found)

    clock.turn(-0.05)
    assert store.write_node(NODE, judge).result(120) == 0
    clock.turn(-3600)  # set back: that it was heard then says nothing of now
    assert store.write_node(NODE, judge).result(120) == 1


def test_gap_and_peak_are_events(store: Store) -> None:
    put(store, gap(0), peak(1))
    first, second = rows(store, events)
    assert first["detail"] == "flash full: 3 messages and 1500 samples lost"
    assert second["height_hi"] == float("inf")
    assert second["data"] == peak(1).encode()


@contextmanager
def statements() -> Iterator[list[str]]:
    """The statements that writers execute meanwhile."""
    asked: list[str] = []

    def look(*words: object) -> None:
        asked.append(str(words[2]))

    event.listen(Engine, "before_cursor_execute", look)
    try:
        yield asked
    finally:
        event.remove(Engine, "before_cursor_execute", look)


def transactions(asked: list[str]) -> int:
    """How many transactions there were: each locks its slots."""
    return sum("FROM feed" in each for each in asked)


def test_batch_of_many_nodes_needs_few_queries(store: Store) -> None:
    channels = {f"node{number}": f"t{number % 50}.capacitance" for number in range(100)}
    for node, channel in channels.items():
        describe(store, *skin_of(channel), node=node)

    def batch(begin: int) -> list[tuple[str, Said]]:
        return [
            (node, each)
            for node, channel in channels.items()
            for each in (
                status(begin),
                stretch(begin + 1, channel=channel),
                peak(begin + 2, channel=channel),
            )
        ]

    first, more, last = batch(0), batch(3), batch(6)
    with statements() as asked:  # nothing of these layouts is decoded yet
        assert results(bring_all(store, *first)) == ["stored"] * 300
    assert len(asked) < 20 * transactions(asked), asked
    with statements() as asked:
        assert results(bring_all(store, *more)) == ["stored"] * 300
        assert results(bring_all(store, *first, *more)) == ["duplicate"] * 600
    assert len(asked) < 20 * transactions(asked), asked
    store.clear_caches()  # as by a restart, and by a write of another cloud
    with statements() as asked:
        assert results(bring_all(store, *last)) == ["stored"] * 300
    assert len(asked) < 20 * transactions(asked), asked
