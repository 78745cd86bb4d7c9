"""Reflexes over a million touches: none missed, none invented, and how soon the output is on.

``python -m benchmarks.reflexes --touches 1e6`` presses capacitive taxels whose parts, noise and
converters are emulated, and lets the firmware's monitors decide sample by sample by its integer
thresholds. Touches have any force around the threshold, and any length from one sample on.

A taxel's truth is its capacitance without noise at the sampled instants. Under bounded noise the
output of ``on = possible`` must be on wherever it is above the threshold, and that of ``on =
certain`` nowhere else. Under Gaussian noise samples that break this are counted, and compared with
those that the stated coverage allows.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from eskin_sensor_node.columns.sensing import SensingColumns
from eskin_sensor_node.firmware import monitor as engine
from eskin_sensor_node.firmware.clock import Clock
from eskin_sensor_node.firmware.reflex import Reflex, ReflexUnit, code_ranges
from eskin_sensor_node.machine.compilation import compiled_inversion
from eskin_sensor_node.machine.data_sheet import data_sheet
from eskin_sensor_node.machine.monitor_program import MonitorProgram
from eskin_sensor_node.machine.outputs import NAMES
from rich.progress import Progress

from benchmarks.report import Row, at_most
from eskin.monitor.program import threshold
from tests.unit.sensor_node.designs import Bench, settings, taxel
from tests.unit.sensor_node.reflex.skins import SkinBench

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin_sensor_node.kinds.settings import TaxelSection
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Marks = NDArray[np.bool_]

TOUCHES: Final = 100_000
CHANNEL: Final = "t01.capacitance"
THRESHOLD: Final = 60e-12
_FORMULAS: Final = {"": f"{CHANNEL} > 60 pF", "once[0,3ms] ": f"once[0,3ms] {CHANNEL} > 60 pF"}
_COLUMNS: Final = 32
_CHUNK: Final = 2048
_DT: Final = 1_000_000
_DRIFT: Final = 20_000
_REACTION_S: Final = 60.0
_WATCHED: Final = 16
GAUSSIAN: Final = {"kind": "gaussian", "sigma": 2e-6, "k": 2.0}


class Outcome(NamedTuple):
    """What became of some touches.

    Attributes:
        touches: How many.
        samples: How many.
        above: Samples at which the truth was above the threshold.
        missed: Of them, those at which the output of ``on = possible`` was off.
        false: Samples at which that of ``on = certain`` was on, and the truth was not above.
        allowed: How many samples the coverage allows to break it, on the mean.
    """

    touches: int
    samples: int
    above: int
    missed: int
    false: int
    allowed: float


class _Silent:
    """Takes verdicts and drops them."""

    def state_verdict(self, *_: Any) -> None:
        pass


def press(
    touches: float,
    *,
    noise: dict[str, Any] | None = None,
    seed: int = 1,
    rate: float = 1.0,
    on_chunk: Callable[[int], None] = lambda _: None,
) -> dict[str, Outcome]:
    """Press until there were so many touches; gives the outcome of each formula.

    Args:
        touches: How many.
        noise: Of the taxels; ``None``: bounded.
        seed: Draws parts, noise and touches.
        rate: Share of the clock's greatest rate error that is its true one.
        on_chunk: Called with the number of touches that were done.
    """
    section = taxel("capacitive", **({} if noise is None else {"noise": noise}))
    sensing = SensingColumns(
        section, seeds=np.arange(_COLUMNS) + seed * _COLUMNS, numbers=0, companions={}
    )
    draw = np.random.default_rng(seed)
    units = [_Unit(section) for _ in range(_COLUMNS)]
    found = {name: np.zeros(4, np.int64) for name in _FORMULAS}
    past = np.zeros((_COLUMNS, 4))
    done = begin = 0
    while done < touches:
        truth, count = _script(draw)
        codes = _converted(sensing, truth, begin)
        levels = np.array([unit.run(begin, row) for unit, row in zip(units, codes, strict=True)])
        above = np.concatenate((past, truth), axis=1) > THRESHOLD
        # A slow clock counts less than 3 ms from a sample to the third after it.
        reach = 3 if rate > 0.0 else 4
        seen = np.lib.stride_tricks.sliding_window_view(above, reach + 1, axis=1)
        held: Marks = np.asarray(seen.any(axis=2))
        truths = {"": above[:, 4:], "once[0,3ms] ": held[:, -truth.shape[1] :]}
        for k, name in enumerate(_FORMULAS):
            possible, certain, true = levels[:, :, 2 * k], levels[:, :, 2 * k + 1], truths[name]
            found[name] += [
                true.size,
                true.sum(),
                (true & ~possible).sum(),
                (certain & ~true).sum(),
            ]
        past = truth[:, -4:]
        begin += truth.shape[1]
        done += count
        on_chunk(done)
    sheet: Any = section
    beyond = 1.0 - sheet.noise.coverage
    outcomes = {}
    for name, counts in found.items():
        samples, violated, missed, false = (int(count) for count in counts)
        outcomes[name] = Outcome(done, samples, violated, missed, false, beyond * samples)
    return outcomes


class _Unit:
    """The firmware of one taxel, with both reflexes of each formula."""

    def __init__(self, section: TaxelSection) -> None:
        calibrated = section.firmware(data_sheet(section, {}), compiled_inversion())
        self._levels: dict[str, bool] = {}
        clock: Any = Clock(0, 0, _DRIFT)
        assembler: Any = _Silent()
        self._unit = ReflexUnit(clock, assembler, self._levels.__setitem__)
        self._source = engine.Source(_DT, _DRIFT)
        for name, text in _FORMULAS.items():
            program = MonitorProgram.compile(text, {CHANNEL: "F"})
            compared = threshold(program.atoms[0], {CHANNEL: "F"})
            assert compared is not None
            for on in (engine.POSSIBLE, engine.CERTAIN):
                atom = engine.Threshold(self._source, 0, derived=False)
                ranges = code_ranges(calibrated, 0, 0, upward=compared.upward, value=compared.value)
                atom.set(*ranges)
                made = engine.Monitor(program.lines, [atom], program.reach, _DRIFT)
                key = f"{name}{on}"
                self._levels[key] = False
                self._unit.define(Reflex(key, made, on, key, 1.0))

    def run(self, begin: int, codes: list[int]) -> list[tuple[bool, ...]]:
        """The level of each output after each sample."""
        unit, source, levels = self._unit, self._source, self._levels
        found = []
        for k, code in enumerate(codes, begin):
            unit.take(k * _DT, [(source, [[code]])])
            found.append(tuple(levels.values()))
        return found


def _script(draw: np.random.Generator) -> tuple[Floats, int]:
    """True capacitances: touches of any force and length, and rests between; and how many."""
    truth = np.full((_COLUMNS, _CHUNK), 20e-12)
    count = 0
    for row in truth:
        at = 0
        while at < _CHUNK:
            at += int(draw.integers(1, 8))
            lasting = int(draw.integers(1, 9))
            # Half of the touches end within a hundredth of the threshold.
            force = draw.choice((draw.uniform(0.4, 1.6), draw.uniform(0.99, 1.01)))
            rising = np.minimum(1.0, (np.arange(lasting) + draw.random()) / draw.uniform(0.5, 3.0))
            part = row[at : at + lasting]
            part[:] = 20e-12 + (force * THRESHOLD - 20e-12) * rising[: len(part)]
            at += lasting
            count += 1
    return np.maximum(truth, 11e-12), count


def _converted(sensing: SensingColumns, truth: Floats, begin: int) -> list[list[int]]:
    random = sensing._random  # noqa: SLF001 - what draws its noise
    random.begin(1, np.arange(begin, begin + truth.shape[1], dtype=np.int64) * _DT)
    codes: NDArray[np.int64] = sensing.frontend.digitise({"capacitance": truth}, random).codes[
        "current"
    ]
    rows: list[list[int]] = codes.tolist()
    return rows


def reactions(bench: Bench | SkinBench, seconds: float) -> Floats:
    """Times in us from the last conversion to the output, of a node's reflexes."""
    bench.run_to(seconds)
    found = [(edge.time - edge.cause) / 1e3 for edge in bench.node.machine.outputs.edges]
    bench.close()
    return np.array(found)


def fingertip(folder: Path) -> Bench:
    """A fingertip that compares one taxel."""
    return Bench(
        folder,
        functions=compiled_inversion(),
        monitor=[{"name": "stop", "formula": _FORMULAS[""], "output": "stop"}],
    )


def hand(folder: Path) -> SkinBench:
    """A hand of 336 pads, of which 16 are watched, four by each output."""
    pads = settings(folder, "small-hand").skin.skin.names
    watched = pads[:: len(pads) // _WATCHED][:_WATCHED]
    monitors = [
        {"name": f"m{k}", "formula": f"once[0,40ms] {pad}.pressure > 1.5 kPa", "output": output}
        for k, (pad, output) in enumerate(zip(watched, NAMES * 4, strict=True))
    ]
    return SkinBench(folder, settings(folder, "small-hand", monitor=monitors))


def measure_reflexes(touches: float = TOUCHES) -> list[Row]:
    """Touches under both noises, and reaction times."""
    rows = []
    with Progress() as screen:
        for title, noise in (("bounded", None), ("Gaussian", GAUSSIAN)):
            task = screen.add_task(f"{title} noise", total=touches)
            begun = time.perf_counter()
            found = press(
                touches,
                noise=noise,
                on_chunk=lambda done, task=task: screen.update(task, completed=done),  # type: ignore[misc]
            )
            spent = time.perf_counter() - begun
            for formula, each in found.items():
                name = f"reflex {formula}p > 60 pF, {title} noise, {each.touches} touches"
                if noise is None:
                    rows += [
                        at_most(f"{name}: missed by possible", each.missed, "samples", 0.0),
                        at_most(f"{name}: false by certain", each.false, "samples", 0.0),
                    ]
                else:
                    rows += [
                        at_most(
                            f"{name}: missed by possible", each.missed, "samples", each.allowed
                        ),
                        at_most(f"{name}: false by certain", each.false, "samples", each.allowed),
                    ]
            samples = found[""].samples
            rows.append(
                Row(f"reflex engine in Python, {title}", spent / samples / 4 * 1e6, "us/decision")
            )
    for title, build in (("fingertip", fingertip), ("hand of 336 pads", hand)):
        with tempfile.TemporaryDirectory() as folder:
            found_us = reactions(build(Path(folder)), _REACTION_S)
        name = f"reflex of a {title}, conversion to output"
        for share in (0.5, 0.99):
            value = float(np.quantile(found_us, share))
            rows.append(Row(f"{name}, p{100 * share:.0f} of {found_us.size}", value, "us"))
        rows.append(at_most(f"{name}, most", float(found_us.max()), "us", 1000.0))
        for value, count in zip(*np.unique(found_us.round(), return_counts=True), strict=True):
            rows.append(Row(f"{name}: about {value:.0f} us", float(count), "changes"))
    return rows


def main() -> None:
    """Measure, and show a table."""
    from rich.console import Console  # noqa: PLC0415 - of the command alone

    from benchmarks.report import as_table  # noqa: PLC0415 - likewise

    parser = argparse.ArgumentParser(prog="python -m benchmarks.reflexes", description=__doc__)
    parser.add_argument("--touches", type=float, default=TOUCHES)
    Console(width=160).print(as_table(measure_reflexes(parser.parse_args().touches)))


if __name__ == "__main__":
    main()
