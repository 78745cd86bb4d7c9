"""Random truths of small skins, and what is known of them; and what answers must not say."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.contacts import Skin, find_contacts, track_contacts
from eskin.gestures import Gesture, Gestures, Templates, find_gestures
from eskin.interval import Verdict
from tests.unit.eskin.gestures.oracle import Found, Touch, Truth

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Sets = list[frozenset[int]]

THRESHOLD: Final = 1000.0
TEMPLATES: Final = Templates(
    tap_ns=25, hold_ns=55, still_m=1.1, slide_m=2.0, swipe_m_per_s=3.9e7, pause_ns=35,
    apart_m=1.2, together_ns=15, span_m=4.5, scale=1.5,
)  # fmt: skip
"""For a skin with a pitch of 1 m, and samples about 10 ns apart."""
_SLACK: Final = 1e-9


@dataclass(frozen=True)
class World:
    """A truth, and what is known of it.

    Attributes:
        skin: The taxels.
        instants: The truth's instants, also of instants before and after the record.
        pressed: The taxels that are pressed then.
        begin: First instant of the record.
        certain: In the record, the taxels that are known to be pressed.
        possible: Those that are not known not to be.
        times: Enclosures of the record's instants.
    """

    skin: Skin
    instants: Sequence[int]
    pressed: Sets
    begin: int
    certain: Sets
    possible: Sets
    times: Sequence[tuple[int, int]]

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Pressures that say so."""
        shape = len(self.times), len(self.skin)
        lo, hi = np.zeros(shape), np.full(shape, 500.0)
        for k, (certain, possible) in enumerate(zip(self.certain, self.possible, strict=True)):
            lo[k, sorted(certain)] = 1500.0
            hi[k, sorted(possible)] = 2000.0
        return lo, hi

    def found(self, engine: Callable[..., Gestures] = find_gestures) -> Gestures:
        """The answers."""
        return engine(*self.bounds, self.times, self.skin, THRESHOLD, TEMPLATES)

    def truth(self) -> Truth:
        """What the oracle says."""
        return Truth(self.skin, self.instants, self.pressed, TEMPLATES)


def draw_world(random: np.random.Generator, *, known: bool = False) -> World:
    """Fingers that come, move and go on a small grid; each taxel then more or less known.

    Args:
        random: Draws it.
        known: Whether all of it is known, and nothing happens at the ends of the record.
    """
    draw, shapes, lengths = _PLAYS[int(random.integers(len(_PLAYS)))]
    rows, columns = shapes[int(random.integers(len(shapes)))]
    areas = random.uniform(0.5, 2.0, rows * columns)
    skin = Skin.grid(rows, columns, pitch=1.0, area=areas)
    margin = 1 if known else int(random.choice([0, 0, 1, 3]))
    count = int(random.integers(*lengths))
    pressed = draw(random, skin, count + 2 * margin)
    if known:
        for k in (0, 1, -2, -1):
            pressed[k] = frozenset()
    instants = np.cumsum(random.integers(6, 15, len(pressed)))
    times = np.stack([instants, instants], axis=1)
    if not known:
        times[:, 0] -= random.integers(0, 4, len(times))
        times[:, 1] += random.integers(0, 4, len(times))
        np.maximum.accumulate(times, axis=0, out=times)
        times[:, 0] = np.minimum.accumulate(times[::-1, 0])[::-1]
        times = np.stack([np.minimum(times[:, 0], instants), np.maximum(times[:, 1], instants)], 1)
    own = slice(margin, margin + count)
    doubt = 0.0 if known else float(random.choice([0.0, 0.01, 0.05, 0.3]))
    certain = [frozenset(k for k in each if random.random() >= doubt) for each in pressed[own]]
    possible = [
        each | {k for k in range(len(skin)) if random.random() < doubt / 4} for each in pressed[own]
    ]
    if not known and random.random() < 0.2:
        # Fingers come and go softly: their first and last instants are not certain.
        soft = int(random.integers(1, count))
        certain[:soft] = [frozenset[int]()] * soft
        soft = int(random.integers(1, 4))
        certain[-soft:] = [frozenset[int]()] * soft
    if not known and random.random() < 0.15:
        broken = int(random.integers(len(skin)))
        certain = [each - {broken} for each in certain]
        possible = [each | {broken} for each in possible]
    if not known and random.random() < 0.1:
        lost = int(random.integers(count))
        certain[lost], possible[lost] = frozenset(), frozenset(range(len(skin)))
    spans = [(int(low), int(high)) for low, high in times[own]]
    return World(skin, instants.tolist(), pressed, margin, certain, possible, spans)


def _draw_fingers(random: np.random.Generator, skin: Skin, count: int) -> Sets:
    """Some fingers, anywhere, for any time."""
    pressed: list[set[int]] = [set() for _ in range(count)]
    for _ in range(int(random.integers(1, 4))):
        at = int(random.integers(0, count))
        lasts = int(random.choice([1, 2, 3, 5, 8, 12]))
        place = random.choice(skin.positions)
        step = random.normal(0.0, random.choice([0.0, 0.4, 0.9]), 2)
        radius = float(random.choice([0.4, 0.8, 1.1]))
        for k in range(at, min(at + lasts, count)):
            pressed[k] |= _disc(skin, place, radius)
            place = place + step
    return [frozenset(each) for each in pressed]


def _draw_way(random: np.random.Generator, skin: Skin, count: int) -> Sets:
    """One finger that goes along the row in the middle, or stays."""
    pressed = [frozenset[int]()] * count
    row = (skin.positions[:, 1].max() + 1.0) // 2.0
    far = float(skin.positions[:, 0].max())
    first, last = sorted(random.choice(np.arange(2, count - 2), 2, replace=False).tolist())
    begin, end = (
        random.uniform(0.0, far, 2) if random.random() < 0.7 else [random.uniform(0.0, far)] * 2
    )
    radius = float(random.choice([0.8, 1.1]))
    for k in range(first, last + 1):
        share = (k - first) / max(last - first, 1)
        pressed[k] = _disc(skin, np.array([begin + share * (end - begin), row]), radius)
    return pressed


def _draw_two(random: np.random.Generator, skin: Skin, count: int) -> Sets:
    """Two fingers around the middle, which turn and move together or apart."""
    pressed = [frozenset[int]()] * count
    middle = skin.positions.max(axis=0) / 2.0
    angle, turn = (
        random.uniform(-np.pi, np.pi),
        random.choice([0.0, 1.0]) * random.uniform(-2.0, 2.0),
    )
    radii = random.uniform(1.0, 2.8, 2) if random.random() < 0.6 else [random.uniform(1.5, 2.8)] * 2
    lasts = count - 4
    for k in range(2, count - 2):
        share = (k - 2) / max(lasts - 1, 1)
        radius = radii[0] + share * (radii[1] - radii[0])
        way = radius * np.array([np.cos(angle + share * turn), np.sin(angle + share * turn)])
        pressed[k] = _disc(skin, middle + way, 0.75) | _disc(skin, middle - way, 0.75)
    if random.random() < 0.3:
        pressed[2] = _disc(skin, middle, 0.75)
    return pressed


_PLAYS: Final = (
    (_draw_fingers, ((1, 7), (2, 4), (3, 3), (1, 5), (4, 5)), (4, 12)),
    (_draw_way, ((1, 8), (2, 6), (3, 6)), (6, 16)),
    (_draw_two, ((5, 5), (6, 6), (5, 7)), (8, 14)),
)
"""Ways to draw truths, each with its skins and its numbers of instants."""


def _disc(skin: Skin, place: Floats, radius: float) -> frozenset[int]:
    far = np.linalg.norm(skin.positions - place, axis=1)
    return frozenset(np.flatnonzero(far <= radius).tolist())


def check(world: World, found: Gestures) -> Counter[str]:
    """Hold answers against the truth; counts what was compared.

    Raises:
        AssertionError: A certain answer is wrong, or a gesture of the truth is missing.
    """
    truth = world.truth()
    labels = _labels(world)
    known = {id(touch): _labels_of(touch, world, labels) for touch in truth.touches}
    counts: Counter[str] = Counter()
    for answer in found:
        counts[f"{answer.kind} {answer.verdict.name.lower()}"] += 1
        if answer.verdict is Verdict.CERTAIN:
            assert answer.contacts
            assert any(_fits(answer, true, world, known) for true in truth.gestures), answer
    for true in truth.gestures:
        counts[f"true {true.kind}"] += 1
        if _is_sought(true, world, known):
            counts["sought"] += 1
            assert any(_fits(answer, true, world, known) for answer in found), true
    return counts


def _labels(world: World) -> Iterator[dict[int, int]] | list[dict[int, int]]:
    """At each instant of the record, the label of each certainly pressed taxel."""
    lo, hi = world.bounds
    tracks = track_contacts(lo, hi, world.times, world.skin, THRESHOLD)
    found = []
    for k in range(len(world.times)):
        own = tracks.cores["track"][tracks.cores["sample"] == k].tolist()
        cores = find_contacts(lo[k], hi[k], world.skin, THRESHOLD).core_of.tolist()
        found.append({taxel: own[core] for taxel, core in enumerate(cores) if core >= 0})
    return found


def _labels_of(touch: Touch, world: World, labels: object) -> frozenset[int]:
    assert isinstance(labels, list)
    return frozenset(
        labels[k - world.begin][taxel]
        for k, taxel in touch.cells
        if 0 <= k - world.begin < len(labels) and taxel in labels[k - world.begin]
    )


def _is_sought(true: Found, world: World, known: dict[int, frozenset[int]]) -> bool:
    """Whether an answer must show it: in the record, and no pair with a touch without a core."""
    inside = range(world.begin, world.begin + len(world.times))
    if any(not any(k in inside for k, _ in touch.cells) for touch in true.touches):
        return False
    return len(true.touches) == 1 or all(known[id(touch)] for touch in true.touches)


def _may_be_one(true: Found, world: World) -> bool:
    """Whether two touches lie within one component of the possibly pressed taxels."""
    # All that is before the record, and all after it, may be pressed.
    every = frozenset(range(len(world.skin)))
    possible = Truth(world.skin, [0] * (len(world.times) + 2), [every, *world.possible, every])
    one, two = (
        next(each for each in possible.touches if _shifted(touch, 1 - world.begin) & each.cells)
        for touch in true.touches
    )
    return one is two


def _shifted(touch: Touch, by: int) -> frozenset[tuple[int, int]]:
    return frozenset((k + by, taxel) for k, taxel in touch.cells)


def _fits(answer: Gesture, true: Found, world: World, known: dict[int, frozenset[int]]) -> bool:
    """Whether an answer is one about this gesture, and all its bounds hold."""
    if answer.kind != true.kind:
        return False
    own = [known[id(touch)] for touch in true.touches]
    if len(own) == 1 and not own[0]:
        if answer.contacts:
            return False
    elif len(own) == 2 and not answer.contacts:
        if not _may_be_one(true, world):
            return False
    elif len(answer.contacts) != len(own) or not (
        all(label in each for label, each in zip(answer.contacts, own, strict=True))
        or (
            true.kind != "double tap"
            and all(label in each for label, each in zip(answer.contacts, own[::-1], strict=True))
        )
    ):
        return False
    begin, end = world.instants[true.first], world.instants[true.last]
    return (
        within(begin, answer.begin)
        and within(end, answer.end)
        and angle_within(true.direction, answer.direction)
        and angle_within(true.angle, answer.angle)
        and scale_within(true.scale, answer.scale)
        and places_within(true, answer, own)
    )


def places_within(true: Found, answer: Gesture, own: Sequence[frozenset[int]]) -> bool:
    """Whether each touch begins and ends within its bounds."""
    if not answer.places:
        # Of touches that may be one, and of those that are not waited for.
        return len(own) == 2 and not answer.contacts
    touches = list(true.touches)
    if len(own) == 2 and answer.contacts[0] not in own[0]:
        touches.reverse()
    return len(answer.places) == len(touches) and all(
        low <= x <= high
        for touch, place in zip(touches, answer.places, strict=True)
        for k, bounds in ((touch.first, place.begin), (touch.last, place.end))
        for x, (low, high) in zip(touch.places[k], bounds, strict=True)
    )


def scale_within(scale: float | None, bounds: tuple[float, float] | None) -> bool:
    """Whether a factor lies within bounds."""
    if scale is None or bounds is None:
        return True
    return bounds[0] - _SLACK <= scale <= bounds[1] + _SLACK


def within(instant: int, bounds: tuple[int | None, int | None]) -> bool:
    """Whether an instant lies within bounds, of which each may be open."""
    low, high = bounds
    return (low is None or low <= instant) and (high is None or instant <= high)


def angle_within(angle: float | None, bounds: tuple[float, float] | None) -> bool:
    """Whether an angle, up to whole turns, lies within bounds."""
    if angle is None or bounds is None:
        return True
    turns = math.ceil((bounds[0] - _SLACK - angle) / math.tau)
    return angle + turns * math.tau <= bounds[1] + _SLACK
