"""A cohort says byte for byte what its members would say alone, and knows the same truth."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import pytest
from eskin_sensor_node.firmware.message_writer import FRAME, STATEMENTS
from eskin_sensor_node.fleet.cohort import Cohort
from eskin_sensor_node.fleet.roster import Roster, RosterEntry
from eskin_sensor_node.machine.node_layout import plan_layout
from eskin_sensor_node.node.factory import build_node, build_outbox
from eskin_sensor_node.node.ground_truth import GroundTruth
from hypothesis import given
from hypothesis import settings as effort
from hypothesis import strategies as st

from eskin.wire.messages import Position
from tests.unit.sensor_node.designs import KINDS, SECOND, START, settings, table, waiting
from tests.unit.sensor_node.flashes import open_flash


def companions_of(kind: str) -> list[dict[str, Any]]:
    """What a packaged taxel of the kind reads along."""
    return [table(name) for name in ("thermometer", "hygrometer") if name in table(kind)]


def seldom(kind: str) -> dict[str, Any]:
    """The packaged taxel with fewer samples: single nodes calculate in Python."""
    if kind == "hybrid":
        return table(kind, burst_s=0.004, burst_period_s=0.3)
    return table(kind, sampling_Hz=100.0)


def alone(given: Any, folder: Path, member: RosterEntry, instants: list[int]) -> tuple[Any, Any]:
    """Messages and truth of one node that runs by itself."""
    flash = open_flash(folder / "flash.sqlite", epoch=member.boot)
    outbox = build_outbox(
        flash, capacity=2**30, broker=given.broker, described=plan_layout(given).described
    )
    truth = GroundTruth(folder / "truth.sqlite", limit=2**30)
    design = given.model_copy(update={"node": given.node.model_copy(update={"seed": member.seed})})
    node, _ = build_node(design, outbox=outbox, truth=truth, start=member.start)
    for ticks in instants:
        node.advance(ticks)
    node.finish()
    said = [(each.position[1], each.kind, each.body) for each in waiting(flash)]
    positions = [Position(member.boot, sequence) for sequence, kind, _ in said if kind == FRAME]
    known = GroundTruth.read_frames(folder / "truth.sqlite", positions, node="n")
    flash.close()
    truth.close()
    return said, {p.sequence: (t.time, t.end, t.values.tobytes()) for p, t in known.items()}


def together(design: Any, members: list[RosterEntry], instants: list[int]) -> tuple[Any, Any]:
    cohort = Cohort(Roster(design, members))
    said: list[Any] = [[] for _ in members]
    known: list[Any] = [{} for _ in members]

    def write() -> None:
        for each in cohort.flush():
            said[each.row].append((each.sequence, each.kind, each.body))
            if each.kind == FRAME:
                begin, end = (cohort.true_times(t)[each.row] for t in (each.begin, each.end))
                known[each.row][each.sequence] = begin, end, each.values.tobytes()

    for ticks in instants:
        while cohort.next_due <= ticks:
            for _ in cohort.advance(cohort.next_due):
                pass
            write()
    cohort.finish()
    write()
    return said, known


@pytest.mark.parametrize("kind", KINDS)
@effort(max_examples=3, deadline=None)
@given(
    st.lists(st.integers(0, 2**63 - 1), min_size=1, max_size=2),
    st.sampled_from([50.0, 130.0, 700.0]),
)
def test_same_bytes_and_truth_as_alone(kind: str, seeds: list[int], stretch: float) -> None:
    with tempfile.TemporaryDirectory() as folder:
        design = settings(
            Path(folder),
            node={"name": "n", "profile": "custom"},
            taxel=[seldom(kind), *companions_of(kind)],
            sampling={"stretch_ms": stretch},
        )
        members = [RosterEntry(s, 1 + k, START + k) for k, s in enumerate(seeds)]
        instants = [k * max(SECOND, round(2e6 * stretch)) // 4 for k in range(1, 5)]
        said, known = together(design, members, instants)
        kinds = {each for _, each, _ in said[0]}
        assert kinds >= ({FRAME, STATEMENTS} if kind == "capacitive" else {FRAME})
        for row, member in enumerate(members):
            home = Path(folder) / str(row)
            home.mkdir()
            assert (said[row], known[row]) == alone(design, home, member, instants)


@effort(max_examples=2, deadline=None)
@given(st.lists(st.integers(0, 2**63 - 1), min_size=1, max_size=2), st.sampled_from([40.0, 1000.0]))
def test_skin_takes_the_same_crosstalk_back_as_alone(seeds: list[int], stretch: float) -> None:
    pads = [
        table("pad", id=place, place=place, sampling_Hz=50.0) for place in ("t10", "t06", "t09")
    ]
    slow = table("pad", id="t11", place="t11", sampling_Hz=25.0)
    with tempfile.TemporaryDirectory() as folder:
        design = settings(
            Path(folder),
            node={"name": "n", "profile": "custom"},
            taxel=[pads[0], *companions_of("pad"), table("bioelectric"), slow, *pads[1:]],
            sampling={"stretch_ms": stretch},
        )
        members = [RosterEntry(s, 1 + k, START + k) for k, s in enumerate(seeds)]
        instants = [k * SECOND for k in range(1, 7)]
        said, known = together(design, members, instants)
        for row, member in enumerate(members):
            home = Path(folder) / str(row)
            home.mkdir()
            assert (said[row], known[row]) == alone(design, home, member, instants)


@given(seed=st.integers(0, 2**63 - 1), ticks=st.integers(-(10**14), 10**14))
@effort(max_examples=30, deadline=None)
def test_instant_is_enclosed_also_before_the_cohort_s_start(seed: int, ticks: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        design = settings(Path(folder), clock={"drift_ppm": 100.0})
        roster = Roster(design, [RosterEntry(seed, 1, START)])
    earliest, latest = roster.enclosure(0, ticks)
    assert earliest <= roster.clocks.beside([0]).true_times(ticks)[0] <= latest
