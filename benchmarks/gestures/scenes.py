"""Gestures on emulated skins: scenarios, true pressures, and the intervals that a node states."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from eskin_sensor_node.columns.inversion import PadColumnsInversion, surroundings
from eskin_sensor_node.columns.sensing import SensingColumns
from eskin_sensor_node.kinds.generator import ColumnGenerator
from eskin_sensor_node.kinds.pad import PadWorld
from eskin_sensor_node.kinds.skin_section import SkinSection
from eskin_sensor_node.world.scenario import Stage
from eskin_sensor_node.world.scenario.script import Script

from eskin.contacts import Skin

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Events = list[dict[str, Any]]
    Play = tuple[Events, float]

THRESHOLD: Final = 3e3
_PERIOD: Final = 10_000_000
_TIME_ERROR: Final = 100_000
_BEFORE: Final = 0.15
_AFTER: Final = 0.2
_LEAST: Final = 3.0 * THRESHOLD
_MOST: Final = 10.0 * THRESHOLD
CLEAN_NOISE: Final = 1e-7
"""In A, before the ADC, as the profiles' data sheets have it."""
_SINGLE: Final = ("tap", "press", "hold", "slide", "swipe", "double tap")
_DOUBLE: Final = ("pinch", "spread", "rotation")
SCRIPTS: Final = (*_SINGLE, *_DOUBLE)
"""What scenarios mean to do; what they do is for the truth to say."""
PART: Final = 20
"""Gestures of one run: they share the skin's true parts, its noise and its broken taxels."""


@dataclass(frozen=True, slots=True)
class Condition:
    """What surrounds a gesture.

    Attributes:
        name: Of it.
        noise: Bounds of the noise, in A, of which a run draws one.
        broken: Share of taxels that are broken, and that the node has found to be.
        strange: Whether times and ways are drawn without regard to the templates.
    """

    name: str
    noise: Sequence[float] = (CLEAN_NOISE,)
    broken: float = 0.0
    strange: bool = False


CONDITIONS: Final = (
    Condition("clean"),
    Condition("noisy", (1e-6, 3e-6, 1e-5)),
    Condition("broken", broken=0.02),
    Condition("strange", strange=True),
)


class Record(NamedTuple):
    """One gesture.

    Attributes:
        script: What the scenario means to do.
        skin: The taxels.
        pressure: The true pressures in Pa, samples × taxels.
        instants: The true instants, ns.
        lo: Lower bounds that the node states.
        hi: Upper bounds.
        times: Enclosures of the instants that it states.
    """

    script: str
    skin: Skin
    pressure: Floats
    instants: NDArray[np.int64]
    lo: Floats
    hi: Floats
    times: NDArray[np.int64]


class _Profile:
    """A skin of pads, as `small-hand` has them, on a flat grid.

    Args:
        side: Taxels along each side.
        pitch: Their distance, in m.
        ohm: Resistance of an oscillator.
        folder: Where its scenario is written.
    """

    def __init__(self, side: int, pitch: float, ohm: float, folder: Path) -> None:
        self.side, self.pitch = side, pitch
        self._table = {
            "shape": "flat", "rows": side, "columns": side, "pitch_m": pitch, "crosstalk": 0.1,
        }  # fmt: skip
        file = folder / f"grid-{side}.toml"
        rows = "\n".join(
            f"{key} = {value!r}".replace("'", '"') for key, value in self._table.items()
        )
        file.write_text(f'description = "a flat skin"\nduration_s = 1.0\n\n[skin]\n{rows}\n')
        self._file, self._ohm = str(file), ohm
        self._sections: dict[float, SkinSection] = {}
        self.skin = Skin.grid(side, side, pitch=pitch, area=pitch**2)

    def section(self, noise: float) -> SkinSection:
        """Its data sheet, with a bound of the noise."""
        if noise not in self._sections:
            uniform = {"kind": "uniform", "bound": noise}
            self._sections[noise] = SkinSection(
                scenario=self._file,
                sampling_hz=1e9 / _PERIOD,
                stretch_ms=100.0,
                threshold_pa=THRESHOLD,
                pad={
                    "plate_area_m2": 0.9 * self.pitch**2,
                    "plate_distance_m": 5e-5,
                    "resistance_ohm": self._ohm,
                    "reference_Hz": 1.5e6,
                    "pressure_max_Pa": 5e4,
                    "noise": uniform,
                },
                thermometer={"noise": {"kind": "uniform", "bound": 1e-5}},
                hygrometer={"noise": {"kind": "uniform", "bound": 1e-7}},
            )
        return self._sections[noise]

    def script(self, events: Events, lasts: float) -> Script:
        """A scenario."""
        return Script.model_validate(
            {
                "description": "gestures",
                "duration_s": lasts,
                "skin": self._table,
                "variation": {"position_m": self.pitch / 2.0},
                "event": events,
            }
        )

    def name(self, place: Floats) -> str:
        """The taxel at a place in m."""
        column, row = np.clip(np.rint(place / self.pitch), 0, self.side - 1).astype(int).tolist()
        return f"t{row * self.side + column:03d}"

    def inside(self, random: np.random.Generator, margin: float) -> Floats:
        """A place that keeps away from the edge."""
        return random.uniform(margin, (self.side - 1) * self.pitch - margin, 2)


class Skins:
    """Plays gestures on a grid of 256 taxels of 4 mm, and a dense one of 576 of 2.5 mm.

    Args:
        folder: Where the scenarios of the bare skins are written; they are read again and again.
    """

    def __init__(self, folder: Path) -> None:
        self._grid = _Profile(16, 4e-3, 1.5e4, folder)
        self._dense = _Profile(24, 2.5e-3, 3.9e4, folder)

    def play(self, condition: Condition, count: int, seed: int) -> Iterator[Record]:
        """Play so many gestures.

        Args:
            condition: What surrounds them.
            count: How many.
            seed: Draws all of it.
        """
        for number, first in enumerate(range(0, count, PART)):
            random = np.random.default_rng((seed, number))
            scripts = [SCRIPTS[k % len(SCRIPTS)] for k in range(first, min(first + PART, count))]
            for profile, names in ((self._grid, _SINGLE), (self._dense, _DOUBLE)):
                own = [script for script in scripts if script in names]
                if own:
                    yield from _run(profile, own, condition, random)


def _run(
    profile: _Profile, scripts: Sequence[str], condition: Condition, random: np.random.Generator
) -> Iterator[Record]:
    events: Events = []
    windows = []
    at = 0.0
    for script in scripts:
        own, lasts = _PLAYS[script](profile, random, strange=condition.strange)
        for event in own:
            event["at_s"] += at + _BEFORE
        events += own
        windows.append((script, at, at + _BEFORE + lasts + _AFTER))
        at = windows[-1][2] + 0.1
    noise = float(random.choice(np.array(condition.noise)))
    section = profile.section(noise)
    played = profile.script(events, at + 1.0)
    seed = int(random.integers(2**62))
    names = [f"t{k:03d}" for k in range(len(profile.skin))]
    stage = Stage(played, names, seed=seed)
    sensing = SensingColumns(
        section.taxel,
        seeds=seed,
        numbers=np.arange(len(names)),
        companions=section.companions,
        places=names,
    )
    generator = ColumnGenerator(seed, np.arange(len(names)))
    sensing.world = PadWorld(section.taxel, generator, names, stage=stage)
    instants = _PERIOD * np.arange(math.ceil(at * 1e9 / _PERIOD), dtype=np.int64)
    true = instants + random.integers(-_TIME_ERROR, _TIME_ERROR + 1, instants.size)
    sensed = sensing.sense(0, instants, np.maximum(true, 0)[None] / 1e9)
    broken = random.random(len(names)) < condition.broken
    inversion = PadColumnsInversion(section.taxel, section.companions)
    inversion.measure(sensed.readings[0].codes)
    inversion.separate(surroundings(stage.skin.neighbours, ~broken))
    lo, hi = (bounds.copy() for bounds in inversion.pressure)
    lo[broken], hi[broken] = -np.inf, np.inf
    pressure = sensed.truth["pressure"]
    assert np.all((lo <= pressure) & (pressure <= hi)), "an interval without its truth"
    times = np.stack([instants - _TIME_ERROR, instants + _TIME_ERROR], axis=1)
    for name, begin, end in windows:
        own_ = slice(*(math.ceil(each * 1e9 / _PERIOD) for each in (begin, end)))
        yield Record(
            name, profile.skin, pressure[:, own_].T, true[own_], lo[:, own_].T, hi[:, own_].T,
            times[own_],
        )  # fmt: skip


def _touch(random: np.random.Generator, kind: str, lasts: float, at: float = 0.0) -> dict[str, Any]:
    radius = random.uniform(4.5e-3, 7.5e-3)
    # Evenly on a logarithmic scale: weak touches are as frequent as strong ones.
    pressure = math.exp(random.uniform(math.log(_LEAST), math.log(_MOST)))
    event = {
        "kind": kind, "at_s": at, "duration_s": lasts, "radius_m": radius,
        "force_N": pressure * math.pi * radius**2,
    }  # fmt: skip
    if kind in {"hold", "slide"}:
        event["rise_s"] = min(random.uniform(0.03, 0.1), lasts / 4.0)
    return event


def _spot(kind: str, least: float, most: float) -> Callable[..., Play]:
    def play(profile: _Profile, random: np.random.Generator, *, strange: bool) -> Play:
        lasts = random.uniform(0.03, 1.2) if strange else random.uniform(least, most)
        event = _touch(random, kind, lasts)
        event["at"] = profile.name(profile.inside(random, 2.0 * profile.pitch))
        return [event], lasts

    return play


def _way(least: float, most: float) -> Callable[..., Play]:
    def play(profile: _Profile, random: np.random.Generator, *, strange: bool) -> Play:
        length = random.uniform(0.0, 0.05) if strange else random.uniform(0.034, 0.05)
        while True:
            begin = profile.inside(random, profile.pitch)
            angle = random.uniform(-math.pi, math.pi)
            end = begin + length * np.array([math.cos(angle), math.sin(angle)])
            if profile.pitch <= end.min() and end.max() <= (profile.side - 2) * profile.pitch:
                break
        speed = random.uniform(0.03, 0.6) if strange else random.uniform(least, most)
        lasts = max(length / speed, 0.05)
        event = _touch(random, "slide", lasts)
        event["path"] = [profile.name(begin), profile.name(end)]
        return [event], lasts

    return play


def _double_tap(profile: _Profile, random: np.random.Generator, *, strange: bool) -> Play:
    first = _touch(random, "tap", random.uniform(0.06, 0.18))
    pause = random.uniform(0.02, 0.6) if strange else random.uniform(0.06, 0.22)
    second = _touch(random, "tap", random.uniform(0.06, 0.18), at=first["duration_s"] + pause)
    place = profile.inside(random, 3.0 * profile.pitch)
    away = random.uniform(-0.02, 0.02, 2) if strange else random.uniform(-0.004, 0.004, 2)
    first["at"], second["at"] = profile.name(place), profile.name(place + away)
    return [first, second], second["at_s"] + second["duration_s"]


def _fingers(
    profile: _Profile, random: np.random.Generator, radii: tuple[float, float], turn: float
) -> Play:
    """Two fingers around a place, whose distance and angle change evenly."""
    middle = (profile.side - 1) * profile.pitch / 2.0 + random.uniform(-0.004, 0.004, 2)
    lasts = random.uniform(0.4, 1.2)
    angle = random.uniform(-math.pi, math.pi)
    shares = np.linspace(0.0, 1.0, 13)
    radius = radii[0] + shares * (radii[1] - radii[0])
    angles = angle + shares * turn
    ways = np.stack([radius * np.cos(angles), radius * np.sin(angles)], axis=1)
    events = []
    for sign in (1.0, -1.0):
        event = _touch(random, "slide", lasts)
        event["radius_m"] *= 0.6
        event["force_N"] *= 0.6**2
        path = [profile.name(middle + sign * way) for way in ways]
        event["path"] = [name for k, name in enumerate(path) if k == 0 or path[k - 1] != name]
        events.append(event)
    for event in events:
        event["at_s"] = random.uniform(0.0, 0.02)
        if len(event["path"]) == 1:
            event["path"] *= 2
    return events, lasts + 0.02


def _pinch(profile: _Profile, random: np.random.Generator, *, strange: bool) -> Play:
    if strange:
        radii = random.uniform(0.008, 0.024), random.uniform(0.008, 0.024)
        return _fingers(profile, random, radii, random.uniform(-1.5, 1.5))
    radii = random.uniform(0.020, 0.024), random.uniform(0.009, 0.011)
    return _fingers(profile, random, radii, random.uniform(-0.2, 0.2))


def _spread(profile: _Profile, random: np.random.Generator, *, strange: bool) -> Play:
    if strange:
        return _pinch(profile, random, strange=True)
    radii = random.uniform(0.009, 0.011), random.uniform(0.020, 0.024)
    return _fingers(profile, random, radii, random.uniform(-0.2, 0.2))


def _rotation(profile: _Profile, random: np.random.Generator, *, strange: bool) -> Play:
    if strange:
        return _pinch(profile, random, strange=True)
    radius = random.uniform(0.013, 0.021)
    turn = math.copysign(random.uniform(0.9, 1.8), random.uniform(-1.0, 1.0))
    return _fingers(profile, random, (radius, radius * random.uniform(0.92, 1.08)), turn)


_PLAYS: Final[dict[str, Callable[..., Play]]] = {
    "tap": _spot("tap", 0.06, 0.2),
    "press": _spot("press", 0.35, 0.7),
    "hold": _spot("hold", 0.85, 1.5),
    "slide": _way(0.03, 0.11),
    "swipe": _way(0.25, 0.6),
    "double tap": _double_tap,
    "pinch": _pinch,
    "spread": _spread,
    "rotation": _rotation,
}
