from __future__ import annotations

import numpy as np
import pytest

import eskin
from eskin.errors import EskinError, MonitorError
from eskin.interval import Interval, Verdict
from eskin.monitor import Because, Signal, Verdicts, evaluate, parse
from tests.unit.eskin.monitor.worlds import Sample, signal

C, P, I = Verdict.CERTAIN, Verdict.POSSIBLE, Verdict.IMPOSSIBLE  # noqa: E741 - the three


def verdicts(text: str, *samples: Sample, period: int = 10) -> Verdicts:
    return evaluate(parse(text), {"p": signal([*samples], period)})


def step(*values: float) -> list[Sample]:
    """Exact samples every 10 ns."""
    return [Sample(10 * k, 10 * k, value, value) for k, value in enumerate(values)]


def test_a_sample_is_held_until_the_next() -> None:
    found = verdicts("p > 3", *step(1, 5, 1))
    ends = [(piece.start, piece.includes_start, piece.end, piece.includes_end) for piece in found]
    assert [piece.verdict for piece in found] == [P, I, C, I, P]
    assert ends == [
        (None, False, 0, False),
        (0, True, 10, False),
        (10, True, 20, False),
        (20, True, 20, True),
        (20, False, None, False),
    ]


def test_a_sample_before_a_gap_is_held_for_one_period() -> None:
    found = verdicts("p > 3", Sample(0, 0, 5, 5, gap=True), Sample(50, 50, 5, 5, gap=True))
    assert found.codes_at([-1, 0, 9, 10, 49, 50, 51, 60]).tolist() == [P, C, C, P, P, C, P, P]


def test_an_uncertain_instant_leaves_its_edges_open() -> None:
    found = verdicts(
        "p > 3", Sample(0, 2, 5, 5), Sample(10, 14, 1, 1, gap=True), Sample(40, 40, 5, 5)
    )
    times = [-1, 0, 1, 2, 9, 10, 13, 14, 19, 20, 30]
    assert found.codes_at(times).tolist() == [P, P, P, C, C, P, P, I, I, P, P]


def test_order_narrows_instants() -> None:
    found = verdicts("p > 3", Sample(0, 9, 5, 5), Sample(2, 3, 1, 1), Sample(20, 20, 1, 1))
    assert found.codes_at([2, 3, 8]).tolist() == [P, I, I]


@pytest.mark.parametrize(
    ("text", "times", "codes"),
    [
        ("always[0,10ns] p > 3", [9, 10, 15, 19, 20], [I, C, C, C, I]),
        ("eventually[0,10ns] p > 3", [-1, 0, 29, 30, 31], [P, C, C, I, I]),
        ("eventually[5ns,10ns] p > 3", [0, 24, 25, 35], [C, C, I, I]),
        ("once[0,10ns] p > 3", [5, 10, 39, 40], [P, C, C, I]),
        ("historically[0,10ns] p > 3", [19, 20, 29, 30], [I, C, C, I]),
        ("rise(p > 3)", [0, 9, 10, 11, 30], [I, I, C, I, I]),
        ("fall(p > 3)", [10, 29, 30, 31], [I, I, C, I]),
        ("p < 3 until[0,10ns] p > 3", [0, 5, 15, 30], [C, C, C, I]),
        ("p < 3 until[5ns,10ns] p > 3", [0, 5, 6, 15], [C, C, I, I]),
        ("p > 3 since[0,10ns] rise(p > 3)", [10, 20, 21, 30], [C, C, I, I]),
        ("not (p > 3 implies p > 9)", [5, 15], [I, C]),
        ("count(p > 0, p > 3, p > 9) >= 2", [5, 15, 30], [I, C, I]),
    ],
)
def test_operators(text: str, times: list[int], codes: list[Verdict]) -> None:
    found = verdicts(text, *step(1, 5, 5, 1, 1, 1))
    assert found.codes_at(times).tolist() == codes


def test_the_example_with_two_directions_is_only_possible() -> None:
    wide = [Sample(10 * k, 10 * k, 1, 5) for k in range(6)]
    text = "always[0,20ns](p > 3) and eventually[0,20ns](p < 2)"
    assert verdicts(text, *wide).at(5) is P


def test_an_unknown_value_does_not_matter_where_another_decides() -> None:
    signals = {
        "p": Signal([0, 10], [0, 10], [1.0, 1.0], [2.0, 2.0], 10),
        "q": Signal([], [], [], [], 10),
    }
    assert evaluate(parse("min(p, q) < 3"), signals).at(5) is C
    assert evaluate(parse("max(p, q) < 3"), signals).at(5) is P
    assert evaluate(parse("abs(q) >= 0"), signals).at(5) is C


def test_because_names_the_weakest_cause() -> None:
    samples = [
        Sample(0, 0, 1, 5),
        Sample(10, 14, 1, 1),
        Sample(20, 20, 5, 5, gap=True),
        Sample(50, 50, 5, 5),
    ]
    found = verdicts("p > 3", *samples)
    assert found.because(5) is Because.WIDTH
    assert verdicts("p < 9 and p > 3", *step(5, 5)).because(5) is Because(0)
    assert found.because(40) is Because.GAP
    assert found.because(60) is Because.PENDING
    moved = verdicts("p > 3", Sample(0, 0, 5, 5), Sample(10, 14, 1, 1), Sample(20, 20, 1, 1))
    assert moved.because(12) is Because.INSTANT


def test_an_alarm_can_tell_known_causes_from_missing_data() -> None:
    straddling = [Sample(0, 0, 1, 5), Sample(10, 10, 1, 1)]
    found = verdicts("eventually[0,50ns] p > 3", *straddling)
    assert found.holds_by(0) is Because.WIDTH
    assert verdicts("eventually[0,50ns] p > 3", *step(1, 1)).holds_by(0) is Because.PENDING
    held = verdicts("always[0,50ns] p > 3", *straddling)
    assert held.at(0) is I
    open_ = verdicts("always[0,50ns] p > 3", Sample(0, 0, 1, 5), Sample(10, 10, 5, 5))
    assert (open_.holds_by(0), open_.fails_by(0)) == (Because.PENDING, Because.WIDTH)
    assert open_.because(0) == Because.PENDING | Because.WIDTH


def test_witness() -> None:
    samples = step(1, 5, 1, 1, 1, 1)
    assert verdicts("eventually[0,50ns] p > 3", *samples).witness(0) == 10
    assert verdicts("always[0,20ns] p < 3", *samples).witness(0) == 10
    assert verdicts("once[5ns,30ns] p > 3", *samples).witness(31) == 10
    assert verdicts("historically p < 3", *samples).witness(31) == 10
    assert verdicts("always[0,20ns] p < 9", *samples).witness(0) is None
    assert verdicts("p > 3", *samples).witness(10) is None


def test_coverage_counts_distinct_samples_of_the_horizon() -> None:
    instants = np.arange(10) * 10
    each = Signal(instants, instants, [1.0] * 10, [2.0] * 10, 10, coverage=0.99)
    near = evaluate(parse("p > 0 and p > 1"), {"p": each})
    window = evaluate(parse("always[0,20ns] p > 0 or always[10ns,20ns] p > 1"), {"p": each})
    assert 0.979 < near.coverage(35) <= 0.99
    assert 0.959 < window.coverage(35) <= 0.98
    assert window.coverage(1000) == 1.0
    sure = evaluate(parse("p > 0"), {"p": signal(step(1, 2, 3), 10)})
    assert sure.coverage(10) == 1.0


@pytest.mark.parametrize(
    ("text", "lo", "hi"),
    [
        ("p > 3", -2.0, -1.0),
        ("not p > 3", 1.0, 2.0),
        ("p < 3 and p > 1", 0.0, 1.0),
        ("eventually[0,10ns] p > 3", 1.0, 2.0),
        ("always[0,10ns] p > 3", -2.0, -1.0),
        ("p < 9 until[0,10ns] p > 3", 1.0, 2.0),
        ("count(p > 0, p > 1, p > 3) >= 2", 0.0, 1.0),
        ("p > 3 or p < 30", 28.0, 29.0),
    ],
)
def test_robustness_encloses_both_ends(text: str, lo: float, hi: float) -> None:
    samples = [Sample(0, 0, 1, 2), Sample(10, 10, 4, 5), Sample(20, 20, 1, 2)]
    found = verdicts(text, *samples).robustness(5)
    assert found.inf == lo
    assert found.sup == hi


def test_robustness_of_what_is_unknown_is_unbounded() -> None:
    found = verdicts("p > 3", *step(1)).robustness(50)
    assert str(found) == str(Interval.entire())


def test_a_tube_is_read_with_its_gaps() -> None:
    values = Interval([5.0, -np.inf, 5.0, 5.0], [6.0, np.inf, np.inf, 6.0])
    tube = eskin.Tube((100, 102), 10, values, "Pa", 0.5)
    found = evaluate(parse("p > 3"), {"p": tube})
    assert found.codes_at([102, 109, 110, 111, 112, 121, 122, 129]).tolist() == [
        C, C, P, P, P, P, C, C,
    ]  # fmt: skip


@pytest.mark.parametrize(
    "change",
    [
        {"earliest": [0.5, 1.0]},
        {"earliest": [5, 1], "latest": [5, 1]},
        {"latest": [-1, 1]},
        {"lo": [3.0, np.nan]},
        {"lo": [3.0]},
        {"period": 0},
        {"gap": [0, 1]},
        {"coverage": 1.5},
        {"until": 2**63},
    ],
)
def test_signals_that_make_no_sense_are_refused(change: dict[str, object]) -> None:
    parts: dict[str, object] = {
        "earliest": [0, 1], "latest": [0, 1], "lo": [0.0, 0.0], "hi": [1.0, 1.0], "period": 1,
    }  # fmt: skip
    with pytest.raises(EskinError):
        evaluate(parse("p > 1"), {"p": Signal(**parts | change)})  # type: ignore[arg-type]


def test_times_are_whole_ns() -> None:
    with pytest.raises(MonitorError):
        verdicts("p > 1", *step(1)).at(0.5)  # type: ignore[arg-type]
