"""How much of the dashboard a browser has to load."""

from __future__ import annotations

from benchmarks.dashboard import measure_script


def test_javascript_stays_below_150_kilobytes_gzipped() -> None:
    script = measure_script()
    assert script.unit == "kB"
    assert 1 < script.value < 150
    assert script.met
