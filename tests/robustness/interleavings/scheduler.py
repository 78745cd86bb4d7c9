"""Run units one step at a time, in an order that is chosen step by step."""

from __future__ import annotations

import threading
import time
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Protocol

from eskin.errors import StoreError
from tests.robustness.interleavings.gate import Gate, find_shared
from tests.robustness.interleavings.operations import make_unit
from tests.robustness.interleavings.world import SLOTS_USED

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from sqlalchemy import URL

    from tests.robustness.interleavings.operations import Unit
    from tests.robustness.interleavings.steps import Step
    from tests.robustness.interleavings.world import World

_GLANCE_S: Final = 0.002
"""So long a step may run before the server is asked whether it waits for a lock."""
_LONGEST_S: Final = 15.0


class StuckError(Exception):
    """A unit neither goes on nor waits for a lock."""


@dataclass(frozen=True, slots=True)
class Taken:
    """A step that was taken.

    Attributes:
        step: The step.
        blocked: Whether it had to wait for a lock of another unit.
        freed: Steps of other units that had waited, and went on by it.
    """

    step: Step
    blocked: bool
    freed: tuple[Step, ...]


class Chooser(Protocol):
    """Chooses the next step."""

    def choose(self, waiting: Mapping[str, Step], last: str | None) -> str | None:
        """The unit that goes on; ``None`` to break off.

        Args:
            waiting: The next step of each unit that can go on.
            last: The unit that went on before.
        """
        ...

    def took(self, taken: Taken) -> None:
        """A step was taken."""
        ...


@dataclass(slots=True)
class Execution:
    """A schedule that was run.

    Attributes:
        units: The units, with what they got.
        taken: The steps, in their order.
        complete: Whether it ran to the end.
        deadlock: Which steps wait for each other.
    """

    units: list[Unit]
    taken: list[Taken] = field(default_factory=list)
    complete: bool = True
    deadlock: list[Step] = field(default_factory=list)

    @property
    def order(self) -> tuple[str, ...]:
        """The units, step by step."""
        return tuple(each.step.unit for each in self.taken)

    @property
    def blocked(self) -> int:
        """How many steps had to wait."""
        return sum(each.blocked for each in self.taken)

    def lines(self) -> list[str]:
        """The schedule, a step a line."""
        return [f"{each.step}{' (waits)' if each.blocked else ''}" for each in self.taken]


class Serial:
    """Lets each unit do all it has to do, one after the other."""

    def choose(self, waiting: Mapping[str, Step], last: str | None) -> str | None:
        return last if last in waiting else min(waiting)

    def took(self, taken: Taken) -> None:
        del taken


class Scheduler:
    """Runs schedules of some operations.

    Args:
        world: Where they run.
        operations: Their names.

    Attributes:
        names: The units: operations, and which of its kind each is.
        place: The database on which they run: that of a move, if there is one.
    """

    def __init__(self, world: World, operations: Sequence[str]) -> None:
        self.world = world
        self.names = [
            f"{name}#{operations[:k].count(name) + 1}" for k, name in enumerate(operations)
        ]
        self._moves = operations.count("move")
        self.place: URL = world.target if self._moves else world.main
        self._gate = Gate(SLOTS_USED)

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Stand before all statements, and find out which tables several units touch."""
        with self._gate.installed():
            self._gate.seen = []
            for order in (self.names, self.names[::-1]):
                self._run_freely(order)
            self._gate.shared = find_shared(self._gate.seen)
            self._gate.seen = None
            yield

    @property
    def shared(self) -> frozenset[str]:
        """The tables that a unit writes and another touches."""
        return self._gate.shared or frozenset()

    def run(self, chooser: Chooser) -> Execution:
        """Run a schedule from the beginning.

        Raises:
            StuckError: A unit neither goes on nor waits for a lock.
        """
        units = self._prepare()
        execution = Execution(list(units.values()))
        self._gate.arm({f"unit_{k}": name for k, name in enumerate(self.names)})
        threads = [
            threading.Thread(target=self._live, args=(unit,), name=unit.name, daemon=True)
            for unit in units.values()
        ]
        for thread in threads:
            thread.start()
        try:
            self._schedule(execution, chooser)
        finally:
            self._gate.open()
            for thread in threads:
                thread.join(_LONGEST_S)
        if any(thread.is_alive() for thread in threads):
            raise StuckError("a unit does not end")
        return execution

    def _prepare(self) -> dict[str, Unit]:
        world, units = self.world, {}
        stores = [world.cloud(k, self.place).store for k in range(len(self.names))]
        for store in stores:  # a writer may still be at work, if it answered before its commit
            with suppress(StoreError):
                store.write_slots(SLOTS_USED, lambda *_: None).result(_LONGEST_S)
        world.restore(self.place)
        for store in stores:  # this ends a fault, too
            store.clear_caches()
            store.write_and_wait(lambda _: None)
        batches = iter(world.batches)
        for k, name in enumerate(self.names):
            batch = next(batches) if name.startswith("ingest") else []
            units[name] = make_unit(
                *(name, world, self.place), number=k, batch=batch, moves=self._moves
            )
        return units

    def _live(self, unit: Unit) -> None:
        try:
            unit.run()
        finally:
            self._gate.end(unit.name)

    def _run_freely(self, order: Sequence[str]) -> None:
        units = self._prepare()
        self._gate.arm({f"unit_{k}": name for k, name in enumerate(self.names)})
        for name in order:
            units[name].run()
        self._gate.open()

    def _schedule(self, execution: Execution, chooser: Chooser) -> None:
        gate, last = self._gate, None
        blocked: dict[str, Step] = {}
        self._settle(())
        while True:
            waiting = gate.waiting()
            if not waiting:
                running = gate.running()
                if running:
                    execution.deadlock = [blocked[name] for name in sorted(running)]
                return
            last = chooser.choose(waiting, last)
            if last is None:
                execution.complete = False
                return
            step = gate.release(last)
            before = dict(blocked)
            now = self._settle(blocked)
            blocked = {name: each for name, each in (blocked | {last: step}).items() if name in now}
            freed = tuple(each for name, each in before.items() if name not in blocked)
            taken = Taken(step, last in blocked, freed)
            execution.taken.append(taken)
            chooser.took(taken)

    def _settle(self, blocked: Collection[str]) -> set[str]:
        """Wait until each unit stops, ends or waits for a lock; returns those that wait.

        Args:
            blocked: Those that waited before.
        """
        roles = {f"unit_{k}": name for k, name in enumerate(self.names)}
        known, until = set(blocked), time.monotonic() + _LONGEST_S
        while True:
            running = self._gate.settle(_GLANCE_S, but=known)
            if not running:
                return running
            held = {
                roles[role]: {roles.get(each, each) for each in holders}
                for role, holders in self.world.blocked(self.place).items()
                if role in roles
            }
            waiting, stopped = running & held.keys(), self._gate.waiting().keys()
            while True:  # a session that a running unit blocks may go on in an instant
                still = {name for name in waiting if not held[name] & (running - waiting)}
                # So may one that is blocked by a session that no unit directs: what a refused write
                # left is rolled back after its unit has ended.
                still = {name for name in still if held[name] & (stopped | waiting)}
                if still == waiting:
                    break
                waiting = still
            if waiting == self._gate.running():
                return waiting
            if time.monotonic() > until:
                raise StuckError(f"{sorted(running)}: neither stop nor wait for a lock")
            known = set()
