"""The contacts and the metal of one run of a scenario, with their variations drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from eskin_sensor_node.world.scenario.events import ApproachEvent, NoiseEvent

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin_sensor_node.world.scenario.events import AnyEvent, ContactEvent
    from eskin_sensor_node.world.scenario.script import Script
    from eskin_sensor_node.world.skin.skin import Skin


@dataclass(frozen=True, slots=True)
class _Actor:
    """Something that happens once.

    Attributes:
        begin: When, in s.
        end: When it is over.
        way: Points in m that it passes, (points, 3).
    """

    begin: float
    end: float
    way: Floats

    def meets(self, first: float, last: float) -> bool:
        """Whether it happens between two times."""
        return self.begin <= last and self.end >= first

    def lasts(self, seconds: Floats) -> NDArray[np.bool_]:
        """Whether it happens, at some times."""
        return np.asarray((seconds >= self.begin) & (seconds <= self.end))


@dataclass(frozen=True, slots=True)
class ContactActor(_Actor):
    """A contact.

    Attributes:
        event: How it is written.
        strength: Its force over the written one.
    """

    event: ContactEvent
    strength: float

    @property
    def label(self) -> str:
        """What its samples are labelled with."""
        return self.event.LABEL

    def patch(self, seconds: Floats) -> tuple[Floats, Floats, Floats]:
        """Radius in m, pressure in Pa and centre in m, (times, 3), while it lasts."""
        since = seconds - self.begin
        # Hertz: area ∝ force^(2/3), pressure ∝ force^(1/3).
        share = np.cbrt(self.event.course(since))
        radius = self.event.radius_m * share
        pressure = self.strength * self.event.pressure * share
        return radius, pressure, self._centre(since / self.event.duration_s)

    def _centre(self, progress: Floats) -> Floats:
        if len(self.way) == 1:
            return np.broadcast_to(self.way[0], (len(progress), 3))
        steps = np.linalg.norm(np.diff(self.way, axis=0), axis=1)
        reached = np.concatenate([[0.0], np.cumsum(steps)])
        passed = np.clip(progress, 0.0, 1.0) * reached[-1]
        return np.stack([np.interp(passed, reached, self.way[:, k]) for k in range(3)], axis=1)


@dataclass(frozen=True, slots=True)
class Approach(_Actor):
    """Metal that comes near.

    Attributes:
        event: How it is written.
        normal: The direction from which it comes.
    """

    event: ApproachEvent
    normal: Floats

    def position(self, seconds: Floats) -> Floats:
        """Where the metal is in m, (times, 3)."""
        height = self.event.height(seconds - self.begin)
        return np.asarray(self.way[0] + height[:, None] * self.normal)


@dataclass(frozen=True, slots=True)
class Cast:
    """Everything that happens in one run.

    Attributes:
        contacts: What touches the skin.
        approaches: Metal that comes near.
    """

    contacts: tuple[ContactActor, ...]
    approaches: tuple[Approach, ...]

    @classmethod
    def draw(cls, script: Script, skin: Skin, random: np.random.Generator) -> Self:
        """Draw the variations of a run."""
        contacts, approaches = [], []
        for event in script.event:
            for written in event.begins:
                # Four numbers each, so that one event's kind never moves another's draws.
                moves = random.uniform(-1.0, 1.0, 4)
                if isinstance(event, NoiseEvent):
                    continue
                begin = _begin(script, event, written, moves[0])
                end, way = begin + event.duration_s, _way(script, event, skin, moves[2:])
                if isinstance(event, ApproachEvent):
                    normal = skin.normals[skin.numbers[event.at]]
                    approaches.append(Approach(begin, end, way, event, normal))
                else:
                    strength = 1.0 + script.variation.force * moves[1]
                    contacts.append(ContactActor(begin, end, way, event, strength))
        return cls(tuple(contacts), tuple(approaches))


def _begin(script: Script, event: AnyEvent, written: float, move: float) -> float:
    latest = script.duration_s - event.duration_s
    return float(np.clip(written + script.variation.time_s * move, 0.0, max(latest, 0.0)))


def _way(script: Script, event: AnyEvent, skin: Skin, moves: Floats) -> Floats:
    """The written points, all moved alike, along the skin at the first of them."""
    numbers = [skin.numbers[name] for name in event.taxels]
    normal = skin.normals[numbers[0]]
    offset = script.variation.position_m * np.array([moves[0], moves[1], 0.0])
    along = offset - (offset @ normal) * normal
    return np.asarray(skin.positions[numbers] + along)
