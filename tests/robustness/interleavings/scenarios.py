"""Which operations run against each other, and how their schedules are explored."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from itertools import combinations_with_replacement, islice
from typing import TYPE_CHECKING, Final

from tests.robustness.interleavings.checks import find_violations
from tests.robustness.interleavings.explorer import Sample, Search
from tests.robustness.interleavings.operations import OPERATIONS

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.robustness.interleavings.scheduler import Execution, Scheduler
    from tests.robustness.interleavings.world import World

    Strategy = Search | Sample

PAIRS: Final = tuple(combinations_with_replacement(OPERATIONS, 2))
TRIPLES: Final = (
    ("ingest", "ingest", "erase"),
    ("ingest", "compact", "read"),
    ("ingest", "build", "compact"),
    ("ingest", "erase", "compact"),
    ("ingest", "move", "read"),
)


@dataclass(slots=True)
class Report:
    """What came of some schedules of a scenario.

    Attributes:
        schedules: How many ran to their end.
        complete: Whether these are all.
        pruned: How many were broken off, as equal ones had been run.
        steps: Most steps of a schedule.
        blocked: Steps that waited for a lock.
        violations: Schedules with the laws that they broke.
        seconds: How long it took.
        first: Which schedule broke a law first, from 1 on.
    """

    schedules: int = 0
    complete: bool = False
    pruned: int = 0
    steps: int = 0
    blocked: int = 0
    violations: list[tuple[Execution, list[str]]] = field(default_factory=list)
    seconds: float = 0.0
    first: int | None = None


def explore(
    world: World,
    scheduler: Scheduler,
    strategy: Strategy,
    *,
    most: int,
    progress: Callable[[Report], None] = lambda _: None,
) -> Report:
    """Run schedules, and check the laws after each.

    Args:
        world: Where they run.
        scheduler: Of the scenario, installed.
        strategy: Which schedules.
        most: How many of them.
        progress: Called after each.
    """
    report, begun = Report(), time.monotonic()
    executions = strategy.explore(scheduler.run)
    for execution in islice(executions, most):
        report.schedules += 1
        report.steps = max(report.steps, len(execution.taken))
        report.blocked += execution.blocked
        broken = find_violations(world, execution)
        if broken:
            report.violations.append((execution, broken))
            report.first = report.first or report.schedules
        report.seconds = time.monotonic() - begun
        progress(report)
    report.complete = next(executions, None) is None
    if isinstance(strategy, Search):
        report.pruned = strategy.pruned
    return report
