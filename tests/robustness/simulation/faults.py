"""Faults: what may happen to which part, and the plan of a seed."""

from __future__ import annotations

import random
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from tests.robustness.simulation.timeline import SECOND

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from tests.robustness.simulation.timeline import Timeline

NODES: Final = ("palm", "sole")
GATEWAYS: Final = ("g1", "g2")
CLOUD: Final = "cloud"
ACTIVE_S: Final = 8.0
"""Seconds in which faults begin and nodes measure."""

OF_NODES: Final = (
    "disconnects",
    "is reset",
    "loses power",
    "cannot write its flash",
    "measures much",
    "gets no acknowledgements",
    "loses what it sends",
    "has its subject erased",
)
OF_GATEWAYS: Final = (
    "dies",
    "dies before a commit",
    "dies after a commit",
    "dies before a request",
    "dies before it settles",
    "hangs",
    "cannot write its spool",
    "gets messages twice",
    "gets messages late",
    "is cut off",
    "loses an answer",
    "repeats a request later",
    "sends a request late",
    "has its clock set",
)
OF_CLOUD: Final = (
    "dies",
    "dies before a commit",
    "dies after a commit",
    "cannot commit",
    "is unavailable",
    "has its clock set",
)
KINDS: Final = tuple(
    (part, kind)
    for parts, kinds in ((NODES, OF_NODES), (GATEWAYS, OF_GATEWAYS), ((CLOUD,), OF_CLOUD))
    for part in parts
    for kind in kinds
)


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault.

    Attributes:
        number: In the order of the draw.
        part: What it strikes.
        kind: What happens.
        at: Seconds from the beginning.
        lasts: Seconds until the part is well again.
    """

    number: int
    part: str
    kind: str
    at: float
    lasts: float

    def __str__(self) -> str:
        return f"{self.number}: at {self.at:.3f} s {self.part} {self.kind}, for {self.lasts:.3f} s"


def plan(seed: int, count: int) -> list[Fault]:
    """Draw faults; the first of a larger number are the same."""
    found = []
    for number in range(count):
        draw = random.Random(f"{seed} fault {number}")  # noqa: S311 - a plan, no secret
        part, kind = draw.choice(KINDS)
        found.append(Fault(number, part, kind, draw.uniform(0.5, ACTIVE_S), draw.uniform(0.2, 3.0)))
    return found


class Faults:
    """Which faults strike now.

    Args:
        timeline: The time.
        chosen: The faults.
    """

    def __init__(self, timeline: Timeline, chosen: Sequence[Fault]) -> None:
        self._timeline = timeline
        self._chosen = sorted(chosen, key=lambda each: each.at)
        self._used: set[int] = set()
        self._draws = {each.number: timeline.draws(f"of fault {each.number}") for each in chosen}

    def lasting(self, part: str, kind: str) -> Fault | None:
        """A fault that is not over."""
        now = self._timeline.now / SECOND
        for each in self._chosen:
            if (each.part, each.kind) == (part, kind) and each.at <= now < each.at + each.lasts:
                return each
        return None

    def often(self, part: str, kind: str) -> bool:
        """Whether a fault that is not over strikes this time, as it does twice of three times."""
        fault = self.lasting(part, kind)
        return fault is not None and self._draws[fault.number].random() < 0.67

    def once(self, part: str, kind: str) -> Fault | None:
        """A fault that strikes the first time that it can, and never again."""
        now = self._timeline.now / SECOND
        for each in self._chosen:
            if (each.part, each.kind) == (part, kind) and each.at <= now:
                if each.number in self._used:
                    continue
                self._used.add(each.number)
                return each
        return None

    def of(self, part: str, kinds: Collection[str]) -> list[Fault]:
        """All faults of some kinds that a part will have."""
        return [each for each in self._chosen if each.part == part and each.kind in kinds]
