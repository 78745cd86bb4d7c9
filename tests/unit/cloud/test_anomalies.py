"""Channels beside predictions: against the model, sample by sample."""

from __future__ import annotations

from fractions import Fraction
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_cloud.query.anomalies import find_anomalies
from eskin_cloud.query.models import MODELS
from eskin_cloud.query.predicate import Predicate
from eskin_cloud.query.prediction import Prediction
from eskin_cloud.query.segments import Segment, find_segments_of, merge
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import eskin
from eskin.errors import QueryError
from eskin.interval import Interval, Verdict
from tests.unit.cloud.clouds import emptied, problem, put
from tests.unit.cloud.messages import CHANNEL, NODE, START, stretch, tube_of
from tests.unit.cloud.test_queries import is_gap, windows, within
from tests.unit.cloud.test_queries import stretches as drawn_frames

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
    ({"model": "touch.area"}, "same unit"),
    ({"model": "touch.capacitance", "parameter": []}, "minimum_area is missing"),
    ({"parameter": ["frequency:2"]}, "minimum_capacitance is missing"),
    ({"parameter": [*ASKED["parameter"], "frequency:2"]}, "twice"),
    ({"parameter": [*ASKED["parameter"], "colour:2"]}, "'colour' is none of"),
    ({"parameter": ["frequency"]}, "NAME:LO:HI"),
    ({"parameter": ["frequency:3:2"]}, "NAME:LO:HI"),
    ({"parameter": ["frequency:nan"]}, "NAME:LO:HI"),
    ({"parameter": ["frequency:1:2:3"]}, "NAME:LO:HI"),
    ({"parameter": ["minimum_capacitance:-1", *ASKED["parameter"][1:]]}, "must be > 0"),
    ({"origin": "noon"}, "RFC 3339"),
)


def swinging(origin: int = START) -> Prediction:
    return Prediction(MODELS["alternating_capacitance"], SWING, origin)


def predicted(t: int, error: int, origin: int = START) -> Interval:
    """By the model, for all moments at which a sample may have been taken."""
    early, late = (Fraction(t + side - origin, 10**9) for side in (-error, error))
    time = Interval(np.nextafter(float(early), -np.inf), np.nextafter(float(late), np.inf))
    return eskin.models.alternating_capacitance(time, **SWING)


@st.composite
def measured(draw: st.DrawFn) -> list[Frame]:
    """Frames near the prediction, off it, or astride; with gaps, overlaps and clocks."""
    made = []
    for sequence in range(draw(st.integers(1, 6))):
        n, first = draw(st.integers(1, 9)), START + draw(st.integers(0, 400)) * MS
        error = draw(st.sampled_from([0, 1, 5])) * MS
        tubes = [predicted(first + 10 * MS * k, error) for k in range(n)]
        moved = draw(st.sampled_from([0.0, 0.0, 1e-12, 60e-12]))
        spread = draw(st.lists(st.sampled_from([-0.3, 0.2, 0.6]), min_size=n, max_size=n))
        lo = [float(p.inf) + moved + s * 1e-12 for p, s in zip(tubes, spread, strict=True)]
        hi = [bound + 0.5e-12 for bound in lo]
        time = first - error, first + error
        made.append(stretch(sequence, lo, hi, time=time, dt=10 * MS))
    return draw(st.permutations(made))


def ask(store: Store, window: Window, prediction: Prediction) -> list[Segment]:
    with store.read() as connection:
        row = find_channel(connection, NODE, CHANNEL)
        return list(merge(find_anomalies(connection, row, window, prediction)))


def brute(said: list[Frame], window: Window) -> list[tuple[int, int, Verdict]]:
    """Sample by sample."""
    runs: list[tuple[int, int, Verdict]] = []
    errors = {t: tube.time_error for tube in map(tube_of, said) for t in tube.moments.tolist()}
    last = None
    for sample in within(said, window):
        tube = predicted(sample.t, errors[sample.t])
        disjoint = sample.lo > tube.sup or sample.hi < tube.inf
        inside = tube.inf <= sample.lo and sample.hi <= tube.sup
        answer = Verdict(2 if disjoint else 0 if inside else 1)
        if last is not None and runs[-1][2] is answer and not is_gap(last, sample):
            runs[-1] = runs[-1][0], sample.t, answer
        else:
            runs.append((sample.t, sample.t, answer))
        last = sample
    return runs


@settings(
    max_examples=25,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(said=measured(), start=st.integers(-50, 300), span=st.integers(0, 500))
def test_anomalies_equal_a_look_at_each_sample(
    store: Store, said: list[Frame], start: int, span: int
) -> None:
    window = Window(START + start * MS, START + (start + span) * MS)
    firsts = [tube_of(b).first_moment % (10 * MS) for b in said]
    said = [b for b, first in zip(said, firsts, strict=True) if firsts.count(first) == 1]
    if not said:
        return
    put(emptied(store), *said)
    found = ask(store, window, swinging())
    assert [(r.start, r.end, r.answer) for r in found] == brute(said, window)


@settings(
    max_examples=30,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(said=drawn_frames(), window=windows)
def test_a_standing_band_is_asked_as_a_threshold(
    store: Store, said: list[Frame], window: Window
) -> None:
    band = Prediction(MODELS["constant"], {"value": Interval(0.1, 1.0)}, 0)
    put(emptied(store), *said)
    with store.read() as connection:
        row = find_channel(connection, NODE, CHANNEL)
        outside = Predicate(0.1, 1.0, outside=True)
        runs = find_segments_of(connection, row, window, outside)
        assert ask(store, window, band) == list(merge(runs))


@settings(max_examples=30, deadline=None)
@given(st.integers(-(10**18), 10**18), st.integers(0, 10**10), st.floats(0.0, 1.0))
def test_a_bucket_encloses_all_that_is_predicted_in_it(begin: int, span: int, part: float) -> None:
    first, last = np.array([START + begin]), np.array([START + begin + span])
    lo, hi = swinging().between(first, last)
    moment = int(first[0]) + int(span * part)
    inner = predicted(min(moment, int(last[0])), 0)
    # A thin moment's own rounding is not part of what must be enclosed.
    assert lo[0] <= inner.sup
    assert hi[0] >= inner.inf


@pytest.mark.parametrize("side", [-np.inf, np.inf])
@pytest.mark.parametrize("origin", [-(2**63) + 1, -(2**63) + 10, -5, 0, START, 2**63 - 1])
def test_model_times_enclose_the_exact_ones_however_far(origin: int, side: float) -> None:
    moments = [-(2**63) + 1, -(2**62), -1, 0, 1, START, START + 1, 2**62, 2**63 - 1]
    found = Prediction(MODELS["constant"], {}, origin)._seconds(np.array(moments), side)
    for moment, stated in zip(moments, found.tolist(), strict=True):
        exact = Fraction(moment - origin, 10**9)
        assert (Fraction(stated) - exact) * int(np.sign(side)) >= 0
        assert float(abs(Fraction(stated) - exact)) <= 4 * np.spacing(abs(stated))


@pytest.mark.parametrize("origin", [-(2**63) + 10, 0, 2**63 - 1])
def test_prediction_over_all_time_is_answered(origin: int) -> None:
    moments = np.array([-(2**63) + 1, 0]), np.array([2**63 - 1, 2**63 - 1])
    lo, hi = swinging(origin).between(*moments)
    inner = swinging(START).between(np.array([START]), np.array([START + 10**9]))
    assert np.all(lo <= inner[0])
    assert np.all(hi >= inner[1])


@pytest.mark.anyio
async def test_parameters_enclose_what_their_text_says(stand: Stand) -> None:
    put(stand.cloud.store, stretch(0, [0.1], [0.1]))
    asked = {"start": START, "end": START + MS, "model": "constant", "parameter": "value:0.1"}
    tube = (await stand.get(PREDICTION, **asked, points=1)).json()
    assert Fraction(tube["lo"][0]) < Fraction("0.1") < Fraction(tube["hi"][0])
    assert (await stand.get(ANOMALIES, **asked)).json()["items"] == []


@pytest.mark.parametrize("name", [name for name in MODELS if name != "constant"])
def test_every_model_names_what_it_lacks_and_answers_with_it(name: str) -> None:
    model = MODELS[name]
    with pytest.raises(QueryError, match="is missing"):
        model.require_parameters({})
    with pytest.raises(QueryError, match="is none of"):
        model.require_parameters({"colour": Interval(1.0)})


@pytest.mark.anyio
async def test_every_model_is_listed_with_parameters_that_it_takes(stand: Stand) -> None:
    listed = (await stand.get("/api/v1/models")).json()
    assert [each["id"] for each in listed["items"]] == list(MODELS)
    assert listed["next"] is None
    moments = START + 10 * MS * np.arange(100)
    for each in listed["items"]:
        assert each["unit"] == MODELS[each["id"]].unit
        assert each["description"]
        usual = {p["name"]: p["usual"] or {"lo": 1.0, "hi": 2.0} for p in each["parameters"]}
        bounds = {name: Interval(b["lo"], b["hi"]) for name, b in usual.items()}
        prediction = Prediction(MODELS[each["id"]], bounds, START)
        lo, hi = prediction.between(moments, moments)
        assert np.all(np.isfinite(lo) & np.isfinite(hi) & (lo <= hi))
        required = {p["name"]: bounds[p["name"]] for p in each["parameters"] if p["required"]}
        again = Prediction(MODELS[each["id"]], required, START).between(moments, moments)
        assert [each.size for each in prediction.between(moments[:0], moments[:0])] == [0, 0]
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
    assert total["samples"] == {"lo": 4, "hi": 5}
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
            assert said in problem(await stand.get(path, **ASKED | change), 422)
