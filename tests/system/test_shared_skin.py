"""A skin that four nodes share, through the real stack: a press on a seam is one contact."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

from eskin.wire.timestamp import SECOND, parse_timestamp
from tests.support.demos import RunningDemo
from tests.support.processes import wait_until

if TYPE_CHECKING:
    from pathlib import Path

NODES = ["small-hand", "small-hand-2", "small-hand-3", "small-hand-4"]


def owners(layout: dict[str, Any]) -> dict[str, str]:
    """Which node samples each taxel."""
    return {taxel: each["node"] for each in layout["patches"] for taxel in each["taxels"]}


def contacts(demo: RunningDemo, node: str) -> list[dict[str, Any]]:
    items: list[dict[str, Any]] = demo.get("/contacts", node=node, points=40)["items"]
    return items


@pytest.mark.nightly
@pytest.mark.timeout(600)
def test_contact_over_a_seam_is_one_contact(tmp_path: Path) -> None:
    env = {"ESKIN_SKIN_CONTROLLERS": json.dumps(NODES), "ESKIN_NODE_SEED": "7"}
    options = "--skin", "small-hand", "--nodes", str(len(NODES))
    with RunningDemo(tmp_path / "data", *options, env=env) as demo:
        wait_until(
            lambda: (
                {each["id"] for each in demo.get("/nodes")["items"] if each["layout"]} == set(NODES)
            ),
            "all nodes state a layout",
        )
        layouts = [demo.get(f"/nodes/{node}/layout") for node in NODES]
        assert all(each == layouts[0] for each in layouts)
        assert [each["node"] for each in layouts[0]["controllers"]] == NODES
        node_of = owners(layouts[0])
        assert set(node_of.values()) == set(NODES)

        def shared() -> list[dict[str, Any]]:
            return [
                core
                for each in contacts(demo, NODES[2])
                for core in each["cores"]
                if len({node_of[taxel] for taxel in core["taxels"]}) > 1
            ]

        wait_until(lambda: bool(shared()), "a core lies over a seam", seconds=200)
        at = contacts(demo, NODES[0])[-1]
        assert at["nodes"] == NODES
        assert at["time_error"] == 0
        end = parse_timestamp(at["t"])
        asked = {"start": end - SECOND, "end": end + 1, "points": 10}
        whole = demo.get(f"/nodes/{NODES[1]}/frames", **asked)
        assert whole["taxels"] == list(node_of)
        assert all(None not in row for row in whole["hi"][1:-1]), "each node has samples"
        own = demo.get(f"/nodes/{NODES[1]}/frames", **asked, own=True)
        assert own["taxels"] == [taxel for taxel, node in node_of.items() if node == NODES[1]]
        assert demo.stop() == 0
