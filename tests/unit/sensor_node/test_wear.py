"""Pads that wear, get wet and remember loads: what is true of them, and what their node states."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_sensor_node.kinds.generator import ColumnGenerator
from eskin_sensor_node.kinds.registry import build_world
from eskin_sensor_node.node.ground_truth import GroundTruth
from pydantic import ValidationError

from eskin.identification import SetMembershipEstimator, find_wear, rest_capacitance
from eskin.interval import Interval
from eskin.models import capacitance
from tests.unit.sensor_node.dataset.test_export import columns, intervals, make
from tests.unit.sensor_node.designs import Bench, settings, table, taxel
from tests.unit.sensor_node.messages import samples_of
from tests.unit.sensor_node.scenario.scripts import HEAD, TAP, write
from tests.unit.sensor_node.test_skin_physics import EXACT

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.interval import Floats

TIMES = np.arange(1000) / 100.0
WEAR = """
[[wear]]
taxel = "t05"
at_s = 2.0
distance_per_s = -0.02
elasticity_per_s = 0.05
"""
FILM = """
[[film]]
taxel = "t05"
at_s = 3.0
duration_s = 2.0
share = 0.3
"""
HYSTERESIS = "\n[hysteresis]\nshare = 0.1\ndecay_s = 2.0\n"
ALL = {"worn": WEAR, "wet": FILM, "hysteresis": HYSTERESIS}


def truth(folder: Path, text: str, place: str = "t05") -> dict[str, Floats]:
    design = taxel("pad", **EXACT, scenario=write(folder, text), place=place, plate_area_m2=9e-5)
    random = ColumnGenerator(1, 0)
    found = build_world(design, random).signals(TIMES, random).truth
    return {name: values[0] for name, values in found.items()}


def test_worn_layer_is_thinner_and_stiffer_from_its_instant_on(tmp_path: Path) -> None:
    press = TAP.replace("tap", "press").replace("1.0\nd", "4.0\nd")
    new, worn = truth(tmp_path, HEAD + press), truth(tmp_path, HEAD + press + WEAR)
    since = np.maximum(TIMES - 2.0, 0.0)
    rest = new["pressure"] == 0.0
    ratio = worn["plate_distance"] / new["plate_distance"]
    assert ratio[rest] == pytest.approx(np.exp(-0.02 * since[rest]))
    # What is left of the capacitance is strain: it falls as the layer gets stiffer.
    strain = [
        each["capacitance"] * distance / (new["capacitance"][0] * 1e-3) - 1.0
        for each, distance in ((new, 1e-3), (worn, 1e-3 * np.exp(-0.02 * since)))
    ]
    assert strain[0].max() > 0.05
    pressed = strain[0] > 0.01
    assert strain[1][pressed] == pytest.approx((strain[0] * np.exp(-0.05 * since))[pressed])
    mean = capacitance(area=9e-5, distance=worn["plate_distance"], relative_permittivity=3.0)
    assert worn["capacitance"] == pytest.approx(mean.mid, rel=1e-9)
    assert np.array_equal(worn["pressure"], new["pressure"])


def test_wear_of_one_pad_leaves_others_alone(tmp_path: Path) -> None:
    text = HEAD + TAP + WEAR + FILM
    for name, values in truth(tmp_path, text, "t10").items():
        assert np.array_equal(values, truth(tmp_path, HEAD + TAP, "t10")[name]), name


def test_water_adds_its_share_for_as_long_as_it_lies(tmp_path: Path) -> None:
    dry, wet = truth(tmp_path, HEAD), truth(tmp_path, HEAD + FILM)
    lies = (TIMES >= 3.0) & (TIMES < 5.0)
    added = wet["capacitance"] / dry["capacitance"] - 1.0
    assert added == pytest.approx(np.where(lies, 0.3, 0.0))
    for name in ("pressure", "plate_distance", "contact_area"):
        assert np.array_equal(wet[name], dry[name])


def test_compression_remains_after_a_contact_and_fades(tmp_path: Path) -> None:
    firm, soft = truth(tmp_path, HEAD + TAP), truth(tmp_path, HEAD + TAP + HYSTERESIS)
    strain = soft["capacitance"] / firm["capacitance"][0] - 1.0
    peak = firm["pressure"].max() / 1e5  # over the elasticity
    after = TIMES > 1.2 + 1e-9
    assert strain[after] == pytest.approx(
        0.1 * peak * np.exp(-(TIMES[after] - 1.2) / 2.0), rel=1e-2
    )
    assert np.array_equal(soft["capacitance"][~after], firm["capacitance"][~after])
    assert np.array_equal(soft["pressure"], firm["pressure"])


@pytest.mark.parametrize("kinds", [("worn",), ("wet",), ("hysteresis",), ("worn", "wet")])
def test_dataset_holds_the_truth_of_departed_pads(kinds: tuple[str, ...], tmp_path: Path) -> None:
    text = HEAD.replace("10.0", "6.0") + TAP + "".join(ALL[kind] for kind in kinds)
    found = columns(make(tmp_path / "set", text))
    for true, lo, hi in intervals(found):
        assert np.all((found[lo] <= found[true]) & (found[true] <= found[hi])), true
    assert set(found["fault"]) == {"none", *kinds} - (
        {"none"} if kinds == ("hysteresis",) else set()
    )
    if kinds == ("wet",):
        marked = found["time_s"][found["fault"] == "wet"]
        assert (marked.min(), marked.max() < 5.0) == (3.0, True)


def pads(scene: str, **changes: Any) -> list[dict[str, Any]]:
    return [
        table("pad", id=place, scenario=scene, place=place, plate_area_m2=9e-5, pressure_max_Pa=5e4)
        | {"thermometer": None, "hygrometer": None, "resistance_ohm": 4e4, **changes}
        for place in ("t05", "t06")
    ]


def test_worn_pad_states_its_line_and_its_distance_right_and_its_pressure_wrong(
    tmp_path: Path,
) -> None:
    scene = write(tmp_path, HEAD + TAP + WEAR.replace("-0.02", "-0.05"))
    air = {"temperature_min_Cel": 19.0, "temperature_max_Cel": 21.0}
    air |= {"humidity_min_percent": 49.0, "humidity_max_percent": 51.0}
    bench = Bench(tmp_path, "hand", taxel=pads(scene, **air))
    bench.run_to(6.0)
    holds = {
        name: all(each.hold_truth() for each in samples_of(bench, name))
        for place in ("t05", "t06")
        for name in (
            f"{place}.{q}" for q in ("capacitance", "current", "plate_distance", "pressure")
        )
    }
    bench.close()
    assert [name for name, right in holds.items() if not right] == ["t05.pressure"]


def test_history_of_a_node_encloses_what_its_world_wears(tmp_path: Path) -> None:
    """Each minute the pad is pressed and then at rest; one rest is wet, and its trace breaks."""
    hold = TAP.replace("tap", "hold").replace("0.2\n", "8.0\ntimes = 6\nevery_s = 60.0\n")
    film = FILM.replace("3.0", "150.0").replace("2.0", "40.0")
    wear = "\n[[wear]]\ntaxel = 't05'\ndistance_per_s = -2e-4\n"
    dead = "\n[[fault]]\ntaxel = 't05'\nkind = 'dead'\nat_s = 290.0\n"
    scene = write(tmp_path, HEAD.replace("10.0", "360.0") + hold + film + wear + dead)
    pad = pads(scene, sampling_Hz=2.0)[0]
    bench = Bench(tmp_path, "hand", taxel=[pad], sampling={"stretch_ms": 2000.0})
    bench.run_to(360.0)
    found = samples_of(bench, "t05.capacitance")
    bench.close()
    online = SetMembershipEstimator(Interval(-3e-4, 3e-4), outliers=1, memory=10)
    begin, first = found[0].time, float(found[0].truth[0])  # at 20 °C and 50 %: C0
    air = Interval.around(1.0, 1e-3)  # the room is known within 1 K
    verdicts, widths = [], []
    sheet = Interval.relative(first, 0.01)
    for piece in found:
        for k in range(len(piece.tube)):
            since = k * piece.tube.dt
            earliest, latest = (t + since for t in piece.tube.time)
            age = (piece.time + since - begin) / 1e9
            at_rest = age % 60.0 > 15.0
            sample = rest_capacitance(piece.tube.values[k], air, at_rest=at_rest)
            online.push(earliest, latest, sample)
            if age % 60.0 == 50.0:
                product = online.at(latest)
                assert first * np.exp(2e-4 * age) in product, age
                verdicts.append(int(find_wear(product, sheet).certain))
                widths.append(float(product.wid))
    # Wear is certain after four minutes, and less and less known since the trace broke.
    assert verdicts == [0, 0, 0, 1, 1, 1]
    assert 0.06 * first > widths[5] > widths[4] > widths[3]


def test_departures_are_named_by_taxel_and_kept_with_the_truth(tmp_path: Path) -> None:
    scene = write(tmp_path, HEAD + TAP + WEAR + FILM + HYSTERESIS)
    found = settings(tmp_path, "hand", taxel=pads(scene)).departures
    assert found == [
        "t05: all pads: hysteresis from 0 s",
        "t05 at t05: worn from 2 s",
        "t05 at t05: wet from 3 s to 5 s",
        "t06: all pads: hysteresis from 0 s",
    ]
    path = tmp_path / "truth.sqlite"
    truth = GroundTruth(path, limit=1 << 20)
    for _ in range(2):
        truth.store_departures("hand", found)
    truth.close()
    assert GroundTruth.departures(path) == {"hand": sorted(found)}


def test_more_worn_neighbours_than_the_data_sheet_doubts_are_refused(tmp_path: Path) -> None:
    both = WEAR.replace("t05", "t06") + WEAR.replace("t05", "t04")
    scene = write(tmp_path, HEAD + both)
    with pytest.raises(ValidationError, match="t04 and t06 beside t05 get stuck or wear"):
        taxel("pad", scenario=scene, place="t05", plate_area_m2=9e-5)
    taxel("pad", scenario=scene, place="t05", plate_area_m2=9e-5, doubtful_neighbours=2)
