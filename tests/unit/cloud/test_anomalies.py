"""Channels beside predictions: against the model, sample by sample."""

from __future__ import annotations

from fractions import Fraction
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_cloud.query.channel_runs import ChannelSource
from eskin_cloud.query.stored_verdicts import StoredVerdicts
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import eskin
from eskin.interval import Interval
from eskin.monitor import (
    Channel,
    Deviation,
    Prediction,
    PredictionParameter,
    Signal,
    evaluate,
)
from eskin.monitor.predicted_quantities import MODELS
from tests.support.examples import examples
from tests.unit.cloud.clouds import emptied, problem, put
from tests.unit.cloud.messages import CHANNEL, NODE, START, stretch, tube_of

if TYPE_CHECKING:
    from eskin_cloud.store import Store

    from eskin.wire.frames import Frame
    from tests.unit.cloud.clouds import Stand

MS = 1_000_000
SWING = {
    "minimum_capacitance": Interval(9e-12, 11e-12),
    "maximum_capacitance": Interval(95e-12, 105e-12),
    "frequency": Interval(2.0, 2.0),
}
ANOMALIES = f"/api/v1/series/{NODE}/{CHANNEL}/anomalies"
PREDICTION = f"/api/v1/series/{NODE}/{CHANNEL}/prediction"
ASKED = {
    "model": "alternating_capacitance",
    "parameter": [f"{name}:{b.inf}:{b.sup}" for name, b in SWING.items()],
}
BAD: tuple[tuple[dict[str, Any], str], ...] = (
    ({"model": "weather"}, "model"),
    (
        {
            "model": "touch.area",
            "parameter": ["minimum_area:1", "maximum_area:2", "distance:1", "voltage:1"],
        },
        "channel's unit",
    ),
    ({"model": "touch.capacitance", "parameter": []}, "minimum_area is missing"),
    ({"parameter": ["frequency:2"]}, "minimum_capacitance is missing"),
    ({"parameter": [*ASKED["parameter"], "frequency:2"]}, "twice"),
    ({"parameter": [*ASKED["parameter"], "colour:2"]}, "'colour' is no parameter"),
    ({"parameter": ["frequency"]}, "NAME:LO:HI"),
    ({"parameter": ["frequency:3:2", *ASKED["parameter"][:2]]}, "reversed"),
    ({"parameter": ["frequency:1e999999999"]}, "NAME:LO:HI"),
    ({"parameter": ["frequency:inf"]}, "NAME:LO:HI"),
    ({"parameter": ["frequency:nan"]}, "NAME:LO:HI"),
    ({"parameter": ["frequency:1:2:3"]}, "NAME:LO:HI"),
    ({"parameter": ["minimum_capacitance:-1", *ASKED["parameter"][1:]]}, "must be > 0"),
    ({"origin": "noon"}, "RFC 3339"),
    ({"start": None}, "origin"),
)


def predicted(t: int, error: int, origin: int = START) -> Interval:
    """By the model, for all instants at which a sample may have been taken."""
    early, late = (Fraction(t + side - origin, 10**9) for side in (-error, error))
    time = Interval(np.nextafter(float(early), -np.inf), np.nextafter(float(late), np.inf))
    return eskin.models.alternating_capacitance(time, **SWING)


@st.composite
def measured(draw: st.DrawFn) -> list[Frame]:
    """Frames near the prediction, off it, or astride; with gaps and clocks."""
    made, first = [], START
    for sequence in range(draw(st.integers(1, 6))):
        n = draw(st.integers(1, 9))
        first += draw(st.sampled_from([10, 10, 400])) * MS
        error = draw(st.sampled_from([0, 1, 5])) * MS
        tubes = [predicted(first + 10 * MS * k, error) for k in range(n)]
        moved = draw(st.sampled_from([0.0, 0.0, 1e-12, 60e-12]))
        spread = draw(st.lists(st.sampled_from([-0.3, 0.2, 0.6]), min_size=n, max_size=n))
        lo = [float(p.inf) + moved + s * 1e-12 for p, s in zip(tubes, spread, strict=True)]
        hi = [bound + 0.5e-12 for bound in lo]
        time = first - error, first + error
        made.append(stretch(sequence, lo, hi, time=time, dt=10 * MS))
        first += 10 * MS * (n - 1)
    return draw(st.permutations(made))


@settings(
    max_examples=examples(30),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(measured(), st.integers(-50, 300), st.integers(0, 500), st.sampled_from((1, 3, 10**6)))
def test_anomalies_equal_a_look_at_each_sample(
    store: Store, said: list[Frame], start: int, span: int, samples: int
) -> None:
    window = Window(START + start * MS, START + (start + span) * MS)
    put(emptied(store), *said)
    prediction = with_bounds("alternating_capacitance", SWING)
    formula = Deviation(source=CHANNEL, prediction=prediction) > 0
    with store.read() as connection:
        sources = {CHANNEL: ChannelSource(connection, find_channel(connection, NODE, CHANNEL))}
        stored = StoredVerdicts(formula, sources, points=3, samples=samples)
        pieces = [*stored.pieces(window)]
    # Brute force: each sample's answer as a channel of its own, 0, 1 or any of both.
    t, error, lo, hi = [], [], [], []
    for tube in sorted(map(tube_of, said), key=lambda tube: tube.first_instant):
        for instant, low, high in zip(
            tube.instants.tolist(), tube.values.inf, tube.values.sup, strict=True
        ):
            band = predicted(instant, tube.time_error)
            t.append(instant)
            error.append(tube.time_error)
            lo.append(float(low > band.sup or high < band.inf))
            hi.append(float(not (band.inf <= low and high <= band.sup)))
    instants = np.array(t), np.array(error)
    gap = np.append(np.diff(instants[0]) > 15 * MS, False)
    earliest = np.maximum.accumulate(instants[0] - instants[1])
    latest = np.maximum(instants[0] + instants[1], earliest)
    answers = Signal(earliest, latest, lo, hi, 10 * MS, gap)
    expected = evaluate(Channel("answer") > Fraction(1, 2), {"answer": answers})
    for piece in pieces:
        edges = expected.ticks[(expected.ticks >= piece.first) & (expected.ticks <= piece.last)]
        ticks = np.append(edges, [piece.first, piece.last])
        assert set(expected.codes_at_ticks(ticks).tolist()) == {int(piece.verdict)}


@pytest.mark.anyio
async def test_parameters_enclose_what_their_text_says(stand: Stand) -> None:
    put(stand.cloud.store, stretch(0, [0.1], [0.1]))
    asked = {"start": START, "end": START + MS, "model": "constant", "parameter": "value:0.1"}
    tube = (await stand.get(PREDICTION, **asked, points=1)).json()
    assert Fraction(tube["lo"][0]) < Fraction("0.1") < Fraction(tube["hi"][0])
    assert (await stand.get(ANOMALIES, **asked)).json()["items"] == []


def with_bounds(quantity: str, bounds: dict[str, Interval]) -> Prediction:
    parameters = tuple(
        PredictionParameter(name, Fraction(float(b.inf)), Fraction(float(b.sup)))
        for name, b in bounds.items()
    )
    return Prediction(quantity, parameters, START)


@pytest.mark.anyio
async def test_every_model_is_listed_with_parameters_that_it_takes(stand: Stand) -> None:
    listed = (await stand.get("/api/v1/models")).json()
    assert [each["id"] for each in listed["items"]] == list(MODELS)
    assert listed["next"] is None
    instants = START + 10 * MS * np.arange(100)
    for each in listed["items"]:
        assert each["unit"] == MODELS[each["id"]].unit
        assert each["description"]
        usual = {p["name"]: p["usual"] or {"lo": 1.0, "hi": 2.0} for p in each["parameters"]}
        bounds = {name: Interval(b["lo"], b["hi"]) for name, b in usual.items()}
        unit = each["unit"] or "F"
        lo, hi = with_bounds(each["id"], bounds).between(instants, instants, unit)
        assert np.all(np.isfinite(lo) & np.isfinite(hi) & (lo <= hi))
        required = {p["name"]: bounds[p["name"]] for p in each["parameters"] if p["required"]}
        again = with_bounds(each["id"], required).between(instants, instants, unit)
        assert np.array_equal(again, (lo, hi)), (
            "what is usual is what is taken where it is left out"
        )
        units = {p["name"]: p["unit"] for p in each["parameters"]}
        assert units.pop("value", None) is None
        assert None not in units.values()


@pytest.mark.anyio
async def test_anomalies_and_their_tube_over_http(stand: Stand) -> None:
    t = [START + 10 * MS * k for k in range(20)]
    tubes = [predicted(each, 0) for each in t]
    # Just within: a frame rounds its bounds outward.
    lo = [float(p.inf) + 1e-14 for p in tubes]
    hi = [float(p.sup) - 1e-14 for p in tubes]
    lo[4:8], hi[4:8] = [1e-9] * 4, [2e-9] * 4
    hi[12] *= 1.5
    put(stand.cloud.store, stretch(0, lo, hi, dt=10 * MS))
    asked: dict[str, Any] = {**ASKED, "start": START, "end": START + 200 * MS}
    async with stand.client() as client:
        found = (await client.get(ANOMALIES, params=asked)).json()
        one = (await client.get(ANOMALIES, params=asked | {"limit": 1})).json()
        asked["cursor"] = one["next"]
        rest = (await client.get(ANOMALIES, params=asked)).json()
        del asked["cursor"]
        total = (await client.get(f"{ANOMALIES}/time", params=asked)).json()
        tube = (await client.get(PREDICTION, params=asked | {"points": 10})).json()
    assert [each["verdict"] for each in found["items"]] == ["certain", "possible"]
    assert one["items"] + rest["items"] == found["items"]
    assert total["time_s"] == pytest.approx({"lo": 0.04, "hi": 0.05})
    assert len(tube["t"]) == 10
    assert tube["dt"] == 20 * MS
    for k, p in enumerate(tubes):
        assert tube["lo"][k // 2] <= float(p.inf)
        assert tube["hi"][k // 2] >= float(p.sup)


@pytest.mark.anyio
async def test_bad_predictions_are_refused(stand: Stand, subtests: pytest.Subtests) -> None:
    put(stand.cloud.store, stretch(0, [1e-12], [2e-12]))
    for path, (change, said) in product((ANOMALIES, f"{ANOMALIES}/time", PREDICTION), BAD):
        with subtests.test(f"{path} {change}"):
            asked = {"start": START} | ASKED | change
            given = {name: value for name, value in asked.items() if value is not None}
            assert said in problem(await stand.get(path, **given), 422)
