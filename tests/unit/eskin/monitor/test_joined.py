"""Samples of several channels of which very many may hold at once are joined, and still sound."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from eskin.interval import Verdict
from eskin.monitor import Signal, atoms, evaluate, parse
from tests.support.examples import examples

if TYPE_CHECKING:
    from numpy.typing import NDArray


def drawn(random: np.random.Generator) -> dict[str, Signal]:
    """Two channels with gaps whose instants overlap those of their neighbours."""
    found = {}
    for name in "ab":
        n = int(random.integers(0, 9))
        instants = np.cumsum(random.integers(1, 12, n))
        error = random.integers(0, 25, n)
        earliest = np.maximum.accumulate(instants - error) if n else instants
        lo = random.integers(-4, 4, n).astype(float)
        hi = lo + random.integers(0, 3, n)
        gap = random.random(n) < 0.2
        latest = np.maximum(instants + error, earliest)
        found[name] = Signal(earliest, latest, lo, hi, 10, gap, until=int(random.integers(90, 130)))
    return found


TICKS: NDArray[np.int64] = np.arange(-80, 260)
TEXTS = ("a > b", "a - b >= 1", "max(a, b) > 1", "a > b and delay(a, 7ns) < b", "once[0,9ns] a > b")


@pytest.mark.parametrize("text", [*TEXTS, "abs(a - b) > 1", "a * b > 0"])
def test_verdicts_of_joined_samples_are_the_same_or_possible(
    text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    random = np.random.default_rng(len(text))
    formula, decided = parse(text), 0
    for _ in range(examples(60)):
        signals = drawn(random)
        each = evaluate(formula, signals).codes_at_ticks(TICKS)
        with monkeypatch.context() as patch:
            patch.setattr(atoms, "MOST_CANDIDATES", 0)
            joined = evaluate(formula, signals)
            codes = joined.codes_at_ticks(TICKS)
        if text in TEXTS:
            assert codes.tolist() == each.tolist()
        else:
            assert np.all((codes == each) | (codes == Verdict.POSSIBLE))
        decided += int((codes != Verdict.POSSIBLE).sum())
    assert decided > 0


def test_clocks_that_are_seconds_wrong_are_compared() -> None:
    n, second = 20_000, 10**9
    instants = np.arange(n) * second // 1000
    signals = {
        name: Signal(
            instants - second, instants + second, np.full(n, level), np.full(n, level + 0.5), 10**6
        )
        for name, level in (("a", 1.0), ("b", 0.0))
    }
    found = evaluate(parse("a > b"), signals)
    assert found.at(10 * second) is Verdict.CERTAIN
