"""A fleet as a process: over a real broker into a real cloud, each message once, all audited."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_sensor_node.fleet.service import require_files
from eskin_sensor_node.fleet.service import run as run_fleet
from eskin_sensor_node.node.ground_truth import GroundTruth
from eskin_sensor_node.settings import FleetSection

from eskin.demo.audit import audit
from eskin.demo.layout import DemoFolder
from eskin.errors import SettingsError
from eskin.identity import numbered
from eskin.wire.messages import Position
from tests.support.fleets import RunningFleet, enrol
from tests.support.identities import Identities
from tests.support.processes import wait_until
from tests.support.stacks import RealStack
from tests.unit.sensor_node.designs import settings

if TYPE_CHECKING:
    from pathlib import Path

    import httpx

COUNT = 20
PATIENCE = 120.0


def as_demo(stack: RealStack, fleet: RunningFleet) -> DemoFolder:
    """What the audit looks at: a folder for the fleet, beside store and spool."""
    layout = DemoFolder(stack.folder / "audited")
    for path, target in (
        (layout.store, stack.store),
        (layout.spool, stack.folder / "spool.sqlite"),
        (layout.truth("skin"), fleet.truth),
        (layout.flash("skin"), fleet.flash),
    ):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.symlink_to(target)
    return layout


def order(client: httpx.Client, node: str, **arguments: Any) -> int:
    """Set a member."""
    body = {"name": "set", "arguments": arguments, "expires_s": 600}
    answer = client.post(f"/nodes/{node}/commands", json=body)
    assert answer.status_code == 202, answer.text
    return int(answer.json()["id"])


def is_settled(client: httpx.Client, node: str, number: int) -> bool:
    """Whether a member reports to be set as it was stated, in answer to that command."""
    state = client.get(f"/nodes/{node}/state").json()
    return state.get("reported_by") == number and bool(state["settled"])


def reported_by(client: httpx.Client, node: str) -> Any:
    """How a member says that it is set."""
    return client.get(f"/nodes/{node}/state").json()["reported"]


def shift(stack: RealStack, fleet: RunningFleet, node: str) -> None:
    """Move one true value of a node out of its stored interval."""
    with closing(sqlite3.connect(f"file:{stack.store}?mode=ro", uri=True)) as db:
        query = "SELECT boot, sequence FROM frames WHERE node = ? ORDER BY boot, sequence LIMIT 1"
        place = Position(*db.execute(query, (node,)).fetchone())
    true = GroundTruth.read_frames(fleet.truth, [place], node=node)[place]
    values = true.values.copy()
    values[np.flatnonzero(np.isfinite(values))[0]] = 1e9
    truth = GroundTruth(fleet.truth, limit=2**40)
    truth.store({node: [replace(true, values=values)]})
    truth.close()


def frames_of(stack: RealStack) -> dict[str, int]:
    with closing(sqlite3.connect(f"file:{stack.store}?mode=ro", uri=True)) as db:
        return dict(db.execute("SELECT node, count(*) FROM frames GROUP BY node").fetchall())


def boots_stored(stack: RealStack) -> int:
    with closing(sqlite3.connect(f"file:{stack.store}?mode=ro", uri=True)) as db:
        boots = "SELECT count(*) FROM (SELECT DISTINCT node, boot FROM frames)"
        return int(db.execute(boots).fetchone()[0])


def spooled(stack: RealStack) -> int:
    with closing(sqlite3.connect(f"file:{stack.spool}?mode=ro", uri=True)) as db:
        return int(db.execute("SELECT count(*) FROM messages").fetchone()[0])


@pytest.mark.nightly
def test_everything_is_stored_once_and_encloses_the_truth(tmp_path: Path) -> None:
    names = numbered("skin", COUNT)
    outsider, others = names[3], [*names[:3], *names[4:]]
    with RealStack(tmp_path) as stack:
        enrol(stack.identities, others)
        foreign = Identities(tmp_path / "foreign")
        enrol(foreign, [outsider])
        (tmp_path / "foreign" / outsider).rename(stack.pki / outsider)
        port = stack.broker.node_port
        fleet = RunningFleet(tmp_path / "fleet", stack.pki, port=port, count=COUNT)
        with fleet, stack.operator() as client:
            live_through_troubles(stack, fleet, client, others)
            assert fleet.stop(seconds=PATIENCE) == 0
        with closing(sqlite3.connect(fleet.flash)) as db:
            kept = "SELECT count(*) FROM message JOIN member ON id = member WHERE name <> ?"
            assert db.execute(kept, (outsider,)).fetchone() == (0,)
        wait_until(lambda: spooled(stack) == 0, "the gateway has handed over all")
        layout = as_demo(stack, fleet)
        found = audit(layout)
        assert found.passes
        known = {each.node: each for each in found.deliveries}
        # What a kill leaves between truth and flash was never said.
        assert all(known[name].made == known[name].stored + known[name].unborn for name in others)
        assert len(found.channels) == 2 * len(others)
        assert sum(channel.samples for channel in found.channels) > 250 * 8 * len(found.channels)
        assert {each.node for each in found.deliveries if each.stored} == set(others)
        assert not found.letters
        shift(stack, fleet, others[5])
        broken = audit(layout)
        assert {e.node: e.violations for e in broken.channels if not e.passes} == {others[5]: 1}


def live_through_troubles(
    stack: RealStack, fleet: RunningFleet, client: httpx.Client, names: list[str]
) -> None:
    """The broker goes and comes, the fleet is killed; one member is set before, one meanwhile."""
    fleet.wait_for(
        lambda: set(frames_of(stack)) == set(names), "frames of all nodes", seconds=PATIENCE
    )
    number = order(client, names[0], rate=500.0)
    fleet.wait_for(lambda: is_settled(client, names[0], number), "a member obeys", seconds=PATIENCE)
    stack.broker.stop()
    stack.broker.begin()
    before = frames_of(stack)
    fleet.wait_for(
        lambda: all(frames_of(stack)[name] > before[name] + 8 for name in names),
        "more of all nodes after the broker came back",
        seconds=PATIENCE,
    )
    fleet.kill()
    late = order(client, names[1], threshold=50e-12, channel="t01.capacitance")
    fleet.start()
    fleet.wait_for(
        lambda: boots_stored(stack) == 2 * len(names), "frames of a second boot", seconds=PATIENCE
    )
    fleet.wait_for(
        lambda: is_settled(client, names[1], late), "who was away obeys", seconds=PATIENCE
    )
    reported = [reported_by(client, name) for name in names[:3]]
    assert [each["t01"]["rate"] for each in reported] == [500.0, 1000.0, 1000.0]
    assert reported[1]["t01.capacitance"] == {"threshold": 50e-12}


def test_too_many_nodes_for_the_system_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("resource.getrlimit", lambda _: (100, 500))
    with pytest.raises(SettingsError, match=r"fleet\.count.*1000 nodes need 1064 open files"):
        require_files(1000)


def test_skin_is_no_design_of_a_fleet(tmp_path: Path) -> None:
    # As `eskin node --count` sets it.
    alone = settings(tmp_path, "paper-hand")
    skins = alone.model_copy(update={"fleet": FleetSection(count=3)})
    with pytest.raises(SettingsError, match=r"fleet\.count.*skin runs alone"):
        run_fleet(skins)
