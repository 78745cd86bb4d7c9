"""Monitors over a store, evaluated as the cloud's job does, step by step."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from eskin_cloud.alarms.evaluator import Evaluator
from eskin_cloud.live.feed import read_entries
from eskin_cloud.store.descriptions import find_layout
from eskin_cloud.store.feed_entry import last_position
from eskin_cloud.store.schema.alarm_tables import monitors
from eskin_cloud.store.write.alarms import apply_changes, list_alarms, take_lease
from eskin_cloud.store.write.monitors import MonitorDefinition, put_monitor, settle_monitors
from sqlalchemy import update

from eskin.wire.slot import SLOTS
from eskin.wire.timestamp import SECOND
from tests.unit.cloud.messages import NODE

if TYPE_CHECKING:
    from eskin_cloud.store import Store
    from eskin_cloud.store.feed_entry import FeedPosition
    from sqlalchemy import Connection, RowMapping


def define(
    store: Store,
    formula: str,
    *,
    name: str = "squeeze",
    raise_on: str = "certain",
    missing: bool = False,
    clear_after: int = 0,
    escalate_after: int | None = None,
    since: int | None = None,
) -> None:
    """Define a monitor; by default evaluated from the clock's time on."""
    definition = MonitorDefinition(
        formula, NODE, raise_on, missing, "warning", clear_after, escalate_after
    )

    def work(connection: Connection) -> None:
        put_monitor(connection, name, definition, now=store.clock())
        if since is not None:
            connection.execute(update(monitors).values(settled=2 * since, changed=since))

    store.write(work).result(120)


class Live:
    """An evaluator that leads, and its place in the feed."""

    def __init__(
        self, store: Store, *, evaluator: Evaluator | None = None, silence: int = 15 * SECOND
    ) -> None:
        self.store = store
        self.evaluator = evaluator or Evaluator(
            store, silence=silence, clock=store.clock, monotonic=store.clock
        )
        lease = partial(take_lease, holder=self.evaluator.holder, now=store.clock(), alone=True)
        assert store.write(lease).result(120)
        with store.read() as connection:
            self._position = last_position(connection)
        self._stored: FeedPosition | None = None

    def step(self, *, most: int | None = None, fails: bool = False) -> None:
        """Evaluate what came since the last step, and store what follows.

        Args:
            most: Entries of each slot of the feed, which then is behind the store.
            fails: Whether what follows cannot be stored.
        """
        evaluator, store = self.evaluator, self.store
        evaluator.load()
        with store.read() as connection:
            end = last_position(connection)
            if most is not None:
                spans = list(self._position.spans(end))
                end = self._position.advance(each.after + most * SLOTS for each in spans)
                end = end.no_later_than(last_position(connection))
            entries = read_entries(connection, self._position.spans(end))
            layouts = {
                each.layout: find_layout(connection, each.node, each.layout)
                for each in entries
                if each.layout is not None
            }
        self._position = end
        changes, settled = evaluator.evaluate(entries, layouts, position=end)

        def work(connection: Connection) -> None:
            now = store.clock()
            assert apply_changes(connection, changes, holder=evaluator.holder, now=now)
            settle_monitors(connection, settled)

        if fails:
            evaluator.forget(stored=self._stored)
            self._position = self._stored or self._position
            return
        store.write(work).result(120)
        if evaluator.examined:
            self._stored = end


def alarms_of(store: Store) -> list[RowMapping]:
    """All alarms, the first one first."""
    with store.read() as connection:
        return list_alarms(connection, limit=10_000)[::-1]


def episodes_of(store: Store) -> list[tuple[int, int | None]]:
    """From and until which tick each alarm's episode lasts."""
    return sorted((row["began"], row["ended"]) for row in alarms_of(store))
