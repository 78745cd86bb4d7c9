"""The packaged hand as a node: a skin of nineteen taxels that live one scenario."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
import pytest

from eskin.interval import Verdict
from tests.unit.sensor_node.designs import Bench
from tests.unit.sensor_node.messages import assert_truth_is_inside, peaks_of, samples_of

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.nightly
def test_hand_plays_its_scenario_and_every_frame_holds_its_truth(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "hand")
    bench.run_to(25.0)
    found = samples_of(bench)
    counts = Counter(each.channel for each in found for _ in each.tube.values.inf)
    rates = [25 * round(taxel.sampling) for taxel in bench.settings.taxel for _ in taxel.units]
    assert sorted(counts.values()) == sorted(rates)
    assert_truth_is_inside(found)
    peaks = {peak.channel for peak in peaks_of(bench)}
    assert {"t05.capacitance", "m06.frequency", "b01.bioelectric"} <= peaks
    bench.close()


def test_taxels_of_a_node_share_a_contact(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "hand")
    bench.run_to(6.5)
    presses = [
        peak for peak in peaks_of(bench, "t10.capacitance") if peak.verdict is Verdict.CERTAIN
    ]
    tops = {}
    for name in ("t10", "t06", "t09"):
        values = np.concatenate([each.truth for each in samples_of(bench, f"{name}.capacitance")])
        tops[name] = int(values[1000:1500].argmax()) + 1000
    assert presses
    assert max(tops.values()) - min(tops.values()) <= 10, tops
    bench.close()


@pytest.mark.parametrize(
    ("profile", "taxel", "place", "number"),
    [("hand", "t01", (30_000, 10_000), 16), ("fingertip", "t03", (4_000, 7_000), 3)],
)
def test_layout_has_the_positions_of_taxels(
    tmp_path: Path, profile: str, taxel: str, place: tuple[int, int], number: int
) -> None:
    bench = Bench(tmp_path, profile)
    found: dict[str, tuple[int, ...]] = {}
    for patch in bench.node.layout.patches:
        if patch.positions:
            found |= dict(zip(patch.taxels, zip(*patch.positions, strict=True), strict=True))
    assert found[taxel] == place  # µm
    assert len(found) == number
    bench.close()


def test_hand_states_what_its_contacts_are(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "hand")
    patches = {patch.quantity: patch for patch in bench.node.layout.patches}
    bench.close()
    pads = patches.pop("pressure")
    assert pads.threshold == 3e3
    assert pads.cell_area == pytest.approx(20e-3**2)
    assert all(patch.threshold is None for patch in patches.values())
    at = np.transpose(pads.positions)
    touching = {
        (i, j)
        for i in range(len(at))
        for j in range(i + 1, len(at))
        if np.abs(at[i] - at[j]).sum() == 20_000  # µm: side by side
    }
    assert {pair for pair in pads.neighbours if max(pair) < 12} == {
        pair for pair in touching if max(pair) < 12
    }, "of the palm, which is a grid"
