"""Monitors over what arrives: an alarm for each episode of the whole record, and for no other."""

from __future__ import annotations

import asyncio
from asyncio import Event
from functools import partial
from itertools import count as counted
from itertools import groupby, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_cloud.alarms.episodes import Edge, Episodes, VerdictStretch
from eskin_cloud.alarms.evaluator import Evaluator
from eskin_cloud.alarms.live_monitor import LiveMonitor
from eskin_cloud.jobs.monitors import evaluate_monitors
from eskin_cloud.live import Feed
from eskin_cloud.query.channel_runs import ChannelSource
from eskin_cloud.query.stored_verdicts import StoredVerdicts
from eskin_cloud.store.descriptions import _layouts as kept_layouts
from eskin_cloud.store.descriptions import _patches as kept_patches
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.schema.frame_tables import descriptions
from eskin_cloud.store.write.alarms import AlarmChange, apply_changes, take_lease
from eskin_cloud.store.write.monitors import settle_monitors
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import delete

from eskin.interval import Verdict
from eskin.monitor import parse
from eskin.wire.timestamp import SECOND
from tests.support.examples import examples
from tests.support.processes import wait_until
from tests.unit.cloud.brute_force import compact_all
from tests.unit.cloud.clouds import batch, emptied, forget_recent, put
from tests.unit.cloud.live_monitors import Live, alarms_of, define, episodes_of
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START, stretch

if TYPE_CHECKING:
    from random import Random

    from eskin_cloud.live.feed import FeedPage
    from eskin_cloud.store import Store

    from eskin.wire.frames import Frame
    from tests.unit.cloud.clouds import Clock, Stand

FORMULAS = (
    f"{CHANNEL} > 2",
    f"once[0,3ms] {CHANNEL} > 2",
    f"rise({CHANNEL} > 2) or {CHANNEL} > 3",
    f"{CHANNEL} > 2 and eventually[0,4ms] {CHANNEL} < 1",
    f"{CHANNEL} - delay({CHANNEL}, 2ms) > 1",
)


def frame(sequence: int, values: list[float], *, at: int, width: float = 0.5) -> Frame:
    """Samples of a millisecond each, from a time in ms after the start on."""
    lo = np.array(values)
    time = START + at * DT, START + at * DT + 2000
    return stretch(sequence, lo, lo + width, time=time)


def reference(
    store: Store, formula: str, *, raise_on: str, missing: bool, clear_after: int, end: int
) -> list[tuple[int, int | None]]:
    """The episodes of the whole record up to a tick, as a query evaluates it."""
    found = parse(formula)
    with store.read() as connection:
        sources = {
            name: ChannelSource(connection, find_channel(connection, NODE, name))
            for name in found.sources
        }
        pieces = list(StoredVerdicts(found, sources).pieces(Window(START, end // 2 + 1)))
    known = [
        VerdictStretch(p.first, min(p.last, end - 1), p.verdict, p.missing)
        for p in pieces
        if p.first < end
    ]

    def raises(each: VerdictStretch) -> bool:
        possible = each.verdict is Verdict.POSSIBLE and (missing or not each.missing)
        return each.verdict is Verdict.CERTAIN or (raise_on == "possible" and possible)

    # Stretches that are impossible for long enough part the record; each part has one episode.
    parts: list[tuple[list[VerdictStretch], int | None]] = []
    part: list[VerdictStretch] = []
    for is_quiet, group in groupby(known, key=lambda each: each.verdict is Verdict.IMPOSSIBLE):
        found_here = list(group)
        length = found_here[-1].last + 1 - found_here[0].first
        if is_quiet and length >= 2 * clear_after:
            parts.append((part, found_here[0].first))
            part = []
        else:
            part += found_here
    parts.append((part, None))
    begun = [(next((p.first for p in part if raises(p)), None), stop) for part, stop in parts]
    return [(began, stop) for began, stop in begun if began is not None]


def settled_of(live: Live) -> int:
    """Up to which tick the monitor has been evaluated."""
    found = live.evaluator.find("squeeze")
    assert found is not None
    return found.settled


def problem_of(live: Live) -> str | None:
    """Why the monitor is not evaluated."""
    found = live.evaluator.find("squeeze")
    assert found is not None
    return found.problem


levels = st.lists(st.sampled_from((0.0, 1.0, 1.8, 2.2, 4.0)), min_size=1, max_size=8)


@settings(
    max_examples=examples(60),
    suppress_health_check=[HealthCheck.function_scoped_fixture],
    deadline=None,
)
@given(
    said=st.lists(st.tuples(levels, st.integers(0, 1), st.integers(0, 4)), min_size=1, max_size=8),
    formula=st.sampled_from(FORMULAS),
    raising=st.sampled_from((("certain", False), ("possible", False), ("possible", True))),
    clear_after=st.sampled_from((0, 1, 3)),
    restarts=st.sets(st.integers(0, 8)),
    faults=st.sets(st.integers(0, 8)),
    steps=st.sets(st.integers(0, 8)),
)
def test_alarms_are_the_episodes_of_the_whole_record(
    store: Store,
    said: list[tuple[list[float], int, int]],
    formula: str,
    raising: tuple[str, bool],
    clear_after: int,
    restarts: set[int],
    faults: set[int],
    steps: set[int],
) -> None:
    emptied(store)
    raise_on, missing = raising
    pause_ns = clear_after * DT
    define(
        store,
        formula,
        since=START,
        raise_on=raise_on,
        missing=missing,
        clear_after=pause_ns,
    )
    live, at = Live(store), 0
    for k, (values, is_gap, pause) in enumerate(said):
        at += 2 + pause if is_gap else 0
        put(store, frame(k, values, at=at))
        at += len(values)
        if k in restarts:
            live = Live(store)
        if k in faults:
            live.step(fails=True)
        if k in steps or k == len(said) - 1:
            live.step()
    live.step()
    assert problem_of(live) is None
    end = settled_of(live)
    assert end >= 2 * (START + (at - 5) * DT - 10_000)  # all but what the future may change
    found = reference(
        store, formula, raise_on=raise_on, missing=missing, clear_after=pause_ns, end=end
    )
    assert episodes_of(store) == found


@settings(
    max_examples=examples(100),
    suppress_health_check=[HealthCheck.function_scoped_fixture],
    deadline=None,
)
@given(
    said=st.lists(levels, min_size=2, max_size=7),
    order=st.randoms(use_true_random=False),
    formula=st.sampled_from(FORMULAS),
    raise_on=st.sampled_from(("certain", "possible")),
    restarts=st.sets(st.integers(0, 6)),
    faults=st.sets(st.integers(0, 6)),
    behind=st.lists(st.sampled_from(("skipped", 0, 1, None)), min_size=7, max_size=7),
)
def test_late_frames_miss_no_episode_and_raise_no_false_one(
    store: Store,
    said: list[list[float]],
    order: Random,
    formula: str,
    raise_on: str,
    restarts: set[int],
    faults: set[int],
    behind: list[int | str | None],
) -> None:
    emptied(store)
    define(store, formula, since=START, raise_on=raise_on)
    starts = np.cumsum([0, *map(len, said)])
    made = [frame(k, values, at=int(starts[k])) for k, values in enumerate(said)]
    order.shuffle(made)
    live = Live(store)
    for k, each in enumerate(made):
        put(store, each)
        if k in restarts:
            live = Live(store)
        most = behind[k]
        if not isinstance(most, str):
            if k in faults:
                live.step(most=most, fails=True)
            live.step(most=most)
    for _ in range(3):
        live.step()
    end = settled_of(live)
    raised = episodes_of(store)
    wanted = reference(store, formula, raise_on=raise_on, missing=False, clear_after=0, end=end)
    assert all(any(_meet(each, other) for other in raised) for each in wanted)
    assert all(any(_meet(each, other) for other in wanted) for each in raised)


def _meet(one: tuple[int, int | None], other: tuple[int, int | None]) -> bool:
    return (one[1] is None or other[0] < one[1]) and (other[1] is None or one[0] < other[1])


def test_episodes_that_are_near_are_one() -> None:
    def found(clear_after: int) -> list[Edge]:
        episodes = Episodes(
            on_possible=False, missing=False, clear_after=clear_after, is_open=False
        )
        verdicts = (Verdict.CERTAIN, Verdict.IMPOSSIBLE, Verdict.CERTAIN, Verdict.IMPOSSIBLE)
        ends = (0, 10, 30, 40, 100)
        return episodes.add(
            VerdictStretch(first, last - 1, verdict, missing=False)
            for verdict, (first, last) in zip(verdicts, pairwise(ends), strict=True)
        )

    certain = Verdict.CERTAIN
    assert found(10) == [Edge(0, certain), Edge(10, None), Edge(30, certain), Edge(40, None)]
    assert found(11) == [Edge(0, certain), Edge(40, None)]
    assert found(31) == [Edge(0, certain)]


def test_gap_ends_no_episode_and_silence_begins_one_where_missing_samples_count(
    store: Store, clock: Clock
) -> None:
    clock.now = START
    since = START + DT // 2
    define(store, f"{CHANNEL} > 2", name="gap", since=since)
    define(store, f"{CHANNEL} > 2", name="silence", raise_on="possible", missing=True, since=since)
    live = Live(store, silence=2 * SECOND)
    put(store, frame(0, [1.0, 4.0, 4.0], at=0))
    live.step()
    live.step()
    assert [(row["monitor"], row["ended"]) for row in alarms_of(store)] == [
        ("gap", None),
        ("silence", None),
    ]
    put(store, frame(1, [1.0, 1.0, 1.0], at=100))
    live.step()
    ended = {row["monitor"]: row["ended"] for row in alarms_of(store)}
    assert all(each is not None and each >= 2 * (START + 99 * DT) for each in ended.values())
    for seconds in (1.0, 3.0):
        clock.now = START + int(seconds * SECOND)
        live.step()
        opened = [row["monitor"] for row in alarms_of(store) if row["ended"] is None]
        assert opened == (["silence"] if seconds == 3.0 else [])


def test_monitor_of_an_unknown_channel_waits_for_it(store: Store, clock: Clock) -> None:
    define(store, "t09.capacitance > 2", since=START)
    live = Live(store)
    live.step()
    assert problem_of(live) is not None
    clock.turn(60.0)
    put(store, stretch(0, [3.0, 3.0, 3.0], [4.0, 4.0, 4.0], channel="t09.capacitance"))
    live.step()
    assert problem_of(live) is None
    assert len(alarms_of(store)) == 1


@pytest.mark.parametrize("count", [3])
def test_monitors_of_many_nodes_wait_for_the_slowest(store: Store, count: int) -> None:
    names = [f"n{k}" for k in range(count)]
    formula = " and ".join(f'"{name}/{CHANNEL}" > 2' for name in names)
    define(store, formula, since=START)
    live = Live(store)
    for name in names:
        put(store, frame(0, [1.0], at=0), node=name)
    for k, name in enumerate(names):
        put(store, frame(1, [4.0] * 20, at=1), node=name)
        live.step()
        assert len(alarms_of(store)) == (k == count - 1)


def test_damaged_layout_of_a_node_stops_no_monitor_of_another(store: Store) -> None:
    put(store, frame(0, [1.0], at=0))
    put(store, stretch(0, channel="t09.capacitance"), node="palm")
    define(store, '"palm/t09.capacitance" > 9', name="other", since=START)
    live = Live(store)
    live.step()
    put(store, stretch(1, channel="t09.capacitance", time=(START + DT, START + DT)), node="palm")
    put(store, frame(1, [4.0, 4.0], at=1))
    damaged = delete(descriptions).where(descriptions.c.node == "palm")
    store.write(lambda connection: connection.execute(damaged)).result(60)
    for cache in (kept_layouts, kept_patches):
        cache.clear()
    define(store, f"{CHANNEL} > 2", since=START)
    live.step(most=0)
    assert [row["monitor"] for row in alarms_of(store)] == ["squeeze"]


def test_fault_before_all_monitors_were_read_hides_no_late_frame(store: Store) -> None:
    names = "one", "two"
    for name in names:
        define(store, f"{CHANNEL} > 2", name=name, since=START)
    put(store, frame(0, [1.0, 1.0], at=0))
    put(store, frame(1, [1.0] * 20, at=6))
    live = Live(store)
    for _ in range(3):
        live.step()
    store.write(partial(settle_monitors, settled=live.evaluator.all_settled)).result(60)
    put(store, frame(2, [4.0, 1.0], at=3))  # while no process evaluates
    ticks = counted(START, SECOND)
    slow = Evaluator(store, silence=SECOND, clock=store.clock, monotonic=lambda: next(ticks))
    live = Live(store, evaluator=slow)
    live.step()
    assert len(alarms_of(store)) == 1, "a round that takes long reads one monitor"
    live.step(fails=True)
    for _ in range(12):
        live.step()
    assert sorted(row["monitor"] for row in alarms_of(store)) == list(names)


def test_what_was_forgotten_is_not_examined(store: Store) -> None:
    define(store, f"{CHANNEL} > 2", since=START)
    put(store, frame(0, [1.0, 4.0], at=0))
    live = Live(store)
    live.step()
    assert live.evaluator.examined
    live.evaluator.forget()
    assert not live.evaluator.examined, "the lease may have been another cloud's meanwhile"


def test_one_of_two_clouds_evaluates_and_the_other_takes_over(store: Store, clock: Clock) -> None:
    clock.now = START

    def lease(live: Live) -> bool:
        take = partial(take_lease, holder=live.evaluator.holder, now=clock.now, alone=False)
        return store.write(take).result(60)

    define(store, f"{CHANNEL} > 2", since=START)
    one, other = Live(store), Live(store)
    clock.turn(20.0)
    assert lease(one)
    assert not lease(other)
    put(store, frame(0, [1.0, 4.0, 4.0], at=0))
    one.step()
    raised = AlarmChange("squeeze", 1, 2 * START, "certain")
    changes = partial(apply_changes, changes=[raised], holder=other.evaluator.holder, now=clock.now)
    assert not store.write(changes).result(60), "nothing is stored without the lease"
    assert len(alarms_of(store)) == 1
    clock.turn(5.0)
    assert lease(one), "it is renewed"
    clock.turn(9.0)
    assert not lease(other)
    clock.turn(2.0)
    assert lease(other)
    put(store, frame(1, [1.0, 1.0, 4.0, 4.0], at=3))
    other.step()
    assert [row["ended"] is None for row in alarms_of(store)] == [False, True]


def test_monitor_that_fails_stops_no_other_and_is_read_anew(
    store: Store, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock.now = START
    for name in ("broken", "sound"):
        define(store, f"{CHANNEL} > 2", name=name, since=START)
    put(store, frame(0, [1.0], at=0))
    live, advance = Live(store), LiveMonitor.advance

    def fail(monitor: LiveMonitor) -> list[AlarmChange]:
        if monitor.name == "broken":
            raise ZeroDivisionError
        return advance(monitor)

    monkeypatch.setattr(LiveMonitor, "advance", fail)
    put(store, frame(1, [4.0, 4.0], at=1))
    live.step()
    live.step()
    assert [row["monitor"] for row in alarms_of(store)] == ["sound"]
    monkeypatch.undo()
    clock.turn(6.0)
    live.step()
    live.step()
    assert sorted(row["monitor"] for row in alarms_of(store)) == ["broken", "sound"]


def test_alarm_of_a_monitor_that_cannot_go_on_is_stored(store: Store, clock: Clock) -> None:
    clock.now = START
    define(store, f"{CHANNEL} > 2 and once[0,140s] {CHANNEL} > 0", since=START)
    live = Live(store)
    put(store, frame(0, [1.0, 4.0, 4.0, 4.0], at=0))
    live.step()
    assert problem_of(live) is not None, "its window holds too many samples"
    assert len(alarms_of(store)) == 1


@pytest.mark.anyio
async def test_episode_that_was_compacted_before_it_was_read_raises_its_alarm(
    stand: Stand, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The job is behind the feed by more than the age at which frames are compacted."""
    cloud, store, stopping, may_read = stand.cloud, stand.cloud.store, Event(), Event()
    may_read.set()
    after = Feed.after

    async def held(self: Feed, *args: Any, **options: Any) -> FeedPage:
        await may_read.wait()
        return await after(self, *args, **options)

    def is_read() -> bool:
        monitor = cloud.evaluator.find("squeeze")
        return monitor is not None and monitor.position is not None

    def is_cleared() -> bool:
        return any(row["ended"] is not None for row in alarms_of(store))

    monkeypatch.setattr(Feed, "after", held)
    await stand.ingest(batch(frame(0, [1.0], at=0)))
    define(store, f"{CHANNEL} > 2", since=START)
    async with asyncio.timeout(60), asyncio.TaskGroup() as running:
        running.create_task(evaluate_monitors(cloud, stopping))
        await asyncio.to_thread(wait_until, is_read, "the monitor has read the store")
        may_read.clear()
        await stand.ingest(batch(frame(1, [4.0, 4.0, 1.0], at=1)))
        await asyncio.to_thread(compact_all, store)
        forget_recent(stand)
        may_read.set()
        await stand.ingest(batch(frame(2, [1.0] * 5, at=4)))
        await asyncio.to_thread(wait_until, is_cleared, "the alarm is raised and cleared")
        stopping.set()
    assert len(alarms_of(store)) == 1
