"""Slots: writers of different slots do not wait for each other, and the feed misses nothing."""

from __future__ import annotations

import asyncio
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import aclosing
from itertools import count
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any

import cbor2
import pytest
from eskin_cloud.api.live import resume
from eskin_cloud.jobs.pg_listener import listen
from eskin_cloud.jobs.retention import sweep
from eskin_cloud.live import Feed
from eskin_cloud.query.opaque_ids import OpaqueIds, UnknownCursorError
from eskin_cloud.service import make_cloud
from eskin_cloud.store import Store
from eskin_cloud.store.feed_entry import FEED_START, FeedPosition, last_position, share
from eskin_cloud.store.notify import NoticeSender
from eskin_cloud.store.schema.frame_tables import frames
from eskin_cloud.store.schema.sealed_tables import erased_subjects, sealed_messages
from eskin_cloud.store.schema.tables import dead_letters, sequences
from eskin_cloud.store.write.audit_log import list_audit_entries
from eskin_cloud.store.write.parsed_message import ParsedMessage
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import Engine, event, func, select, text

from eskin.errors import StoreError
from eskin.wire.slot import SLOTS, even_groups, in_order, share_out, slot_of
from tests.support.examples import examples
from tests.support.processes import wait_until
from tests.unit.cloud.brute_force import compact_all
from tests.unit.cloud.clouds import Stand, emptied, put, put_items
from tests.unit.cloud.commits import kinds, one_commit
from tests.unit.cloud.messages import stretch
from tests.unit.cloud.sealing import beat, declared, notice, sealing
from tests.unit.cloud.streams import EVERYTHING, events_of
from tests.unit.cloud.streams import listen as stream_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from eskin_cloud.store.location import StoreLocation
    from eskin_cloud.store.write.write_cache import WriteCache
    from sqlalchemy import URL, Connection, Table

    from tests.support.identities import Identities
    from tests.support.postgresql import Cluster
    from tests.unit.cloud.sealing import Site

NODES = [f"node-{number}" for number in range(40)]


def named(slot: int) -> str:
    """A node of a slot."""
    return next(name for k in count() if slot_of(name := f"name-{k}") == slot)


def rows(store: Store, table: Table) -> list[dict[str, Any]]:
    """All rows of a table."""
    with store.read() as connection:
        return [dict(row) for row in connection.execute(select(table)).mappings()]


def waits(store: Store) -> int:
    """How many sessions wait for a lock."""
    query = text("SELECT count(*) FROM pg_locks WHERE NOT granted")
    with store.read() as connection:
        return int(connection.execute(query).scalar_one())


@pytest.fixture
def two(cluster: Cluster, shared_database: URL) -> Iterator[tuple[Store, Store]]:
    """Two processes' stores on one server."""
    cluster.clear(shared_database)
    with Store(shared_database) as one, Store(shared_database) as other:
        yield one, other


def test_only_writers_of_the_same_slot_wait(two: tuple[Store, Store]) -> None:
    one, other = two
    ours, near, far = named(3), named(4), named(40)
    groups = even_groups(4)
    assert groups[3] == groups[4] != groups[40]
    with ThreadPoolExecutor(1) as pool:
        with one_commit(one, ours):
            assert kinds(put(other, stretch(0), node=near)) == ["stored"]
            assert kinds(put(other, stretch(0), node=far)) == ["stored"]
            assert kinds(put(one, stretch(1), node=far)) == ["stored"]
            assert one.write_and_wait(lambda _: 7) == other.write_and_wait(lambda _: 8) - 1
            assert waits(one) == 0
            same = pool.submit(put, other, stretch(0), node=ours)
            wait_until(lambda: waits(one) == 1, "the writer of the same slot waits")
            assert not same.done()
        assert kinds(same.result(120)) == ["stored"]


def test_each_message_is_stored_once_whichever_cloud_gets_it(two: tuple[Store, Store]) -> None:
    drawn = Random(7)  # noqa: S311 - no secret
    said = [(node, number) for node in NODES[:10] for number in range(12)]
    batches = [drawn.sample(said, 8) for _ in range(120)]

    def bring(store: Store, mine: list[list[tuple[str, int]]]) -> list[str]:
        return [
            receipt
            for batch in mine
            for node, number in batch
            for receipt in kinds(put(store, stretch(number), node=node))
        ]

    with ThreadPoolExecutor(2) as pool:
        answers = list(pool.map(bring, two, (batches[::2], batches[1::2])))
    brought = {each for batch in batches for each in batch}
    assert sum(each.count("stored") for each in answers) == len(brought)
    stored = [(row["node"], row["sequence"]) for row in rows(two[0], frames)]
    assert sorted(stored) == sorted(brought)
    kept = {
        (row["node"], number)
        for row in rows(two[0], sequences)
        for number in range(row["first"], row["last"] + 1)
    }
    assert kept == brought
    with two[0].read() as connection:
        last = last_position(connection)
    cursors = [row["cursor"] for row in rows(two[0], frames)]
    assert len(set(cursors)) == len(cursors), "cursors are unique in the store"
    assert FEED_START.advance(cursors) == last


def test_background_work_of_a_slot_is_of_its_last_writer_until_that_ends(
    cluster: Cluster, shared_database: URL
) -> None:
    cluster.clear(shared_database)
    with Store(shared_database) as one:
        with Store(shared_database) as other:
            for each in (one, other):
                each.check()  # as clouds do each second; they are connected from then on
            put(one, stretch(0), node=named(3))
            put(other, stretch(0), node=named(40))
            put(other, stretch(0), node=named(41))
            put(one, stretch(1), node=named(41))
            assert one.own_slots() == set(range(SLOTS)) - {40}
            assert other.own_slots() == set(range(SLOTS)) - {3, 41}
        wait_until(lambda: one.own_slots() == set(range(SLOTS)), "the other's sessions are gone")


def test_dead_letters_stay_bounded_in_all_slots_together(store: Store) -> None:
    for number in range(60):
        letter = ParsedMessage.parse(NODES[number % 7], b"\xff" * (1 + number))
        (receipt,) = put_items(store, [letter], dead_letters=5).results
        assert receipt.result == "rejected"
        assert len(rows(store, dead_letters)) == min(number + 1, 5)


@pytest.fixture
def stands(
    tmp_path: Path, identities: Identities, cluster: Cluster, shared_database: URL
) -> Iterator[tuple[Stand, Stand]]:
    """Two clouds on one server."""
    cluster.clear(shared_database)
    with sealing(tmp_path, identities, place=shared_database) as one:
        (tmp_path / "other").mkdir()
        with Store(shared_database, clock=one.clock) as store:
            cloud = make_cloud(
                one.cloud.settings, store, clock=one.clock, dashboard=tmp_path / "dashboard"
            )
            yield one, Stand(cloud, one.clock, one.gateway, one.token)


SHARDS = [frozenset(range(first, SLOTS, 20)) for first in range(20)]
"""As Citus may have them: more than there are writers, of slots that are no neighbours."""


@pytest.fixture
def sharded(
    cluster: Cluster, shared_database: URL, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Store]:
    cluster.clear(shared_database)
    monkeypatch.setattr("eskin_cloud.store.store.read_groups", lambda _: SHARDS)
    with Store(shared_database) as made:
        yield made


def test_no_transaction_locks_slots_of_two_shards(sharded: Store) -> None:
    locked: list[set[int]] = []

    def see(*given: Any) -> None:
        statement, parameters = given[2], given[3]
        if "FOR UPDATE" in statement:
            locked.append(set(parameters.values()))

    nodes = [named(slot) for slot in range(SLOTS)]
    event.listen(Engine, "before_cursor_execute", see)
    try:
        with ThreadPoolExecutor(32) as pool, one_commit(sharded, nodes[0]):
            said = [pool.submit(put, sharded, stretch(1), node=node) for node in nodes[4:36]]
            # The first writer has jobs of several shards then.
            wait_until(lambda: sharded.waiting >= 8, "those of the first writer wait together")
        assert {kinds(each.result(120))[0] for each in said} == {"stored"}
    finally:
        event.remove(Engine, "before_cursor_execute", see)
    assert {slot for each in locked for slot in each} >= set(range(4, 36))
    assert all(any(each <= shard for shard in SHARDS) for each in locked), locked


def test_shards_are_read_again_after_a_fault(
    sharded: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    items = [named(0), named(20)]
    assert [each.slots for each in sharded.shares(items, str)] == [{0, 20}]
    split = [frozenset({slot}) for slot in range(SLOTS)]
    monkeypatch.setattr("eskin_cloud.store.store.read_groups", lambda _: split)

    def refuse(connection: Connection, _: WriteCache) -> None:
        connection.execute(text("DO $$ BEGIN RAISE 'no' USING ERRCODE = '53100'; END $$"))

    with pytest.raises(StoreError):
        sharded.write_slots([0, 20], refuse).result(120)
    assert [each.slots for each in sharded.shares(items, str)] == [{0}, {20}]
    with pytest.raises(StoreError, match="retry"):
        sharded.write_slots([0, 20], refuse)


@pytest.mark.anyio
async def test_messages_of_a_group_that_cannot_be_written_are_answered_later(
    stands: tuple[Stand, Stand],
) -> None:
    stand, (far, near) = stands[0], (named(40), named(3))
    broken = text(
        "CREATE FUNCTION refuse() RETURNS trigger LANGUAGE plpgsql AS "
        "$$ BEGIN RAISE EXCEPTION 'no' USING ERRCODE = '53100'; END $$; "
        "CREATE TRIGGER refuse BEFORE INSERT ON frames FOR EACH ROW "
        "WHEN (NEW.slot = 40) EXECUTE FUNCTION refuse()"
    )
    stand.cloud.store.write_and_wait(lambda connection: connection.execute(broken))
    body = cbor2.dumps([[node, stretch(1).encode()] for node in (far, near, far)])
    try:
        answer = await stand.ingest(body)
        items = answer.json()["items"]
        assert [each["result"] for each in items] == ["later", "stored", "later"]
        assert items[0]["reason"]
        alone = await stand.ingest(cbor2.dumps([[far, stretch(1).encode()]]))
        assert alone.status_code == 503, "nothing of it is stored"
    finally:
        mended = text("DROP FUNCTION refuse CASCADE")
        stand.cloud.store.write_and_wait(lambda connection: connection.execute(mended))
    answer = await stand.ingest(body)
    assert [each["result"] for each in answer.json()["items"]] == [
        "stored",
        "duplicate",
        "duplicate",
    ]


async def heard(stand: Stand, position: FeedPosition, most: int) -> list[tuple[str, str]]:
    """Id and node of each frame of a stream from a position on, until there are so many."""
    found: list[tuple[str, str]] = []
    async with asyncio.timeout(60), aclosing(stream_of(stand, position)) as stream:  # type: ignore[type-var]  # a generator
        async for piece in stream:
            found += [(each["id"], each["data"]["node"]) for each in events_of(piece)]
            if len(found) >= most:
                break
    return found


def poll_once(monkeypatch: pytest.MonkeyPatch) -> asyncio.Semaphore:
    """Let each feed be polled once, then no more, as while one of several servers is away.

    Returns:
        Released once for each feed.
    """
    known, polled, catch_up = set[Feed](), asyncio.Semaphore(0), Feed.catch_up

    async def catch_up_once(feed: Feed) -> None:
        if feed in known:
            raise StoreError("a server does not answer")
        known.add(feed)
        await catch_up(feed)
        polled.release()

    monkeypatch.setattr(Feed, "catch_up", catch_up_once)
    return polled


@pytest.mark.anyio
@pytest.mark.parametrize("fault", ["", "notices are lost", "the feed cannot be polled"])
async def test_stream_of_one_cloud_has_all_that_any_cloud_stores(
    stands: tuple[Stand, Stand], monkeypatch: pytest.MonkeyPatch, *, fault: str
) -> None:
    polled = asyncio.Semaphore(2)
    if fault == "notices are lost":  # readers also poll
        monkeypatch.setattr(NoticeSender, "add", lambda *_: None)
    elif fault:
        polled = poll_once(monkeypatch)
    drawn, stopping = Random(3), asyncio.Event()  # noqa: S311 - no secret
    said = [(node, number) for node in NODES for number in range(5)]
    listeners = [
        asyncio.create_task(listen(each.cloud, each.cloud.store.location, stopping))  # type: ignore[arg-type]  # a URL
        for each in stands
    ]
    for each in stands:  # ids as clouds write them
        feed = each.cloud.feed
        feed.ids = feed.encoder.ids = feed.frame_encoder.ids = OpaqueIds(bytes(32))
    for _ in stands:  # what was notified before a process listens is polled
        await polled.acquire()
    readers = [
        asyncio.create_task(heard(each, FEED_START, len(said))) for each in (*stands, stands[0])
    ]
    for node, number in said:
        at = drawn.choice(stands)
        outcome = await asyncio.to_thread(put, at.cloud.store, stretch(number), node=node)
        at.cloud.feed.append(outcome.entries)
    found = await asyncio.gather(*readers)
    for one in found:
        assert sorted(node for _, node in one) == sorted(node for node, _ in said)
    # Wherever a client of one cloud breaks off, it goes on at the other without a loss.
    for seen in drawn.sample(range(1, len(said)), 12):
        position = stands[1].cloud.feed.ids.read_position(found[0][seen - 1][0])
        rest = await heard(stands[1], position, len(said) - seen)
        whole = [node for _, node in found[0][:seen] + rest]
        assert sorted(whole) == sorted(node for node, _ in said)
    for task in listeners:
        task.cancel()
    await asyncio.wait(listeners)


@pytest.mark.anyio
async def test_client_that_goes_on_at_a_cloud_which_is_behind_gets_nothing_twice(
    stands: tuple[Stand, Stand],
) -> None:
    """A cloud is killed after its commit, before it notifies the others."""
    one, behind = stands
    for number in range(4):
        outcome = await asyncio.to_thread(put, one.cloud.store, stretch(number))
        one.cloud.feed.append(outcome.entries)
    ids = behind.cloud.feed.ids
    stated = ids.write_position(one.cloud.feed.last)
    assert behind.cloud.feed.last != one.cloud.feed.last
    assert await resume(behind.cloud, stated, "cursor") == one.cloud.feed.last
    assert behind.cloud.feed.last == one.cloud.feed.last


@pytest.mark.anyio
async def test_erasure_waits_for_transactions_that_do_not_know_of_it(
    tmp_path: Path, identities: Identities, site: Site, place: StoreLocation
) -> None:
    with sealing(tmp_path, identities, place=place) as stand:
        node, ada, cloud = "hand", site.ada.pseudonym, stand.cloud
        await notice(stand, [[ada, node, site.ada.key]], [])
        await stand.ingest(site.batch(declared(), beat(1)))
        (row,) = rows(cloud.store, sealed_messages)
        row.pop("row_digest", None)
        gone = sealed_messages.delete()
        await asyncio.wrap_future(cloud.store.write(lambda connection: connection.execute(gone)))
        begun: Future[None] = Future()
        ended: Future[None] = Future()

        def late(connection: Connection, _: WriteCache) -> None:
            """Insert a message as a transaction does that looked for erasures before this one."""
            begun.set_result(None)
            ended.result(120)
            connection.execute(sealed_messages.insert(), row)

        writing = cloud.store.write_node(node, late)
        await asyncio.wrap_future(begun)
        erasing = asyncio.create_task(notice(stand, [], [ada]))
        sweeping: asyncio.Task[int] | None = None
        if not isinstance(place, Path):  # SQLite has one writer: the notice itself waits
            assert await erasing == ["erased"]
            sweeping = asyncio.create_task(sweep(cloud))
            held_up = lambda: sweeping.done() or cloud.store.waiting > 0  # noqa: E731
            await asyncio.to_thread(wait_until, held_up, "the sweep waits, or is done")
            assert not sweeping.done(), "it waits for the transaction"
        ended.set_result(None)
        await asyncio.wrap_future(writing)
        assert await erasing == ["erased"]
        await (sweeping or sweep(cloud))
        assert rows(cloud.store, sealed_messages) == []
        (erased,) = rows(cloud.store, erased_subjects)
        assert erased["removed"] is not None
        with cloud.store.read() as connection:
            page, _ = list_audit_entries(connection, before=None, limit=9)
            actions = [each["action"] for each in page]
        assert "subject's messages removed" in actions


positions = st.lists(st.integers(0, 2**40 - 1), min_size=SLOTS, max_size=SLOTS).map(FeedPosition.of)


@given(st.integers(0, 1000), st.lists(st.integers(0, 300), max_size=20))
def test_shares_are_as_even_as_the_sizes_allow(most: int, sizes: list[int]) -> None:
    shares = share(most, sizes)
    assert all(own <= size for own, size in zip(shares, sizes, strict=True))
    assert sum(shares) == min(most, sum(sizes))
    short = [own for own, size in zip(shares, sizes, strict=True) if own < size]
    if short:  # who has not all has at least as much as any other, but for the remainder
        assert min(short) + 1 >= max(shares)


@given(positions, positions, st.integers(0, 2**30))
def test_positions_are_partly_ordered(one: FeedPosition, other: FeedPosition, most: int) -> None:
    last = one.advance(other.cursors)
    assert one.no_later_than(other) == other.no_later_than(one)
    assert not any(last.spans(one))
    assert not any(last.spans(other))
    assert one.reaches(other) is not any(one.spans(other))
    assert one.distance(last) == sum(span.size for span in one.spans(last))
    assert one.distance(last) == last.total - one.total
    resumed = one.resume(last, most)
    assert resumed.distance(last) == min(most, one.distance(last))
    assert one.no_later_than(resumed) == one
    for slot, cursor in enumerate(one.cursors):
        assert cursor in one
        assert cursor + SLOTS not in one
        assert cursor % SLOTS == slot


@given(positions, positions)
def test_ids_of_positions_are_read_back_and_reveal_no_count(
    one: FeedPosition, other: FeedPosition
) -> None:
    ids = OpaqueIds(bytes(32))
    text_ = ids.write_position(one)
    assert OpaqueIds(bytes(32)).read_position(text_) == one
    assert len(text_) == len(ids.write_position(other))
    with pytest.raises(UnknownCursorError):
        OpaqueIds(bytes(31) + b"\x01").read_position(text_)
    with pytest.raises(UnknownCursorError):
        ids.read_position(ids.write(1))


@given(
    st.lists(st.sampled_from(NODES), max_size=50),
    st.sampled_from([1, 4, 16]).map(even_groups)
    | st.lists(st.integers(0, 40), min_size=SLOTS, max_size=SLOTS),
)
def test_shares_of_items_hold_each_once(items: list[str], groups: Sequence[int]) -> None:
    shares = share_out(items, str, groups)
    assert in_order(shares, [each.items for each in shares]) == items
    for each in shares:
        assert each.slots == {slot_of(item) for item in each.items}
        assert len({groups[slot] for slot in each.slots}) == 1


@settings(
    max_examples=examples(60), deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)  # fmt: skip
@given(drawn=st.randoms(use_true_random=False))
def test_streams_of_many_nodes_miss_nothing_whatever_memory_holds(
    store: Store, drawn: Random
) -> None:
    """Feeds with little memory, entries of other processes between, and readers of any pace.

    Some frames are compacted before they are read: these lie where the feed says that some may.
    """
    emptied(store)
    feed = Feed(store, recent=drawn.choice([1, 4, 100]), recent_bytes=10**6)
    readers = [(FEED_START.no_later_than(feed.last), list[Any]()) for _ in range(3)]
    stated = [FEED_START] * 3
    expected: list[int] = []
    compacts = drawn.choice([0.0, 0.1])

    async def run() -> None:
        for number in range(25):
            outcome = put(store, stretch(number), node=drawn.choice(NODES[:6]))
            expected.extend(entry.cursor for entry in outcome.entries)
            if drawn.random() < 0.7:
                feed.append(outcome.entries)
            if drawn.random() < compacts:
                compact_all(store)
            for k in drawn.sample(range(3), drawn.randrange(4)):
                await read(k)
        await feed.catch_up()
        for k in range(3):
            while readers[k][0] != feed.last:
                await read(k)

    async def read(k: int) -> None:
        position, found = readers[k]
        entries, end, compacted = await feed.after(position, drawn.choice([1, 3, 64]))
        stated[k] = stated[k].advance(compacted.cursors)
        await feed.layouts.load(entries)
        sent = feed.encoder.page(entries, EVERYTHING, position)
        assert len(events_of(sent)) == len(entries), "readers share pages of the same entries only"
        found.extend(entry.cursor for entry in entries)
        readers[k] = end, found

    asyncio.run(run())
    for (_, found), missing in zip(readers, stated, strict=True):
        require_all_or_stated(found, missing, expected)
        assert compacts or missing == FEED_START
    with store.read() as connection:
        stored = connection.execute(select(func.count()).select_from(frames)).scalar_one()
    assert stored <= len(expected) if compacts else stored == len(expected)


def require_all_or_stated(
    found: Sequence[int], missing: FeedPosition, expected: Sequence[int]
) -> None:
    """Each entry once, in the order of its slot; what is not there is stated to be missing."""
    assert len(set(found)) == len(found)
    assert set(found) <= set(expected)
    assert all(cursor in missing for cursor in set(expected) - set(found))
    for slot in {cursor % SLOTS for cursor in found}:
        own = [cursor for cursor in found if cursor % SLOTS == slot]
        assert own == sorted(own)
