"""Evaluates all monitors of the store over what arrives, in one thread."""

from __future__ import annotations

import logging
import secrets
import time
from functools import partial
from itertools import count
from typing import TYPE_CHECKING, Final

import numpy as np
from sqlalchemy import select
from sqlalchemy.exc import SQLAlchemyError

from eskin.errors import EskinError
from eskin.wire.frames.frame import read_head
from eskin_cloud.alarms.live_monitor import Instants, LiveMonitor, Samples
from eskin_cloud.live.feed import read_entries
from eskin_cloud.store.descriptions import find_intact_layout
from eskin_cloud.store.feed_entry import FEED_START, compacted_position, last_position
from eskin_cloud.store.read.patch_columns import column_of
from eskin_cloud.store.read.patch_runs import runs_of_frames
from eskin_cloud.store.schema.alarm_tables import alarm_state
from eskin_cloud.store.write.alarms import open_alarms
from eskin_cloud.store.write.monitors import list_monitors

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from sqlalchemy import Connection

    from eskin.wire.frames import DescribedLayout
    from eskin_cloud.store import Store
    from eskin_cloud.store.column_runs import ColumnRun
    from eskin_cloud.store.feed_entry import FeedEntry, FeedPosition
    from eskin_cloud.store.write.alarms import AlarmChange

log = logging.getLogger(__name__)

_CATCH_UPS: Final = 64
"""Monitors that are read from the store in one round, so that the others do not wait."""
_MOST_BEHIND: Final = 10_000
"""Entries that the feed may be behind the store; more are not looked through for late ones."""
_ROUND_NS: Final = 500_000_000
"""After which a round reads no further monitor: what was found counts once it is stored."""
_RETRY_NS: Final = 5_000_000_000
"""After which a monitor with a problem is read again."""


class Evaluator:
    """The monitors of a store, as one cloud evaluates them.

    All methods but `find` run in one thread at a time.

    Args:
        store: Holds definitions, samples and alarms.
        silence: After how many ns without samples missing ones are known.
        clock: Gives UTC ns.
        monotonic: Gives ns that never run backwards.

    Attributes:
        holder: Names this process in the lease.
        leads: Whether this process has the lease: only then it evaluates, and delivers alarms.
    """

    def __init__(
        self,
        store: Store,
        *,
        silence: int,
        clock: Callable[[], int],
        monotonic: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.holder = secrets.token_hex(8)
        self.leads = False
        self._store = store
        self._silence = silence
        self._clock = clock
        self._monotonic = monotonic
        self._version = -1
        self._monitors: dict[str, LiveMonitor] = {}
        self._by_node: dict[str, list[LiveMonitor]] = {}
        self._retry: dict[str, int] = {}
        self._given: FeedPosition | None = None
        self._failed: set[str] = set()
        self._turns: dict[str, int] = {}
        self._numbers = count(1)

    def find(self, name: str) -> LiveMonitor | None:
        """A monitor that is evaluated here; ``None`` if there is none."""
        return self._monitors.get(name)

    @property
    def all_monitors(self) -> list[LiveMonitor]:
        """All that are evaluated here."""
        return list(self._monitors.values())

    @property
    def nodes(self) -> frozenset[str]:
        """The nodes whose samples are read."""
        return frozenset(self._by_node)

    @property
    def examined(self) -> bool:
        """Whether all late samples that have come up to the last position were evaluated.

        It is not so where all was forgotten, as when the lease was lost.
        """
        monitors = self._monitors.values()
        return bool(monitors) and all(monitor.examined for monitor in monitors)

    def forget(self, *, stored: FeedPosition | None = None) -> None:
        """Read all monitors anew from the store: what was found may not have been stored.

        Args:
            stored: A position up to which this process has evaluated the feed and stored what it
                found; ``None`` where another process may have evaluated since, or entries were
                missed. Without one, late samples may have come that no process has evaluated:
                then monitors are evaluated again from their definition on.
        """
        self._version, self._given = -1, stored
        self._monitors, self._by_node, self._retry, self._turns = {}, {}, {}, {}

    def load(self) -> None:
        """Read the definitions, if any has changed.

        Raises:
            StoreError: The store cannot be read.
        """
        with self._store.read() as connection:
            version = connection.execute(select(alarm_state.c.version)).scalar_one()
            if version == self._version:
                return
            raised = {alarm["monitor"] for alarm in open_alarms(connection)}
            rows = {row["name"]: row for row in list_monitors(connection)}
        found: dict[str, LiveMonitor] = {}
        for name, row in rows.items():
            known = self._monitors.get(name)
            if known is not None and known.revision == row["revision"]:
                found[name] = known
                continue
            examined = self._given is not None and name not in self._failed
            self._failed.discard(name)
            try:
                found[name] = LiveMonitor(row, is_open=name in raised, examined=examined)
            except EskinError as error:
                log.warning("monitor cannot be evaluated: monitor=%s reason=%s", name, error)
        self._monitors = found
        self._by_node = {}
        for monitor in found.values():
            for node in monitor.nodes:
                self._by_node.setdefault(node, []).append(monitor)
        self._retry = {name: at for name, at in self._retry.items() if name in rows}
        self._version = version

    def evaluate(
        self,
        entries: Sequence[FeedEntry],
        layouts: Mapping[bytes, DescribedLayout | None],
        *,
        position: FeedPosition,
    ) -> tuple[list[AlarmChange], dict[tuple[str, int], int]]:
        """Evaluate what has arrived.

        Args:
            entries: Of the feed, in their order.
            layouts: Those by which their frames are read.
            position: The one in the feed up to which these are all.

        Returns:
            Episodes that begin or end, and from which tick each monitor with one goes on.

        Raises:
            StoreError: The store cannot be read.
        """
        changes: list[AlarmChange] = []
        touched: dict[str, LiveMonitor] = {}
        for node, arrived in self._of_node(entries).items():
            monitors = [each for each in self._by_node[node] if each.misses(arrived[-1].cursor)]
            _give(node, arrived, layouts, monitors)
            touched |= {monitor.name: monitor for monitor in monitors}
        self._given = position
        for monitor in touched.values():
            changes += self._guarded(monitor, monitor.advance)
        changes += self._catch_up()
        for monitor in list(self._monitors.values()):
            changes += monitor.note_silence(self._clock(), self._silence)
        changed = {change.monitor for change in changes}
        return changes, self.settled(changed)

    def settled(self, names: Iterable[str]) -> dict[tuple[str, int], int]:
        """From which tick monitors go on, by name and revision."""
        found = (self._monitors[name] for name in names if name in self._monitors)
        return {(each.name, each.revision): each.resumes for each in found}

    @property
    def all_settled(self) -> dict[tuple[str, int], int]:
        """From which tick each monitor goes on."""
        return self.settled(self._monitors)

    def _of_node(self, entries: Iterable[FeedEntry]) -> dict[str, list[FeedEntry]]:
        """The frames of each node that a monitor reads."""
        found: dict[str, list[FeedEntry]] = {}
        for entry in entries:
            if entry.node in self._by_node and entry.frame is not None:
                found.setdefault(entry.node, []).append(entry)
        return found

    def _catch_up(self) -> list[AlarmChange]:
        """Read some of the monitors from the store that have to be."""
        now = self._monotonic()
        due = [
            monitor
            for monitor in self._monitors.values()
            if monitor.position is None and self._retry.get(monitor.name, now) <= now
        ]
        changes: list[AlarmChange] = []
        if not due:
            return changes
        due.sort(key=lambda monitor: self._turns.get(monitor.name, 0))
        with self._store.read() as connection:
            end = last_position(connection)
            self._note_late(connection, due[:_CATCH_UPS], end)
            for monitor in due[:_CATCH_UPS]:
                self._turns[monitor.name] = next(self._numbers)
                changes += self._read(connection, monitor, end)
                self._retry[monitor.name] = now if monitor.problem is None else now + _RETRY_NS
                if self._monotonic() - now > _ROUND_NS:
                    break
        return changes

    def _note_late(
        self, connection: Connection, monitors: Sequence[LiveMonitor], end: FeedPosition
    ) -> None:
        """Have monitors know of late samples that the store has, and the feed has not given yet."""
        if self._given is None:
            return
        spans = list(self._given.spans(end))
        near = self._given.distance(end) <= _MOST_BEHIND
        missed = read_entries(connection, spans) if near else []
        if not near or compacted_position(connection, spans) != FEED_START:
            for monitor in monitors:
                monitor.reexamine()
            return
        for node, arrived in self._of_node(missed).items():
            names = {entry.layout for entry in arrived if entry.layout is not None}
            layouts = {name: find_intact_layout(connection, node, name) for name in names}
            _give(node, arrived, layouts, [each for each in monitors if node in each.nodes])

    def _read(
        self, connection: Connection, monitor: LiveMonitor, end: FeedPosition
    ) -> list[AlarmChange]:
        before = monitor.problem
        changes = self._guarded(monitor, partial(monitor.catch_up, connection, position=end))
        if monitor.problem is not None and monitor.problem != before:
            log.warning("monitor waits: monitor=%s reason=%s", monitor.name, monitor.problem)
        return changes

    def _guarded(
        self, monitor: LiveMonitor, work: Callable[[], list[AlarmChange]]
    ) -> list[AlarmChange]:
        """Have a monitor evaluate; its errors stop no other one."""
        try:
            return work()
        except SQLAlchemyError:  # of the whole store
            raise
        except EskinError as error:
            monitor.problem = str(error)
        except Exception as error:  # it is read anew, from what is stored
            log.exception("monitor failed: monitor=%s", monitor.name)
            monitor.problem = f"unexpected error: {type(error).__name__}"
            self._version = -1
            self._failed.add(monitor.name)
            self._monitors.pop(monitor.name, None)
            self._retry[monitor.name] = self._monotonic() + _RETRY_NS
        return []


def _give(
    node: str,
    arrived: Sequence[FeedEntry],
    layouts: Mapping[bytes, DescribedLayout | None],
    monitors: Sequence[LiveMonitor],
) -> None:
    """Give monitors the samples of a node's frames."""
    wanted = {
        channel
        for monitor in monitors
        for owner, channel in monitor.places.values()
        if owner == node
    }
    columns = _columns(arrived, layouts, wanted)
    for monitor in monitors:
        if not monitor.misses(arrived[0].cursor):  # it has read some of them from the store
            monitor.leave()
        for name, (owner, channel) in monitor.places.items():
            if owner == node and channel in columns:
                monitor.take(name, columns[channel])


def _columns(
    arrived: Sequence[FeedEntry],
    layouts: Mapping[bytes, DescribedLayout | None],
    wanted: set[str],
) -> dict[str, Samples]:
    """The samples of some channels in a node's frames."""
    runs: dict[str, list[ColumnRun]] = {channel: [] for channel in wanted}
    of_layout: dict[bytes, list[FeedEntry]] = {}
    for entry in arrived:
        of_layout.setdefault(entry.layout or b"", []).append(entry)
    for name, entries in of_layout.items():
        described = layouts.get(name)
        if described is None:
            continue
        places: dict[int, list[tuple[str, int]]] = {}
        for channel in wanted & described.places.keys():
            number, column = described.places[channel]
            places.setdefault(number, []).append((channel, column))
        if not places:
            continue
        heads = [read_head(entry.frame or b"").position for entry in entries]
        rows = [
            {"boot": head.boot, "sequence": head.sequence, "data": entry.frame}
            for head, entry in zip(heads, entries, strict=True)
        ]
        for number, run in runs_of_frames(rows, described, sorted(places)):
            skews = described.patches[number].skew
            for channel, column in places[number]:
                found = column_of(run, column, skews[column] if skews else 0)
                if found is not None:
                    runs[channel].append(found)
    return _samples(runs)


def _samples(runs: Mapping[str, Sequence[ColumnRun]]) -> dict[str, Samples]:
    """Each channel's runs in arrays; those that were sampled together share their instants."""
    shared: dict[tuple[tuple[int, ...], ...], Instants] = {}
    samples = {}
    for channel, found in runs.items():
        if not found:
            continue
        key = tuple((run.t, run.dt, run.error, run.lo.size) for run in found)
        if key not in shared:
            shared[key] = Instants.of(found)
        lo = np.concatenate([run.lo for run in found])
        hi = np.concatenate([run.hi for run in found])
        samples[channel] = Samples(shared[key], lo, hi)
    return samples
