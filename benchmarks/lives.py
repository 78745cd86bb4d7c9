"""Lives of a taxel: is its wear ever enclosed wrongly, and how soon is it certain?

``python -m benchmarks.lives --lives 200 --seed 1`` emulates pads for two years each, a sample a
minute through the emulated chain, thermometer and hygrometer, and identifies C0 and E from what
these state (docs/wear.md). Exit status 1 if a statement was wrong.

A life has days of touches, nights at rest, and a known load each morning. Its C0 and its E do not
drift, drift steadily, from some instant on, or at rates that change; within the stated bound. Noise
is Gaussian and exceeds its reach in 0.27 % of samples; there are spikes, water films, loads that
were not noticed at night, hysteresis, and traces that are broken for a while or for good.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from functools import cache
from math import inf
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from eskin_sensor_node.firmware.inversion.hygrometer import REFERENCE_HUMIDITY
from eskin_sensor_node.firmware.inversion.pad import REFERENCE_TEMPERATURE
from eskin_sensor_node.kinds.generator import ColumnGenerator
from eskin_sensor_node.kinds.parameters import TRUE_VACUUM_PERMITTIVITY, draw_part
from eskin_sensor_node.kinds.registry import Taxel
from eskin_sensor_node.machine.compilation import compiled_inversion
from eskin_sensor_node.machine.data_sheet import data_sheet
from eskin_sensor_node.profile import Profile
from eskin_sensor_node.tools.dataset.measurement import Chains
from pydantic import TypeAdapter
from rich.console import Console

from benchmarks.report import Row, as_table, at_least, at_most
from eskin.constants import VACUUM_PERMITTIVITY
from eskin.identification import (
    estimate,
    find_wear,
    independent_coverage,
    mean_drift,
    relaxed_intersection,
    remaining_time,
    rest_capacitance,
    stiffness,
)
from eskin.interval import Interval
from eskin.monitor import SharedError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_sensor_node.kinds.settings import TaxelSection
    from numpy.typing import NDArray

    from eskin.interval import Floats

    Flags = NDArray[np.bool_]
    Integers = NDArray[np.int64]

LIVES: Final = 200
DAYS: Final = 730
DAY: Final = 1440
"""Minutes."""
MINUTE: Final = 60 * 10**9
_YEAR_S: Final = 365.0 * 86400.0
DRIFT: Final = 0.12 / _YEAR_S
"""Stated bound of ``abs(d ln p/dt)``, of C0 and of E, in 1/s."""
MEMORY: Final = 7 * DAY
OUTLIERS: Final = 400
"""Of a week: a film of 3 h, a night's load of 1 h and what it leaves, noise, and spikes."""
_FILM_MIN: Final = 180
_LEAN_MIN: Final = 60
_NOISE_WRONG: Final = 100
"""Samples of a week whose noise exceeds its reach, at most."""
LOAD_MEMORY: Final = 60
"""Mornings."""
LOAD_OUTLIERS: Final = 10
_LIMITS: Final = 0.05
"""A pad fails where its C0 is so far from its nominal value, relative."""
_STIFFNESS_LIMITS: Final = 0.15
_LOAD_PA: Final = 2e4
_LOAD_TOLERANCE: Final = 0.005
_MOST_PA: Final = 2e4
_HYSTERESIS: Final = 0.02
_DECAY_MIN: Final = 15.0
_RESIDUAL: Final = 5e-4
"""Stated bound of the strain that remains an hour after the last touch of a day."""
_BEFORE_MIN: Final = 30
"""Minutes of rest before a morning's load."""
_BEFORE_OUTLIERS: Final = 3
_SAME_AIR: Final = 1.5e-3
"""How far the permittivity may change meanwhile, and C0, relative."""
_SPIKE: Final = 1e-4
_EVERY: Final = 360
"""Minutes from one enclosure to the next."""
_SNAPSHOTS: Final = 90 * DAY
"""Minutes between two enclosures whose mean drift is taken for a constant one."""
_OPEN_F: Final = 1e-18
_COVERAGE: Final = 0.9973
_SLOWEST_D: Final = 60.0
_MEDIAN: Final = "delay until wear is certain, median"
_BLOCK: Final = 1 << 17


@dataclass
class Judged:
    """What became of one parameter in one life.

    Attributes:
        enclosures: How many there were.
        outside: Enclosures that do not hold the true parameter, or are empty.
        false_wear: Enclosures that call wear certain where there is none.
        missed_time: Enclosures of the remaining time that do not hold the true one.
        width: Mean relative width of bounded ones.
        left: Minute at which the true parameter left its data sheet for good; ``None``: never.
        certain: First minute at which wear was certain; ``None``: never.
        failed: Minute at which it left its limits; ``None``: never.
        finite: Enclosures of the remaining time under a constant rate that are bounded.
        factor: Least remaining time over the true one, where it failed, a quarter before.
    """

    enclosures: int = 0
    outside: int = 0
    false_wear: int = 0
    missed_time: int = 0
    width: float = float("nan")
    left: int | None = None
    certain: int | None = None
    failed: int | None = None
    finite: int = 0
    factor: float = float("nan")


@dataclass
class Life:
    """One life.

    Attributes:
        kind: How its parameters drift.
        product: Of C0.
        stiffness: Of E.
        wrong: Most constraints of C0 that were wrong among those that counted at once.
    """

    kind: str
    product: Judged
    stiffness: Judged
    wrong: int


@dataclass
class World:
    """What happens in a life, minute by minute.

    Attributes:
        kind: How C0 and E drift.
        minutes: How many.
        log_product: Logarithm of the true C0 over its first value.
        log_stiffness: The same of E.
        load: What presses the pad, Pa.
        known: Where the load is known: the morning's.
        rest: Where nothing is to press it, as the schedule has it.
        water: What water adds, over C0.
        broken: Where the trace is open.
        temperature: °C.
        humidity: %.
    """

    kind: str
    minutes: int
    log_product: Floats
    log_stiffness: Floats
    load: Floats
    known: Flags
    rest: Flags
    water: Floats
    broken: Flags
    temperature: Floats
    humidity: Floats


KINDS: Final = ("still", "steady", "late", "changing")


def draw_world(seed: int, days: int, kind: str) -> World:
    """Draw what happens in a life."""
    draw = np.random.default_rng((seed, 0x11FE))
    n = days * DAY
    minute = np.arange(n)
    clock = minute % DAY
    drifts = [_drift(draw, n, kind) for _ in range(2)]
    rest = (clock >= 23 * 60) | (clock < 6 * 60)
    known = clock == 6 * 60
    day = (clock >= 7 * 60) & (clock < 22 * 60)
    touched = day & (draw.uniform(size=n) < draw.uniform(0.05, 0.6))
    load = np.where(touched, draw.uniform(0.0, _MOST_PA, n), 0.0)
    load[known] = _LOAD_PA * (1.0 + _LOAD_TOLERANCE * draw.uniform(-1.0, 1.0))
    broken = np.zeros(n, bool)
    for _ in range(int(draw.integers(0, 4))):
        begin = int(draw.integers(0, n))
        broken[begin : begin + int(draw.integers(5, 20 * DAY))] = True
    if draw.uniform() < 0.2:
        broken[int(draw.uniform(0.6, 1.0) * n) :] = True
    water = np.zeros(n)
    # One film and one unnoticed load in any stretch of as many working minutes as count.
    working = np.flatnonzero(~broken)
    place = int(draw.integers(0, 3 * MEMORY))
    while place < len(working):
        begin = working[place]
        water[begin : begin + int(draw.integers(5, _FILM_MIN))] = draw.uniform(0.01, 0.5)
        begin = working[place] + int(draw.integers(0, DAY))
        lean = np.arange(begin, min(begin + int(draw.integers(1, _LEAN_MIN)), n))
        load[lean[rest[lean]]] = draw.uniform(500.0, _MOST_PA)
        place += MEMORY + 2 * DAY + int(draw.integers(0, 3 * MEMORY))
    phase, swing = draw.uniform(0.0, 1.0, 2), draw.uniform(0.0, 1.0, 4)
    year, turn = 2.0 * np.pi * minute / (365.0 * DAY), 2.0 * np.pi * minute / DAY
    temperature = (
        20.0
        + 8.0 * swing[0] * np.sin(year + 6.3 * phase[0])
        + 4.0 * swing[1] * np.sin(turn + 6.3 * phase[1])
    )
    humidity = 50.0 + 20.0 * swing[2] * np.sin(year) + 10.0 * swing[3] * np.sin(turn + 1.0)
    product, elastic = drifts
    air = temperature, humidity
    return World(kind, n, product, elastic, load, known, rest, water, broken, *air)


def _drift(draw: np.random.Generator, n: int, kind: str) -> Floats:
    """Logarithm of a drifting parameter over its first value; its rate stays within `DRIFT`."""
    most = 0.999 * DRIFT * 60.0
    rates = np.zeros(n)
    if kind == "steady":
        rates[:] = draw.choice([-1.0, 1.0]) * draw.uniform(0.2, 1.0) * most
    elif kind == "late":
        rates[int(draw.uniform(0.1, 0.6) * n) :] = draw.choice([-1.0, 1.0]) * most
    elif kind == "changing":
        ends = np.sort(draw.integers(0, n, 12))
        steps = np.searchsorted(ends, np.arange(n), "right")
        rates = (draw.uniform(-0.6, 1.0, 13) * draw.choice([-1.0, 1.0]) * most)[steps]
    return np.concatenate([[0.0], np.cumsum(rates[:-1])])


@cache
def _sheets() -> tuple[TaxelSection, TaxelSection, TaxelSection]:
    """The packaged pad with Gaussian noise, and the thermometer and hygrometer beside it."""
    tables: dict[str, dict[str, Any]] = {}
    for each in Profile.read("hand").taxels:
        tables.setdefault(each["kind"], dict(each))
    tables["pad"] |= {"noise": {"kind": "gaussian", "sigma": 2e-7, "k": 3.0}}
    adapter: TypeAdapter[TaxelSection] = TypeAdapter(Taxel)
    pad, thermometer, hygrometer = (
        adapter.validate_python(tables[kind]) for kind in ("pad", "thermometer", "hygrometer")
    )
    return pad, thermometer, hygrometer


class Emulated:
    """A pad with its true parts, and what its chain and its sensors of the air state.

    Args:
        seed: Draws true parts and noise.
        world: What happens.

    Attributes:
        world: What happens.
        product: True C0 at each minute, F.
        own_product: The same over the true factor of the oscillator.
        stiffness: True E, Pa.
        oscillator: Bounds of the factor α that all capacitances share (eq. 6).
        capacitance: As it is measured, F.
        permittivity: k, as thermometer and hygrometer state the air.
    """

    def __init__(self, seed: int, world: World) -> None:
        self.world = world
        pad, thermometer, hygrometer = _sheets()
        sheet: Any = pad
        self.sheet = sheet
        random = ColumnGenerator(seed, 0)

        def part(name: str, unit: str = "") -> float:
            tolerance = getattr(sheet, f"{name}_tolerance")
            return float(draw_part(random, getattr(sheet, name + unit), tolerance)[0, 0])

        plates = part("plate_area", "_m2") * part("relative_permittivity")
        first = TRUE_VACUUM_PERMITTIVITY * plates / part("plate_distance", "_m")
        elasticity = part("elasticity", "_Pa")
        per_kelvin, per_percent = part("permittivity_per_K"), part("permittivity_per_percent")
        self.product = first * np.exp(world.log_product)
        self.stiffness = elasticity * np.exp(world.log_stiffness)
        ambient = (
            1.0
            + per_kelvin * (world.temperature - REFERENCE_TEMPERATURE)
            + per_percent * (world.humidity - REFERENCE_HUMIDITY)
        )
        strain = (world.load + _remains(world.load)) / self.stiffness
        capacitance = self.product * (ambient * (1.0 + strain) + world.water)
        spikes = np.random.default_rng((seed, 0x5717)).uniform(size=world.minutes)
        spiky = spikes < _SPIKE
        capacitance[spiky] *= 0.5 + 1.5 * spikes[spiky] / _SPIKE
        capacitance[world.broken] = _OPEN_F
        chains = [
            (Chains(pad, random), {"capacitance": capacitance}),
            (Chains(thermometer, ColumnGenerator(seed, 1)), {"temperature": world.temperature}),
            (Chains(hygrometer, ColumnGenerator(seed, 2)), {"humidity": world.humidity}),
        ]
        firmware: Any = pad.firmware(data_sheet(pad, {}), compiled_inversion())
        self.oscillator: tuple[float, float] = firmware.shared()["capacitance"]
        measured: dict[str, list[Interval]] = {}
        true: Floats = np.empty(0)
        for begin in range(0, world.minutes, _BLOCK):
            instants = np.arange(begin, min(begin + _BLOCK, world.minutes)) * MINUTE
            for chain, sensed in chains:
                part_of = {k: v[None, begin : begin + _BLOCK] for k, v in sensed.items()}
                truth, intervals = chain.measure(part_of, instants)
                for name, found in intervals.items():
                    measured.setdefault(name, []).append(found[0])
                if not begin:
                    true = truth.get("current", true)
        stated = {name: Interval.concatenate(pieces) for name, pieces in measured.items()}
        self.capacitance = stated["capacitance"]
        self.own_product = self.product / float(capacitance[0] * true[0, 0])
        by_heat = _stated(sheet, "permittivity_per_K")
        by_water = _stated(sheet, "permittivity_per_percent")
        heat = (stated["temperature"] - REFERENCE_TEMPERATURE) * by_heat
        self.permittivity = 1.0 + heat + (stated["humidity"] - REFERENCE_HUMIDITY) * by_water

    @property
    def stated_product(self) -> Interval:
        """C0 by the data sheet, in F."""
        plates = _stated(self.sheet, "plate_area", "_m2")
        permittivity = VACUUM_PERMITTIVITY * _stated(self.sheet, "relative_permittivity")
        return permittivity * plates / _stated(self.sheet, "plate_distance", "_m")

    @property
    def stated_stiffness(self) -> Interval:
        """E by the data sheet, in Pa."""
        return _stated(self.sheet, "elasticity", "_Pa")


def _stated(sheet: Any, name: str, unit: str = "") -> Interval:
    """A part by the data sheet."""
    return Interval.relative(getattr(sheet, name + unit), getattr(sheet, f"{name}_tolerance"))


def _remains(load: Floats) -> Floats:
    """Pressure that remains of earlier loads: of the greatest, as far as each has faded."""
    since = np.arange(load.size) / _DECAY_MIN
    with np.errstate(divide="ignore"):
        kept = np.maximum.accumulate(np.log(_HYSTERESIS * load) + since)
    return np.concatenate([[0.0], np.exp(kept[:-1] - since[1:])])


def live(seed: int, days: int = DAYS) -> Life:
    """Emulate one life and judge what is identified of it.

    Args:
        seed: Draws it; its kind is the seed's rest by four.
        days: How long it is.
    """
    return identify(Emulated(seed, draw_world(seed, days, KINDS[seed % len(KINDS)])))


def identify(pad: Emulated, *, drift: float = DRIFT, outliers: int = OUTLIERS) -> Life:
    """Identify a pad's C0 and E over its life, and judge it.

    Args:
        pad: The pad.
        drift: Bound that the estimators are given.
        outliers: How many of a week's constraints of C0 they take to be wrong.
    """
    world, within = pad.world, Interval(-drift, drift)
    at = np.arange(world.minutes, dtype=np.int64) * MINUTE
    times = np.arange(_EVERY, world.minutes, _EVERY)
    # What the oscillator's factor is wrong by cancels in E, and counts once in C0.
    parts, known = SharedError(pad.oscillator).own_parts(pad.capacitance)
    own = Interval.where(known, parts, Interval(0.0, np.inf))
    constraints = rest_capacitance(own, pad.permittivity, at_rest=world.rest, residual=_RESIDUAL)
    found = estimate(at, at, constraints, at[times], within, outliers=outliers, memory=MEMORY)
    product = Interval.where(found.is_empty, Interval.empty(), found * Interval(*pad.oscillator))
    loaded, strained = _strained(own, np.flatnonzero(world.known))
    soft = estimate(
        at[loaded], at[loaded], strained, at[times], within,
        outliers=LOAD_OUTLIERS, memory=LOAD_MEMORY,
    )  # fmt: skip
    steady = world.kind == "steady"
    for_c0, for_e = (
        _judge(
            each,
            stated,
            Interval.relative(float(stated.mid), reach),
            true,
            times,
            within,
            steady=steady,
        )
        for each, stated, reach, true in (
            (product, pad.stated_product, _LIMITS, pad.product),
            (soft, pad.stated_stiffness, _STIFFNESS_LIMITS, pad.stiffness),
        )
    )
    return Life(world.kind, for_c0, for_e, _most_wrong(constraints, pad))


def _strained(own: Interval, mornings: Integers) -> tuple[Integers, Interval]:
    """Constraints of E: each morning's load over the rest just before it, in the same air.

    Returns:
        The minutes of the loads, and E in Pa.
    """
    before = mornings[:, None] - np.arange(1, _BEFORE_MIN + 1)
    rest = relaxed_intersection(own[before], _BEFORE_OUTLIERS)
    known = ~rest.is_empty & (rest.inf > 0.0)
    loaded = mornings[known]
    strained = stiffness(
        own[loaded],
        Interval.relative(_LOAD_PA, _LOAD_TOLERANCE),
        rest[known] / (1.0 + Interval(0.0, _RESIDUAL)),
        Interval.around(1.0, _SAME_AIR),
        residual=_RESIDUAL,
    )
    return loaded, strained


def _most_wrong(constraints: Interval, pad: Emulated) -> int:
    """Most wrong constraints of C0 among those that count at any time."""
    true = Interval.relative(pad.own_product, 1e-12)  # the emulated chain computes in float64
    informs = np.isfinite(constraints.sup)
    wrong = np.cumsum(constraints.disjoint(true)[informs], dtype=np.int64)
    before = np.concatenate([np.zeros(min(MEMORY, wrong.size), np.int64), wrong[:-MEMORY]])
    return int((wrong - before).max(initial=0))


def _judge(
    found: Interval,
    sheet: Interval,
    limits: Interval,
    true: Floats,
    times: Integers,
    drift: Interval,
    *,
    steady: bool,
) -> Judged:
    """Compare what is enclosed at some minutes with the true parameter of each minute."""
    now = true[times]
    worn = find_wear(found, sheet)
    gone = ~sheet.contains(true)
    failed = np.flatnonzero(~limits.contains(true))
    failure = int(failed[0]) if failed.size else None
    result = Judged(
        enclosures=times.size,
        outside=int((~found.contains(now)).sum()),
        false_wear=int((worn.certain & ~gone[times]).sum()),
        failed=failure,
    )
    bounded = found.is_common_interval & (found.inf > 0.0)
    if np.any(bounded):
        result.width = float((found.wid[bounded] / now[bounded]).mean())
    if gone[-1]:
        result.left = int(np.flatnonzero(~gone)[-1]) + 1 if not gone.all() else 0
        certain = np.flatnonzero(worn.certain & (times >= result.left))
        result.certain = int(times[certain[0]]) if certain.size else None
    early = times <= (true.size if failure is None else failure)
    left = remaining_time(found, limits, drift)
    result.missed_time += _missed(left, times, early, failure, true.size)
    if failure is not None:
        before = np.flatnonzero(early & (times <= 0.75 * failure))
        if before.size:
            k = before[-1]
            result.factor = float(left.inf[k]) / (60.0 * (failure - times[k]))
    if steady:
        ago = _SNAPSHOTS // _EVERY
        ready = bounded[ago:] & bounded[:-ago] & early[ago:]
        old, new = found[:-ago][ready], found[ago:][ready]
        rates = mean_drift(old, new, 60.0 * _SNAPSHOTS).intersection(drift)
        constant = [remaining_time(x, limits, rate) for x, rate in zip(new, rates, strict=True)]
        if constant:
            both = Interval.stack(constant)
            result.finite = int(np.isfinite(both.sup).sum())
            at = times[ago:][ready]
            result.missed_time += _missed(both, at, np.ones(at.size, bool), failure, true.size)
    return result


def _missed(
    left: Interval, times: Integers, early: Flags, failure: int | None, minutes: int
) -> int:
    """Enclosures that do not hold the true remaining time, which is known to a minute."""
    if failure is None:
        # It lasts longer than the life.
        return int((left.sup < 60.0 * (minutes - 1 - times))[early].sum())
    latest, soonest = 60.0 * (failure - times), 60.0 * np.maximum(failure - 1 - times, 0)
    return int(((left.sup < soonest) | (left.inf > latest))[early].sum())


def summarise(lived: Sequence[Life]) -> list[Row]:
    """What was wrong in some lives, and how soon wear was certain."""
    week = independent_coverage(_COVERAGE, MEMORY, _NOISE_WRONG)
    rows = [
        at_most("wrong constraints that count at once", max(x.wrong for x in lived), "", OUTLIERS),
        at_least("noise of a week is within its share, probability", week, "", 1.0 - 1e-9),
    ]
    for name, judged in (
        ("C0", [each.product for each in lived]),
        ("E", [each.stiffness for each in lived]),
    ):
        rows += _rows(name, judged)
    delay = next((row.value for row in rows if row.name == f"C0: {_MEDIAN}"), 0.0)
    return [*rows, at_most("C0: that delay", delay, "d", _SLOWEST_D)]


def _rows(name: str, judged: Sequence[Judged]) -> list[Row]:
    left = [each for each in judged if each.left is not None]
    # Where wear was not certain at the end of a life, its delay is longer than any.
    delays = np.array(
        [inf if x.certain is None else (x.certain - (x.left or 0)) / DAY for x in left]
    )
    widths = [each.width for each in judged if np.isfinite(each.width)]
    factors = [each.factor for each in judged if np.isfinite(each.factor)]
    checks = sum(each.enclosures for each in judged)
    rows = [
        at_most(
            f"{name}: true value outside, of {checks}", sum(x.outside for x in judged), "", 0.0
        ),
        at_most(f"{name}: false certain wear", sum(x.false_wear for x in judged), "", 0.0),
        at_most(f"{name}: remaining time wrong", sum(x.missed_time for x in judged), "", 0.0),
        Row(f"{name}: mean relative width", float(np.mean(widths)) if widths else 0.0, ""),
        Row(f"{name}: lives that leave the data sheet", len(left), ""),
        Row(f"{name}: of these certainly worn at the end", int(np.isfinite(delays).sum()), ""),
        Row(f"{name}: lives that fail", sum(x.failed is not None for x in judged), ""),
        Row(f"{name}: bounded remaining times", sum(x.finite for x in judged), ""),
    ]
    if delays.size:
        for title, share in ((_MEDIAN, 0.5), ("the same, 75 %", 0.75), ("the same, 90 %", 0.9)):
            delay = float(np.quantile(delays, share, method="higher"))
            rows.append(Row(f"{name}: {title}", delay, "d"))
    if factors:
        rows.append(Row(f"{name}: least over true remaining time", float(np.median(factors)), ""))
    return rows


def main() -> int:
    """Emulate lives and print what was found."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.lives", description=__doc__)
    parser.add_argument("--lives", type=int, default=LIVES, help="how many")
    parser.add_argument("--days", type=int, default=DAYS, help="how long each")
    parser.add_argument("--seed", type=int, default=1, help="draws them")
    options = parser.parse_args()
    lived: list[Life] = []
    for number in range(options.lives):
        lived.append(live(options.seed * LIVES + number, options.days))
        print(f"{number + 1}/{options.lives}: {lived[-1]}", file=sys.stderr, flush=True)
    rows = summarise(lived)
    Console(width=140).print(as_table(rows))
    return 1 if any(row.met is False for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
