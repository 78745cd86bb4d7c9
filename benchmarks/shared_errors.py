"""What shared errors are worth: 1,000 questions about differences, with them and without.

``python -m benchmarks.shared_errors`` lets packaged taxels be emulated for some seconds, reads what
their nodes send, and asks for each of 1,000 drawn formulas whether a capacitance changed by more
than a bound within some time. Bounds are quantiles of the true changes, so that both answers occur.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from benchmarks.report import Row, at_least
from eskin.interval import Verdict
from eskin.monitor import SharedError, Signal, evaluate, parse
from tests.unit.sensor_node.designs import Bench, table
from tests.unit.sensor_node.messages import samples_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

FORMULAS: Final = 1000
_SECONDS: Final = 3.0
_LEAST: Final = 5.0
_BITS: Final = 16
_DELAYS_MS: Final = (5, 10, 20, 50, 100, 200)
_FORMS: Final = (
    "p - delay(p, {d}ms) > {c} F",
    "delay(p, {d}ms) - p > {c} F",
    "abs(p - delay(p, {d}ms)) < {c} F",
    "p - (delay(p, {d}ms) + delay(p, {e}ms)) / 2 > {c} F",
)


def measure_shared_errors(formulas: int = FORMULAS) -> list[Row]:
    """Verdicts that stay possible, among all at sampled instants."""
    rows = []
    for title, taxel in _taxels().items():
        with tempfile.TemporaryDirectory() as folder:
            signals, truth = _recorded(Path(folder), taxel)
        counts = dict.fromkeys(signals, 0)
        wrong = asked = 0
        draw = np.random.default_rng(1)
        instants = signals[True].earliest[400::7]
        for number in range(formulas):
            text, holds = _drawn(draw, number, truth, instants, signals[True])
            formula = parse(text)
            for shared, signal in signals.items():
                codes = evaluate(formula, {"p": signal}).codes_at(instants)
                counts[shared] += int((codes == int(Verdict.POSSIBLE)).sum())
                decided = codes != int(Verdict.POSSIBLE)
                wrong += int((holds != (codes == int(Verdict.CERTAIN)))[decided].sum())
            asked += instants.size
        name = f"{formulas} differences of {title}"
        rows += [
            Row(f"{name}: possible, of {asked}", counts[True], "verdicts"),
            Row(f"{name}: the same, errors not shared", counts[False], "verdicts"),
            at_least(
                f"{name}: fewer possible", counts[False] / max(counts[True], 1), "times", _LEAST
            ),
            Row(f"{name}: wrong", wrong, "verdicts", target=0.0, met=wrong == 0),
        ]
    return rows


def _taxels() -> dict[str, dict[str, Any]]:
    quiet = {"noise": {"kind": "uniform", "bound": 1e-8}}
    return {
        "fingertip t01, 12 bits": table("capacitive"),
        f"the same with {_BITS} bits and 10 nA": table("capacitive", adc_bits=_BITS, **quiet),
        f"and a resistor of 2 %, {_BITS} bits": table(
            "capacitive", adc_bits=_BITS, resistance_tolerance=0.02, **quiet
        ),
    }


def _recorded(
    folder: Path, taxel: dict[str, Any]
) -> tuple[dict[bool, Signal], NDArray[np.float64]]:
    bench = Bench(folder, taxel=[{**taxel, "id": "t01"}], clock={"rtc_error_ms": 0.0})
    bench.run_to(_SECONDS)
    found = samples_of(bench, "t01.capacitance")
    number = next(
        k for k, patch in enumerate(bench.node.layout.patches) if patch.quantity == "capacitance"
    )
    patch = bench.node.layout.patches[number]
    bench.close()
    lo = np.concatenate([each.tube.values.inf for each in found])
    hi = np.concatenate([each.tube.values.sup for each in found])
    truth = np.concatenate([each.truth for each in found])
    dt = found[0].tube.dt
    instants = np.arange(lo.size, dtype=np.int64) * dt
    error = SharedError(patch.alpha[0], patch.beta[0])
    signals = {
        shared: Signal(
            instants,
            instants,
            lo,
            hi,
            dt,
            unit="F",
            until=int(instants[-1]) + dt,
            shared=error if shared else None,
        )
        for shared in (False, True)
    }
    return signals, truth


def _drawn(
    draw: np.random.Generator,
    number: int,
    truth: NDArray[np.float64],
    instants: NDArray[np.int64],
    signal: Signal,
) -> tuple[str, NDArray[np.bool_]]:
    """A formula, and where it is true."""
    form = _FORMS[number % len(_FORMS)]
    d, e = (int(each) for each in draw.choice(_DELAYS_MS, 2))
    dt = int(signal.period[0])
    at = instants // dt
    now, then, before = (truth[at - each * 1_000_000 // dt] for each in (0, d, e))
    value = {0: now - then, 1: then - now, 2: -np.abs(now - then), 3: now - (then + before) / 2}[
        number % len(_FORMS)
    ]
    bound = float(np.quantile(value, draw.uniform(0.1, 0.9)))
    text = form.format(d=d, e=e, c=repr(abs(bound) if number % len(_FORMS) == 2 else bound))
    return text, value > bound


if __name__ == "__main__":
    from rich.console import Console

    from benchmarks.report import as_table

    Console(width=140).print(as_table(measure_shared_errors()))
