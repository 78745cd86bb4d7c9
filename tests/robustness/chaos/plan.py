"""The plan: which fault hits which part, when, and for how long; all of it from a seed."""

from __future__ import annotations

import random
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from tests.robustness.chaos.faults import (
    BROKER,
    DATABASE,
    EVERYWHERE,
    GATEWAY,
    MEMBER,
    MEMBERS,
    TIMED,
    WORKER,
    WORKERS,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

_SHORTEST_S: Final = 0.3
_LONGEST_S: Final = 6.0
_TOGETHER: Final = 0.35
"""How often another fault comes before the last one is over."""
_LONGEST_PAUSE_S: Final = 1.0
_LONG_S: Final = 300.0
"""Plans that last so long have the cloud away for a minute and a half."""
_OWN: Final[Mapping[str, tuple[str, ...]]] = {
    "broker": BROKER,
    DATABASE: (),
    **dict.fromkeys(MEMBERS, MEMBER),
}
"""What can happen to a part besides what can happen to all; to others, their clock can jump."""
_ALL: Final = dict.fromkeys(WORKERS, WORKER)
"""All that can happen to a part."""


@dataclass(frozen=True, slots=True)
class Stroke:
    """One fault of a plan.

    Attributes:
        fault: Its name.
        part: The part that it hits.
        begin: Seconds after the start.
        end: When it is over.
    """

    fault: str
    part: str
    begin: float
    end: float

    def __str__(self) -> str:
        return f"{self.begin:7.1f} s  {self.fault} {self.part} for {self.end - self.begin:.1f} s"


@dataclass(frozen=True, slots=True)
class Blow:
    """A stroke as it fell.

    Attributes:
        fault: Its name.
        part: The part that it hit.
        begin: UTC ns.
        end: When it had been taken back.
    """

    fault: str
    part: str
    begin: int
    end: int


def make_plan(seed: int, *, seconds: float, parts: Sequence[str]) -> list[Stroke]:
    """All strokes that are over before the end, by their begin.

    The gateway that is killed while the cloud is away, and the flood that follows, is in every
    plan: others have lost data there. So is a database that is killed under that flood; of a
    cluster, its first primary, which is away for so long that the standby is promoted; of Citus,
    the coordinator, then a worker, and another one that joins.

    Args:
        seed: Draws all.
        seconds: How long it lasts.
        parts: Names of those that faults can hit.
    """
    draw = random.Random(seed)  # noqa: S311 - a plan, no secret
    strokes = []
    busy = dict.fromkeys(parts, 0.0)
    now = 0.0
    for stroke in _opening(parts) + (_absence() if seconds >= _LONG_S else []):
        strokes.append(stroke)
        busy[stroke.part] = max(busy[stroke.part], stroke.end)
    now = max(stroke.end for stroke in strokes if stroke.part == "broker")
    for fault, part, length, pause, together in _endless(draw, parts):
        begin = max(now + pause, busy[part] + 0.1)
        if begin > now + _LONGEST_S:
            continue  # it is away for long
        if begin + length > seconds:
            break
        strokes.append(Stroke(fault, part, round(begin, 2), round(begin + length, 2)))
        busy[part] = begin + length
        now = begin if together else begin + length
    return sorted((s for s in strokes if s.end <= seconds), key=lambda stroke: stroke.begin)


def _opening(parts: Sequence[str]) -> list[Stroke]:
    """Cloud away, both gateways killed meanwhile, then everything comes at once."""
    strokes = [
        Stroke("cut", "cloud", 0.5, 6.0),
        Stroke("kill", "gateway-1", 2.5, 3.0),
        Stroke("kill", "gateway-2", 4.0, 4.5),
        Stroke("kill", "broker", 6.5, 7.0),
    ]
    if DATABASE in parts:
        strokes.append(Stroke("kill", DATABASE, 6.2, 6.8))
    if MEMBERS[0] in parts:
        strokes.append(Stroke("kill", MEMBERS[0], 6.2, 36.0))
    if WORKERS[0] in parts:
        strokes.append(Stroke("kill", WORKERS[0], 7.5, 8.5))
        strokes.append(Stroke("move shard", WORKERS[-1], 10.0, 12.0))
    return strokes


def _absence() -> list[Stroke]:
    """The cloud is away for long, whatever else happens meanwhile."""
    return [Stroke("cut", "cloud", 8.0, 98.0)]


def _endless(
    draw: random.Random, parts: Sequence[str]
) -> Iterator[tuple[str, str, float, float, bool]]:
    while True:
        part = draw.choice(parts)
        possible = _ALL.get(part) or (*EVERYWHERE, *_OWN.get(part, TIMED))
        possible += GATEWAY if part.startswith("gateway") else ()
        length = draw.uniform(_SHORTEST_S, draw.uniform(_SHORTEST_S, _LONGEST_S))
        pause = draw.uniform(0.0, _LONGEST_PAUSE_S)
        yield draw.choice(possible), part, length, pause, draw.random() < _TOGETHER
