"""The packaged hand as a node: a skin of nineteen taxels that live one scenario."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from eskin_sensor_node.node.ground_truth import GroundTruth

from eskin.interval import Verdict
from eskin.wire.messages import Block, Peak, Place, Status, decode_message
from tests.unit.sensor_node.designs import Bench

if TYPE_CHECKING:
    from pathlib import Path


def test_hand_plays_its_scenario_and_every_block_holds_its_truth(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "hand")
    bench.run_to(25.0)
    messages = [decode_message(body) for body in bench.bodies()]
    blocks = [message for message in messages if isinstance(message, Block)]
    truth = GroundTruth.read(bench.settings.truth.path, [block.position for block in blocks])
    assert len(blocks) == 25 * (14 * 5 + 2 * 5 + 1) + 5 * 2
    for block in blocks:
        assert np.all(block.tube.values.contains(truth[block.position].values)), block.channel
    peaks = {message.channel for message in messages if isinstance(message, Peak)}
    assert {"t05.capacitance", "m06.frequency", "b01.bioelectric"} <= peaks
    bench.close()


def test_taxels_of_a_node_share_a_contact(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "hand")
    bench.run_to(6.5)
    presses = [
        message
        for message in map(decode_message, bench.bodies())
        if isinstance(message, Peak)
        and message.channel == "t10.capacitance"
        and message.verdict is Verdict.CERTAIN
    ]
    truth = GroundTruth.read(
        bench.settings.truth.path, GroundTruth.positions(bench.settings.truth.path)
    )
    tops = {}
    for name in ("t10", "t06", "t09"):
        series = [block for block in truth.values() if block.channel == f"{name}.capacitance"]
        values = np.concatenate([block.values for block in series])
        tops[name] = int(values[1000:1500].argmax()) + 1000
    assert presses
    assert max(tops.values()) - min(tops.values()) <= 10, tops
    bench.close()


@pytest.mark.parametrize(
    ("profile", "place", "number"),
    [("hand", Place("t01", 0.03, 0.01), 16), ("fingertip", Place("t03", 0.004, 0.007), 3)],
)
def test_status_has_the_places_of_taxels(
    tmp_path: Path, profile: str, place: Place, number: int
) -> None:
    bench = Bench(tmp_path, profile)
    bench.node.record_status()
    (status,) = [m for m in map(decode_message, bench.bodies()) if isinstance(m, Status)]
    assert place in status.places
    assert len(status.places) == number
    bench.close()
