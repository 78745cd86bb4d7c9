"""A formula over the store says what it says of all samples, read as hulls or not."""

from __future__ import annotations

from contextlib import contextmanager
from fractions import Fraction
from typing import TYPE_CHECKING
from unittest.mock import patch

import numpy as np
import pytest
from eskin_cloud.query import stored_verdicts
from eskin_cloud.query.channel_runs import ChannelSource, as_signal
from eskin_cloud.query.stored_verdicts import StoredVerdicts
from eskin_cloud.query.verdict_totals import VerdictTotals, total_verdicts
from eskin_cloud.rollup.samples import read_samples
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from eskin.interval import Verdict
from eskin.monitor import (
    Atom,
    Because,
    Channel,
    Comparison,
    Constant,
    Eventually,
    Fall,
    Historically,
    Once,
    Rise,
    Until,
    evaluate,
)
from tests.support.examples import examples
from tests.unit.cloud.brute_force import compact_all
from tests.unit.cloud.clouds import emptied, put
from tests.unit.cloud.drawn_channels import OTHER, drawn_signal, said_of, samples_of, windows
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START, stretch
from tests.unit.eskin.monitor.formulas import bounds, formulas

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin_cloud.store import Store

    from eskin.monitor import Formula
    from eskin.wire.frames import Frame
    from tests.unit.cloud.clouds import Stand

WHOLE = Window(START - 10**6, START + 10**6)
ATOMS = st.builds(
    Atom,
    st.sampled_from((Channel(CHANNEL), Channel(OTHER), Channel(CHANNEL, 12))),
    st.sampled_from(Comparison),
    st.sampled_from((Channel(OTHER), Constant(0), Constant(1))),
)
FORMULAS = formulas(ATOMS, bounds(60, unbounded=False), max_leaves=4)


@contextmanager
def sources_of(store: Store, formula: Formula) -> Iterator[dict[str, ChannelSource]]:
    with store.read() as connection:
        yield {
            name: ChannelSource(connection, find_channel(connection, NODE, name))
            for name in formula.channels
        }


@settings(max_examples=examples(60), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    said_of(CHANNEL),
    said_of(OTHER),
    FORMULAS,
    windows,
    st.sampled_from((1, 3, 10**6)),
    st.sampled_from(((2**17, 2**20), (0, 2**20), (0, 4))),
)
def test_verdicts_are_those_of_all_samples(
    store: Store,
    one: list[Frame],
    other: list[Frame],
    formula: Formula,
    window: Window,
    samples: int,
    limits: tuple[int, int],
) -> None:
    emptied(store)
    put(store, *one, *other)
    crowded, most = limits
    few = patch.multiple(stored_verdicts, _CROWDED=crowded, MOST_SAMPLES=most)
    with sources_of(store, formula) as sources, few:
        stored = StoredVerdicts(formula, sources, points=3, samples=samples)
        pieces = [*stored.pieces(window)]
        signals = {
            name: as_signal(read_samples(*source, WHOLE), source.channel["unit"])
            for name, source in sources.items()
        }
    whole = evaluate(formula, signals)
    found = {tick: piece.verdict for piece in pieces for tick in range(piece.first, piece.last + 1)}
    ticks = np.arange(2 * window.start, 2 * window.end)
    assert list(found) == ticks.tolist()
    expected = whole.codes_at_ticks(ticks)
    codes = np.array([int(verdict) for verdict in found.values()], np.int8)
    given_up = (most == 4) & (codes == Verdict.POSSIBLE)
    assert codes[~given_up].tolist() == expected[~given_up].tolist()
    for piece in pieces:
        assert bool(piece.because) is (piece.verdict is Verdict.POSSIBLE)


@settings(max_examples=examples(80), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(said_of(CHANNEL), said_of(OTHER), FORMULAS, windows, st.integers(0, 2**32))
def test_every_signal_within_the_samples_agrees(
    store: Store,
    one: list[Frame],
    other: list[Frame],
    formula: Formula,
    window: Window,
    seed: int,
) -> None:
    random = np.random.default_rng(seed)
    signals = {
        name: drawn_signal(random, samples_of(said))
        for name, said in ((CHANNEL, one), (OTHER, other))
    }
    known = {name: signal for name, signal in signals.items() if signal is not None}
    assume(len(known) == len(signals))
    put(emptied(store), *one, *other)
    with sources_of(store, formula) as sources:
        pieces = [*StoredVerdicts(formula, sources).pieces(window)]
    truth = evaluate(formula, known)
    time, unknown, entries, before = 0, 0, 0, False
    for piece in pieces:
        ticks = np.arange(piece.first, piece.last + 1)
        codes = truth.codes_at_ticks(ticks)
        holds = codes == Verdict.CERTAIN
        if piece.verdict is Verdict.CERTAIN:
            assert np.all(holds)
        elif piece.verdict is Verdict.IMPOSSIBLE:
            assert np.all(codes == Verdict.IMPOSSIBLE)
        time += int((holds & (ticks % 2 == 1)).sum())
        unknown += int(((codes == Verdict.POSSIBLE) & (ticks % 2 == 1)).sum())
        if piece.changes is None:
            before = False
            continue
        assert np.all(codes != Verdict.POSSIBLE)
        entries += int(np.sum(holds & ~np.append(before, holds[:-1])))
        before = bool(holds[-1])
    totals = total_verdicts(pieces)
    assert totals.time[0] <= time
    assert time + unknown <= totals.time[1] + totals.unknown
    assert totals.entries[0] <= entries <= totals.entries[1]


@pytest.mark.parametrize("error", [0, 40, 900, 10**6])
def test_runs_leave_open_where_samples_beside_them_may_hold(store: Store, error: int) -> None:
    random = np.random.default_rng(error)
    for number in range(10):
        level = random.choice([0.0, 1.0], 40).repeat(random.integers(1, 9))[:40]
        instant = START + 400 * number
        time = instant - error, instant + error
        put(store, stretch(number, level, level + 0.1, time=time, dt=10))
    above = Channel(CHANNEL) > Fraction(1, 2)
    formulas = (
        above,
        Eventually((20, 170), above),
        Historically((30, 90), above),
        Rise(Channel(CHANNEL, 25) > Fraction(1, 2)),
        Until((0, 200), above, Once((0, 30), Fall(above))),
    )
    with sources_of(store, above) as sources:
        everything = read_samples(*sources[CHANNEL], Window(START - 10**7, START + 10**7))
        signals = {CHANNEL: as_signal(everything, "F")}
        whole = [evaluate(each, signals) for each in formulas]
        for k in range(60):
            which = k % len(formulas)
            start = START + int(random.integers(-500, 4000))
            window = Window(start, start + int(random.integers(1, 2000)))
            stored = StoredVerdicts(formulas[which], sources, points=6, samples=4)
            for piece in stored.pieces(window):
                ticks = np.arange(piece.first, piece.last + 1)
                assert set(whole[which].codes_at_ticks(ticks).tolist()) == {int(piece.verdict)}


def at(
    start: int, level: float, number: int, *, error: int = 0, n: int = 4, coverage: float = 1.0
) -> Frame:
    instant = START + start
    time = instant - error, instant + error
    return stretch(number, [level] * n, [level] * n, time=time, dt=10, coverage=coverage)


def totals_of(store: Store, said: list[Frame], window: Window) -> VerdictTotals:
    put(emptied(store), *said)
    formula = Channel(CHANNEL) > Fraction(1, 5)
    with sources_of(store, formula) as sources:
        return total_verdicts(StoredVerdicts(formula, sources).pieces(window))


def test_times_and_entries_are_exact_where_clocks_are(store: Store) -> None:
    said = [at(0, 0.0, 0), at(40, 1.0, 1), at(80, 0.0, 2), at(120, 1.0, 3, n=1)]
    found = totals_of(store, said, Window(START, START + 120))
    assert found == VerdictTotals((40, 40), 0, (1, 1))
    found = totals_of(store, said, Window(START + 50, START + 140))
    assert found == VerdictTotals((30, 30), 20, (2, 2))  # after the last sample nothing is known


def test_a_stretch_loses_the_time_error_at_its_ends_and_no_more(store: Store) -> None:
    said = [at(0, 0.0, 0, error=2), at(40, 1.0, 1, error=2), at(80, 1.0, 2, error=3),
            at(120, 0.0, 3, error=5)]  # fmt: skip
    found = totals_of(store, said, Window(START + 10, START + 130))
    assert found == VerdictTotals((80 - 2 - 5, 80 + 2 + 5), 0, (1, 1))


def test_a_value_that_may_be_above_counts_as_often_as_its_samples_change(store: Store) -> None:
    unsure = stretch(1, [0.0] * 4, [1.0] * 4, time=(START + 40, START + 40), dt=10)
    found = totals_of(store, [at(0, 0.0, 0), unsure, at(80, 0.0, 2)], Window(START, START + 110))
    assert found == VerdictTotals((0, 40), 0, (0, 2))


def test_a_delayed_channel_in_the_future_is_counted(store: Store) -> None:
    toggling = [float(k % 2) for k in range(20)]
    said = [stretch(0, toggling, [x + 1.0 for x in toggling], time=(START, START), dt=10)]
    put(emptied(store), *said)
    late = Channel(CHANNEL, 10) > Fraction(3, 2)
    formula = Eventually((25, 30), late)
    with sources_of(store, formula) as sources:
        window = Window(START + 40, START + 100)
        totals = total_verdicts(StoredVerdicts(formula, sources).pieces(window))
    # The sample that is read at t is that of t + 15 to t + 20: three more are open by the end.
    assert totals.entries[0] == 0
    assert totals.entries[1] >= 3


def test_a_gap_of_a_month_is_read_at_once(store: Store) -> None:
    month = 30 * 86_400 * 10**9
    calm = np.ones(100)
    for number, instant in enumerate((START, START + month)):
        put(store, stretch(number, calm - 0.5, calm + 0.5, time=(instant, instant)))
    formula = Channel(CHANNEL) > Fraction(3)
    with sources_of(store, formula) as sources:
        stored = StoredVerdicts(formula, sources)
        pieces = [*stored.pieces(Window(START, START + month + 100 * DT))]
        lone = [*StoredVerdicts(formula, sources).pieces(Window(START + month // 2, START + month))]
    verdicts = [(piece.verdict, piece.missing) for piece in pieces]
    calm_piece, gap = (Verdict.IMPOSSIBLE, False), (Verdict.POSSIBLE, True)
    assert verdicts[:3] == [calm_piece, gap, calm_piece]
    assert (pieces[1].first // 2, pieces[1].last // 2) == (START + 100 * DT, START + month - 1)
    assert (lone[0].missing, lone[0].because) == (True, Because.GAP)
    assert stored.reads < 200


def test_totals_state_the_coverage_of_all_samples(store: Store) -> None:
    put(store, at(0, 1.0, 0, n=100, coverage=0.999))
    formula = Channel(CHANNEL) > Fraction(1, 5)
    with sources_of(store, formula) as sources:
        stored = StoredVerdicts(formula, sources)
        (*_,) = stored.pieces(Window(START, START + 900))
    assert stored.coverage == pytest.approx(0.9)


@pytest.mark.parametrize("samples", [1, 1000])
def test_coverage_counts_samples_and_not_runs(store: Store, samples: int) -> None:
    put(store, at(0, 1.0, 0, n=64, coverage=0.999), at(640, 0.0, 1, n=64, coverage=0.999))
    formula = Eventually((0, 100), Channel(CHANNEL) > Fraction(1, 5))
    with sources_of(store, formula) as sources:
        stored = StoredVerdicts(formula, sources, points=3, samples=samples)
        pieces = [*stored.pieces(Window(START + 200, START + 1000))]
    assert [piece.verdict for piece in pieces] == [Verdict.CERTAIN, Verdict.IMPOSSIBLE]
    # At the middle of each the samples of 100 ns count, and the one before that just ends.
    assert [piece.coverage for piece in pieces] == pytest.approx([1 - 11e-3, 1 - 11e-3], abs=1.1e-3)


def test_samples_of_several_windows_are_read_once(store: Store) -> None:
    put(store, at(0, 1.0, 0, n=40))
    windows = [Window(START, START + 50), Window(START + 200, START + 230)]
    expected = [START + t for t in (0, 10, 20, 30, 40, 200, 210, 220)]
    for compacted in (False, True):
        if compacted:
            compact_all(store)
        with store.read() as connection:
            channel = find_channel(connection, NODE, CHANNEL)
            assert read_samples(connection, channel, *windows).first.tolist() == expected


EVALUATION = "/api/v1/monitors/evaluation"
TOUCHES = np.where(np.arange(4000) % 1000 < 100, 5.0, 1.0)


def ask(formula: str, **more: object) -> dict[str, object]:
    return {"formula": formula, "start": START, "end": START + 3999 * DT, **more}


@pytest.mark.anyio
async def test_a_formula_is_answered_page_by_page(stand: Stand) -> None:
    parts = np.split(np.arange(4000), 4)
    put(
        stand.cloud.store,
        *(
            stretch(
                number,
                TOUCHES[part] - 0.5,
                TOUCHES[part] + 0.5,
                time=(START + int(part[0]) * DT,) * 2,
            )
            for number, part in enumerate(parts)
        ),
    )
    formula = f"once[0,{50 * DT}ns] {CHANNEL} > 3"
    whole = (await stand.get(EVALUATION, **ask(formula, node=NODE))).json()
    assert whole["next"] is None
    verdicts = [each["verdict"] for each in whole["items"]]
    assert verdicts == ["certain", "impossible"] * 4
    again: list[object] = []
    cursor: str | None = ""
    while cursor is not None:
        more = {"cursor": cursor} if cursor else {}
        page = (await stand.get(EVALUATION, **ask(formula, node=NODE, limit=3, **more))).json()
        again += page["items"]
        cursor = page["next"]
    assert again == whole["items"]
    quoted = formula.replace(CHANNEL, f'"{NODE}/{CHANNEL}"')
    certain = (await stand.get(EVALUATION, **ask(quoted, verdict="certain"))).json()
    assert certain["items"] == whole["items"][::2]


BAD: tuple[tuple[dict[str, object], int], ...] = (
    ({"formula": "p >"}, 422),
    ({"formula": "1 > 2", "node": NODE}, 422),
    ({"formula": f"{CHANNEL} > 1"}, 422),
    ({"formula": f"{CHANNEL} > 1 V", "node": NODE}, 422),
    ({"formula": f"once {CHANNEL} > 1", "node": NODE}, 422),
    ({"formula": "t99.nothing > 1", "node": NODE}, 404),
    ({"formula": f'"nowhere/{CHANNEL}" > 1'}, 404),
    ({"formula": f"{CHANNEL} > 1", "node": NODE, "verdict": "perhaps"}, 422),
    ({"formula": f"{CHANNEL} > 1", "node": NODE, "start": "2200-01-01T00:00:00Z",
      "end": "2201-01-01T00:00:00Z"}, 422),
    ({"formula": f"{CHANNEL} > 1", "node": NODE, "cursor": "x"}, 422),
    ({"formula": "x" * 1001, "node": NODE}, 422),
)  # fmt: skip


@pytest.mark.anyio
@pytest.mark.parametrize(("parameters", "status"), BAD)
async def test_what_cannot_be_evaluated_is_refused(
    stand: Stand, parameters: dict[str, object], status: int
) -> None:
    put(stand.cloud.store, stretch(0, TOUCHES[:10] - 0.5, TOUCHES[:10] + 0.5))
    assert (await stand.get(EVALUATION, **parameters)).status_code == status


def test_hulls_decide_where_nothing_happens(store: Store) -> None:
    calm = np.ones(1000)
    for number in range(8):
        time = START + number * 1000 * DT
        put(store, stretch(number, calm - 0.5, calm + 0.5, time=(time, time)))
    formula = Atom(Channel(CHANNEL), Comparison.GREATER, Constant(3))
    window = Window(START + 10 * DT, START + 6000 * DT)
    with sources_of(store, formula) as sources:
        stored = StoredVerdicts(formula, sources, points=16, samples=100)
        (piece,) = stored.pieces(window)
    assert piece.verdict is Verdict.IMPOSSIBLE
    assert stored.reads == 1
