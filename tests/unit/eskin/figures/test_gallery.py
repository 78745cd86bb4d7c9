"""Each figure is a picture and the numbers behind it, and both say what the equations say."""

from __future__ import annotations

import csv
import subprocess
import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest
from matplotlib.image import imread

from eskin.cli import main
from eskin.figures.gallery import FIGURES
from eskin.figures.paper import STATEMENTS
from tests.support.processes import ESKIN

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.figures.figure import Floats


def read(folder: Path, name: str) -> dict[str, Floats]:
    with (folder / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    values = np.array(rows, dtype=np.float64)
    return {column: values[:, k] for k, column in enumerate(header)}


@pytest.mark.parametrize("name", FIGURES)
def test_numbers_are_finite_and_bounds_hold_the_line(folder: Path, name: str) -> None:
    columns = read(folder, name)
    for header, values in columns.items():
        assert np.all(np.isfinite(values))
        if "_lo_" in header and "corrected" not in header:
            nominal = columns[header.replace("_lo_", "_")]
            slack = 1e-12 * np.abs(nominal)
            assert np.all(values <= nominal + slack)
            assert np.all(nominal <= columns[header.replace("_lo_", "_hi_")] + slack)


@pytest.mark.parametrize("name", FIGURES)
def test_picture_shows_what_the_numbers_say(folder: Path, name: str) -> None:
    pixels = imread(folder / f"{name}.png")[..., :3]
    assert pixels.shape[0] > 500
    assert pixels.shape[1] == 1350
    blue = np.array([0x00, 0x72, 0xB2]) / 255
    assert np.count_nonzero(np.all(np.abs(pixels - blue) < 0.02, axis=2)) > 500
    if any("_lo_" in header for header in read(folder, name)):
        shade = 0.25 * blue + 0.75
        assert np.count_nonzero(np.all(np.abs(pixels - shade) < 0.02, axis=2)) > 500


def at(columns: dict[str, Floats], x: str, value: float, y: str) -> float:
    return float(np.interp(value, columns[x], columns[y]))


def test_figures_have_the_papers_values(folder: Path) -> None:
    plate = read(folder, "fig7b")
    for distance, expected in ((3e-3, 0.2951e-12), (4e-3, 0.22135e-12), (5e-3, 0.1771e-12)):
        found = at(plate, "distance_m", distance, "capacitance_F")
        assert found == pytest.approx(expected, rel=2e-4, abs=0.0)
    box = read(folder, "fig4b")
    assert box["capacitance_lo_F"].min() == pytest.approx(0.177e-12, rel=1e-3, abs=0.0)
    assert box["capacitance_hi_F"].max() == pytest.approx(8.854e-12, rel=1e-9, abs=0.0)
    energy = read(folder, "fig4a")
    assert energy["energy_lo_J"][0] == pytest.approx(0.5 * 9e-3 * (0.9 / 6.0) ** 2)
    assert energy["energy_hi_J"][0] == pytest.approx(0.5 * 11e-3 * (1.1 / 4.0) ** 2)
    assert np.all(np.diff(energy["energy_J"]) < 0.0)
    top = energy["energy_hi_J"][0] * np.exp(-2.0 * 4.0 / 11e-3 * energy["time_s"])
    np.testing.assert_allclose(energy["energy_hi_J"], top, rtol=1e-12)
    assert np.all(energy["energy_max_euler_J"][1:] < top[1:])  # why eq. 31 bounds nothing
    assert -1.4 < energy["error_max_percent"][-1] < -1.2
    chain = read(folder, "fig5a")
    assert chain["current_A"].max() == pytest.approx(1e-3)
    assert chain["current_A"].min() == pytest.approx(1e-4)
    assert chain["voltage_V"].max() <= 1.0
    assert chain["frequency_Hz"].max() == pytest.approx(1 / (2 * np.pi * 1e3 * 10e-12))
    dynamic = read(folder, "fig6")
    assert dynamic["capacitance_F"][-1] == pytest.approx(100e-12, rel=1e-6, abs=0.0)
    amplitude = 2 * np.pi * 50 * 5 * dynamic["capacitance_F"]
    assert np.interp(100e-9, amplitude, dynamic["capacitance_F"]) == pytest.approx(
        63.7e-12, rel=1e-3, abs=0.0
    )
    assert np.max(np.abs(dynamic["current_corrected_A"] - dynamic["current_A"])) == pytest.approx(
        5.6e-9, rel=0.02, abs=0.0
    )
    touch = read(folder, "fig8")
    assert np.all(touch["area_noisy_m2"] >= touch["area_lo_m2"])
    assert np.all(touch["area_noisy_m2"] <= touch["area_hi_m2"])
    coil = read(folder, "fig9")
    assert coil["inductance_H"].min() == pytest.approx(10e-3 - 5e-3 * np.exp(-0.1))
    assert coil["distance_m"].max() == pytest.approx(0.03)
    hybrid = read(folder, "fig10a")
    assert hybrid["voltage_V"][0] == 0.0
    assert hybrid["voltage_V"][-1] == pytest.approx(-1.0, rel=1e-3)
    assert np.all(np.diff(hybrid["input_voltage_V"]) > 0.0)
    hybrid = read(folder, "fig10b")
    current = hybrid["current_A"]
    assert at(hybrid, "time_s", 1e-6, "current_A") == pytest.approx(-0.36e-3, rel=0.01)
    assert current[-1] == pytest.approx(-0.235e-3, rel=0.01)


def test_statements_of_the_text_have_a_verdict_that_fits(folder: Path) -> None:
    with (folder / "paper.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(STATEMENTS) >= 20
    for row in rows:
        stated, computed = float(row["stated"]), float(row["computed"])
        if row["verdict"] == "wrong sign":
            assert stated * computed < 0.0
        elif row["verdict"].startswith("factor"):
            factor = float(row["verdict"].split()[1])
            assert max(stated / computed, computed / stated) == pytest.approx(factor, rel=0.05)
        elif row["verdict"] == "slip":
            assert abs(computed / stated - 1.0) > 0.05
        elif row["quantity"] == "current amplitude that is passed":
            assert row["verdict"] == "correct"
            assert computed > stated
        else:
            assert row["verdict"] == "correct"
            assert computed == pytest.approx(stated, rel=0.07, abs=0.0)


@pytest.mark.nightly
def test_command_writes_the_same_bytes_and_says_where(folder: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [ESKIN, "figures", "--out", str(tmp_path / "out")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{2 * len(FIGURES) + 2} files in {tmp_path / 'out'}\n"
    for path in sorted(folder.iterdir()):
        assert path.read_bytes() == (tmp_path / "out" / path.name).read_bytes(), path.name


def test_command_says_what_is_wrong(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = subprocess.run(
        [ESKIN, "figures", "--out", str(tmp_path / "file")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.startswith(f"eskin: --out: {tmp_path / 'file'} cannot be written")


def test_command_without_matplotlib_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delitem(sys.modules, "eskin.figures.plot", raising=False)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    monkeypatch.setattr(sys, "argv", ["eskin", "figures", "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 2
    assert "eskin[figures]" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
