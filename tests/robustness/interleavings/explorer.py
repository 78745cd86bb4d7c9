"""Enumerate schedules: each is run from the beginning, as a list of choices.

All of them, depth first, up to the order of steps that commute (sleep sets: Godefroid,
"Partial-Order Methods for the Verification of Concurrent Systems", chapter 5); all with a bounded
number of preemptions (Musuvathi and Qadeer, "Iterative context bounding", PLDI 2007), without that
reduction, with which a bound would miss some; or a sample with preemptions at random steps.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from random import Random
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from tests.robustness.interleavings.scheduler import Execution, Taken
    from tests.robustness.interleavings.steps import Step

    Run = Callable[["Search | Sample | Replay"], Execution]

_TRIES: Final = 20
"""So many times a schedule is drawn that was not run yet."""
_REPEATS: Final = 3
"""So many times a schedule is run again whose beginning took other steps."""
_LENGTH: Final = 60
"""Preemptions are drawn among so many steps, until a schedule's length is known."""


class NotReproducibleError(Exception):
    """A schedule's beginning took other steps when it was run again."""


@dataclass(slots=True)
class _Node:
    """A point of the search: what can go on, and what was tried."""

    waiting: Mapping[str, Step]
    last: str | None
    asleep: dict[str, Step]
    preemptions: int
    tried: dict[str, Taken | None] = field(default_factory=dict)
    chosen: str = ""

    def is_preemption(self, unit: str) -> bool:
        """Whether the choice of a unit interrupts one that could go on."""
        return self.last in self.waiting and unit != self.last


class Search:
    """A depth-first search.

    Args:
        preemptions: Most of them in a schedule; ``None`` for any number, and for sleep sets.

    Attributes:
        pruned: Schedules that were broken off, as equal ones had been run.

    Raises:
        NotReproducibleError: A schedule's beginning takes other steps each time.
    """

    def __init__(self, preemptions: int | None) -> None:
        self._most = preemptions
        self._path: list[_Node] = []
        self._at = 0
        self.pruned = 0

    def explore(self, run: Run) -> Iterator[Execution]:
        """Run all schedules, one by one; those that are broken off are not given."""
        while True:
            execution = self._run(run)
            if execution.complete:
                yield execution
            else:
                self.pruned += 1
            if not self._backtrack():
                return

    def _run(self, run: Run) -> Execution:
        """Run the next schedule; again where its beginning took other steps.

        The server has short locks of its own, and a unit that waits for one on a busy machine
        looks as if it waited for another unit.
        """
        for _ in range(_REPEATS):
            self._at = 0
            with suppress(NotReproducibleError):
                return run(self)
        self._at = 0
        return run(self)

    def choose(self, waiting: Mapping[str, Step], last: str | None) -> str | None:
        """The unit that goes on; ``None`` if all that could were tried before.

        Raises:
            NotReproducibleError: The beginning of the schedule took other steps than before.
        """
        if self._at < len(self._path):
            node = self._path[self._at]
            if node.waiting != waiting:
                raise NotReproducibleError(f"step {self._at}: {waiting}, and before {node.waiting}")
            return node.chosen
        node = self._extend(waiting, last)
        found = self._candidates(node)
        if not found:
            return None
        node.chosen = found[0]
        self._path.append(node)
        return node.chosen

    def took(self, taken: Taken) -> None:
        """A step was taken."""
        node = self._path[self._at]
        node.tried[node.chosen] = taken
        self._at += 1

    def _extend(self, waiting: Mapping[str, Step], last: str | None) -> _Node:
        if not self._path:
            return _Node(waiting, last, {}, 0)
        parent = self._path[-1]
        preemptions = parent.preemptions + parent.is_preemption(parent.chosen)
        taken, asleep = parent.tried[parent.chosen], {}
        if self._most is None and taken is not None:
            steps = (taken.step, *taken.freed)
            before = parent.asleep | {u: parent.waiting[u] for u in parent.tried}
            asleep = {
                unit: step
                for unit, step in before.items()
                if unit != parent.chosen and not any(step.depends_on(each) for each in steps)
            }
        return _Node(waiting, last, asleep, preemptions)

    def _candidates(self, node: _Node) -> list[str]:
        """What may be tried yet, that which goes on without a preemption first."""
        order = sorted(node.waiting, key=lambda unit: (unit != node.last, unit))
        return [
            unit
            for unit in order
            if unit not in node.tried
            and unit not in node.asleep
            and (self._most is None or node.preemptions + node.is_preemption(unit) <= self._most)
        ]

    def _backtrack(self) -> bool:
        """Go back to the last point with something untried; returns whether there is one."""
        while self._path:
            found = self._candidates(self._path[-1])
            if found:
                self._path[-1].chosen = found[0]
                return True
            self._path.pop()
        return False


class Sample:
    """Schedules with a few preemptions at random steps, each schedule once.

    Args:
        seed: Draws them.
        preemptions: Most of them in a schedule.
    """

    def __init__(self, seed: int, preemptions: int) -> None:
        self._random = Random(seed)  # noqa: S311 - no secret
        self._most = preemptions
        self._length = _LENGTH
        self._steps = 0
        self._first = 0
        self._points: frozenset[int] = frozenset()

    def explore(self, run: Run) -> Iterator[Execution]:
        """Run schedules that differ, until none is found in some tries."""
        drawn: set[tuple[int, frozenset[int]]] = set()
        seen: set[Sequence[str]] = set()
        failed = 0
        while failed < _TRIES:
            self._draw()
            if (self._first, self._points) in drawn:
                failed += 1
                continue
            drawn.add((self._first, self._points))
            self._steps = 0
            execution = run(self)
            self._length = max(2, len(execution.taken))
            failed = failed + 1 if execution.order in seen else 0
            if not failed:
                seen.add(execution.order)
                yield execution

    def _draw(self) -> None:
        """Draw who begins, and before which steps another one goes on."""
        self._first = self._random.randrange(6)
        count = self._random.randint(1, self._most)
        self._points = frozenset(self._random.randrange(1, self._length) for _ in range(count))

    def choose(self, waiting: Mapping[str, Step], last: str | None) -> str | None:
        """The unit that went on before, but at the drawn steps."""
        names = sorted(waiting)
        if last in waiting and self._steps not in self._points:
            return last
        others = [name for name in names if name != last] or names
        return others[(self._first + self._steps) % len(others)]

    def took(self, taken: Taken) -> None:
        """A step was taken."""
        del taken
        self._steps += 1


class Replay:
    """One schedule again.

    Args:
        order: The units, step by step.
    """

    def __init__(self, order: Sequence[str]) -> None:
        self._order = list(order)

    def choose(self, waiting: Mapping[str, Step], last: str | None) -> str | None:
        """The next one; any at the end."""
        if not self._order:
            return last if last in waiting else min(waiting)
        unit = self._order.pop(0)
        if unit not in waiting:
            raise NotReproducibleError(f"{unit} cannot go on; {sorted(waiting)} can")
        return unit

    def took(self, taken: Taken) -> None:
        """A step was taken."""
        del taken
