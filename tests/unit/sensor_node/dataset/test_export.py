"""A dataset: rows that hold their truth, two formats that agree, bytes that a seed decides."""

from __future__ import annotations

import subprocess
import sys
from array import array
from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
from eskin_sensor_node.machine.data_sheet import data_sheet
from eskin_sensor_node.machine.inversion import Inversion
from eskin_sensor_node.tools.dataset import Plan, write_dataset
from eskin_sensor_node.world.scenario import LABELS

from eskin.cli.export import export
from eskin.errors import ScenarioError, SettingsError
from tests.unit.sensor_node.scenario.scripts import HEAD, TAP, write

if TYPE_CHECKING:
    from pathlib import Path

FILES = ["README.md", "scenario.toml", "test.csv", "test.parquet", "train.csv", "train.parquet"]
METAL = '\n[[event]]\nkind = "approach"\nat = "t05"\nat_s = 1.5\nduration_s = 1.4\nnear_m = 1e-2\n'
VARIED = "\n[variation]\ntime_s = 0.05\nforce = 0.2\nposition_m = 1e-3\n"
BROKEN = '\n[[fault]]\ntaxel = "t02"\nkind = "{}"\nat_s = 1.15\n'
SHORT = HEAD.replace("10.0", "3.0").replace("4\npitch", "4\ncrosstalk = 0.2\npitch")


def make(folder: Path, text: str = SHORT + TAP + METAL + VARIED, seed: int = 0) -> Path:
    folder.mkdir()
    plan = Plan.of(write(folder, text), seeds=range(seed, seed + 3), test=1, rate=50.0)
    write_dataset(plan, folder / "out", licence="CC0-1.0", progress=lambda _done, _total: None)
    return folder / "out"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make(tmp_path_factory.mktemp("dataset") / "first")


def columns(folder: Path, part: str = "train") -> dict[str, Any]:
    table = pyarrow.parquet.read_table(folder / f"{part}.parquet")
    return {name: table[name].to_numpy() for name in table.column_names}


def intervals(names: dict[str, Any]) -> list[tuple[str, str, str]]:
    """True, lower and upper column of each quantity that is measured."""
    return [
        (name, name.replace("_true", "_lo"), name.replace("_true", "_hi"))
        for name in names
        if "_true" in name and name.replace("_true", "_lo") in names
    ]


@pytest.mark.parametrize("fault", ["", BROKEN.format("stuck"), BROKEN.format("dead")])
def test_every_interval_holds_its_truth_also_beside_broken_taxels(
    fault: str, tmp_path: Path
) -> None:
    found = columns(make(tmp_path / "set", SHORT + TAP + METAL + VARIED + fault))
    triples = intervals(found)
    assert len(triples) == 13
    for true, lo, hi in triples:
        holds = (found[lo] <= found[true]) & (found[true] <= found[hi])
        assert holds.all(), (true, int((~holds).sum()))
    assert set(found["fault"]) == {"none", *([fault.split('"')[3]] if fault else [])}


@pytest.mark.parametrize("fault", ["", BROKEN.format("stuck").replace("t02", "t05")])
def test_thin_tubes_hold_the_truth_under_crosstalk_and_beside_a_stuck_taxel(
    fault: str, tmp_path: Path
) -> None:
    # Next to nothing is uncertain but the crosstalk, so that no other width can hide it.
    exact = "".join(
        f"{part}_tolerance = 0.0\n"
        for part in (
            *("plate_area", "plate_distance", "relative_permittivity", "elasticity"),
            *("resistance", "reference", "transconductance"),
        )
    )
    sheet = f'[pad]\nadc_bits = 24\nnoise = {{ kind = "uniform", bound = 0.0 }}\n{exact}'
    good = 'adc_bits = 24\nnoise = { kind = "uniform", bound = 0.0 }\n'
    air = f"[thermometer]\n{good}tolerance_K = 0.0\ntolerance_per_K = 0.0\n"
    air += f"series_resistance_tolerance = 0.0\n[hygrometer]\n{good}error_percent = 0.0\n"
    for part in ("capacitance", "sensitivity", "resistance", "reference", "transconductance"):
        air += f"{part}_tolerance = 0.0\n"
    press = TAP.replace("tap", "press").replace("4e-3", "1.5e-2")
    found = columns(make(tmp_path / "set", SHORT + air + press + fault + sheet))
    lo, true, hi = (found[f"pressure_{side}_Pa"] for side in ("lo", "true", "hi"))
    assert np.all((lo <= true) & (true <= hi))
    assert np.median((hi - lo)[(true > 100.0) & (found["taxel"] != "t05")]) < 500.0


AROUND = """
[ambient]
temperature_Cel = [[0.0, -20.0], [3.0, 45.0]]
humidity_percent = [[0.0, 20.0], [3.0, 90.0]]

[bioelectric]
amplitude_V = 1e-3
"""
QUANTITIES = ("temperature_{}_Cel", "humidity_{}_percent", "bioelectric_{}_V")


@pytest.mark.parametrize(
    ("sheets", "most"),
    [
        ("", (0.9, 12.0, 4e-5)),
        (
            '[thermometer]\nadc_bits = 6\nnoise = { kind = "uniform", bound = 1e-3 }\n',
            (9.0, 12.0, 4e-5),
        ),
        ("[hygrometer]\nerror_percent = 8.0\n[electrode]\nadc_bits = 5\n", (0.9, 25.0, 3e-4)),
    ],
)
def test_air_and_body_go_through_their_chains_and_are_enclosed(
    sheets: str, most: tuple[float, float, float], tmp_path: Path
) -> None:
    found = columns(make(tmp_path / "set", SHORT + TAP + AROUND + sheets))
    for name, limit in zip(QUANTITIES, most, strict=True):
        lo, true, hi = (found[name.format(side)] for side in ("lo", "true", "hi"))
        assert np.all((lo <= true) & (true <= hi)), name
        # Neither unbounded nor much wider than its data sheet; nor read by an ideal sensor.
        assert 0.3 * limit < np.max(hi - lo) <= limit, (name, np.max(hi - lo))
        assert np.ptp((hi + lo) / 2.0 - true) > 0.0
    for true, lo, hi in intervals(found):
        assert np.all((found[lo] <= found[true]) & (found[true] <= found[hi])), true


def test_air_equals_a_node_s_sensors(tmp_path: Path) -> None:
    path = write(tmp_path, SHORT + TAP + AROUND)
    plan = Plan.of(path, seeds=range(2), test=1, rate=50.0)
    for sensor in (plan.thermometer, plan.hygrometer, plan.electrode):
        # Of the same data sheet as a taxel of a node, so of the same arithmetic.
        firmware = sensor.firmware(data_sheet(sensor))
        codes = {name: np.arange(0, 4096, 97) for name in firmware.inputs}
        bounds = [array("d", bytes(8 * 43)) for _ in range(2)]
        firmware.measure(
            [array("q", codes[name].tobytes()) for name in firmware.inputs], 43, bounds
        )
        (stated,) = Inversion(sensor).measure(codes).values()
        assert (stated.inf.tobytes(), stated.sup.tobytes()) == tuple(b.tobytes() for b in bounds)


def test_both_formats_say_the_same_to_the_last_bit(made: Path) -> None:
    for part in ("train", "test"):
        text = pyarrow.csv.read_csv(made / f"{part}.csv")
        binary = pyarrow.parquet.read_table(made / f"{part}.parquet")
        assert text.column_names == binary.column_names
        for name in text.column_names:
            assert text[name].to_pylist() == binary[name].to_pylist(), name


def test_same_seeds_give_the_same_bytes_and_others_do_not(made: Path, tmp_path: Path) -> None:
    again, other = make(tmp_path / "again"), make(tmp_path / "other", seed=7)
    assert sorted(path.name for path in made.iterdir()) == FILES
    for name in FILES:
        assert (made / name).read_bytes() == (again / name).read_bytes(), name
    assert (made / "train.parquet").read_bytes() != (other / "train.parquet").read_bytes()


def test_train_and_test_share_no_seed_and_all_rows_are_there(made: Path) -> None:
    train, test = columns(made), columns(made, "test")
    assert set(train["run"]) == {0, 1}
    assert set(test["run"]) == {2}
    assert len(train["run"]) == 2 * len(test["run"]) == 2 * 12 * 150
    order = np.lexsort((train["taxel"].astype(str), train["time_s"], train["run"]))
    assert np.array_equal(order, np.arange(len(order)))


def test_labels_and_truth_agree(made: Path) -> None:
    found = columns(made)
    tapped = found["label"] == "tap"
    assert set(found["label"]) == {"noise", "tap", "approach"}
    assert np.array_equal(tapped, found["contact_area_true_m2"] > 0.0)
    assert np.array_equal(tapped, found["pressure_true_Pa"] > 0.0)
    assert np.all(found["distance_true_m"][found["label"] == "approach"] < 0.1)
    # Some of it is certain: a threshold that a model could learn.
    assert np.any(found["pressure_lo_Pa"][tapped] > 0.0)
    assert not np.any(found["pressure_lo_Pa"][found["label"] == "noise"] > 0.0)


def test_card_names_columns_labels_seeds_licence_and_versions(made: Path) -> None:
    text = (made / "README.md").read_text()
    for name in columns(made):
        assert f"| `{name}` |" in text
    counts = Counter(columns(made, "test")["label"].tolist())
    for label in LABELS:
        assert f" | {counts[label]} |" in text
    for word in ("CC0-1.0", "seeds 0 to 1", "seeds 2)", "pyarrow 2", "numpy 2", "at least 1.0"):
        assert word in text
    assert "None" not in text.split("## Columns")[0]
    field = pyarrow.parquet.read_schema(made / "train.parquet").field("capacitance_lo_F")
    assert field.metadata[b"unit"] == b"F"


def test_scenario_lies_beside_the_data_and_can_be_used_again(made: Path) -> None:
    plan = Plan.of(str(made / "scenario.toml"), seeds=range(2), test=1, rate=50.0)
    assert len(plan.pads) == len(plan.coils) == 12


def test_no_metal_means_no_coils(tmp_path: Path) -> None:
    found = columns(make(tmp_path / "set", SHORT + TAP))
    assert not any("inductance" in name for name in found)


def test_stuck_taxel_stays_and_dead_one_saturates(tmp_path: Path) -> None:
    press = TAP.replace("t05", "t02").replace("tap", "press")
    for kind in ("stuck", "dead"):
        found = columns(make(tmp_path / kind, SHORT + press + BROKEN.format(kind)))
        rows = (found["taxel"] == "t02") & (found["fault"] == kind) & (found["run"] == 0)
        assert rows.sum() == 92  # from 1.16 s on
        assert len(set(found["capacitance_true_F"][rows])) == 1
        assert np.isneginf(found["capacitance_lo_F"][rows]).all() == (kind == "dead")
        assert np.ptp(found["pressure_true_Pa"][rows]) > 1e3
        lo, true, hi = (found[f"plate_distance_{side}_m"][rows] for side in ("lo", "true", "hi"))
        assert np.all((lo <= true) & (true <= hi))


def test_data_sheets_of_the_scenario_are_used(tmp_path: Path) -> None:
    sheet = '[pad]\nadc_bits = 6\nnoise = { kind = "gaussian", sigma = 1e-7, k = 4.0 }\n'
    found = columns(make(tmp_path / "coarse", SHORT + TAP + sheet))
    width = found["capacitance_hi_F"] - found["capacitance_lo_F"]
    assert width.min() > 0.01 * found["capacitance_true_F"].max()
    assert "at least 0.99993" in (tmp_path / "coarse" / "out" / "README.md").read_text()


@pytest.mark.parametrize(
    ("sheet", "said"),
    [
        ("[pad]\nadc_bit = 6\n", "pad.adc_bit: no such key"),
        ("[pad]\nadc_bits = 60\n", "pad.adc_bits: 60 is not allowed"),
        ("[coil]\nexcitation_Hz = 0.0\n", "coil.excitation_Hz: 0.0 is not allowed"),
        ("[pad]\nsampling_Hz = 10.0\n", "pad.sampling_Hz: the dataset itself sets it"),
        ("[electrode]\nplace = 't01'\n", "electrode.place: the dataset itself sets it"),
        ("[hygrometer]\nadc_bits = 60\n", "hygrometer.adc_bits: 60 is not allowed"),
        ("[pad]\npressure_max_Pa = 10.0\n", "pad: the scenario's contacts press with up to"),
    ],
)
def test_bad_data_sheet_gives_one_line_with_its_place(
    sheet: str, said: str, tmp_path: Path
) -> None:
    path = write(tmp_path, SHORT + TAP + sheet)
    with pytest.raises(ScenarioError) as caught:
        Plan.of(path, seeds=range(2), test=1, rate=50.0)
    assert str(caught.value).startswith(f"{path}: {said}")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"test_runs": 10}, "--test-runs: 10 must be less than --runs 10"),
        ({"rate": 3.0}, "--rate: 3.0 is not allowed"),
        ({"rate": 0.1}, "--rate: 0.1 takes no sample in 3 s"),
    ],
)
def test_bad_options_are_refused(changes: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(SettingsError) as caught:
        export(write(tmp_path, SHORT), tmp_path / "out", **changes)
    assert str(caught.value).startswith(said)
    assert not (tmp_path / "out").exists()


def test_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    with pytest.raises(SettingsError, match=r"--out: .* cannot be written"):
        export(write(tmp_path, SHORT), tmp_path / "out")


def test_broken_off_export_leaves_no_halves(tmp_path: Path) -> None:
    plan = Plan.of(write(tmp_path, SHORT), seeds=range(3), test=1, rate=50.0)

    def stop(done: int, total: int) -> None:
        if done == total:
            raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        write_dataset(plan, tmp_path / "out", licence="CC0-1.0", progress=stop)
    assert list((tmp_path / "out").iterdir()) == []


def test_command_fails_in_one_line_with_status_2(tmp_path: Path) -> None:
    path = write(tmp_path, SHORT + TAP.replace("t05", "t77"))
    done = subprocess.run(
        [sys.executable, "-m", "eskin", "export", "--scenario", path, "--out", tmp_path / "out"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr == (
        f"eskin: {path}: event 1 (tap).at: taxel 't77' is not there; the skin has t00 to t11\n"
    )
