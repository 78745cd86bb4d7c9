"""The recorded answers that most tests of the dashboard run against."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import jsonschema_rs
import pytest

from docs.tools.openapi import describe
from tests.unit.dashboard.record import LENGTH_NS

if TYPE_CHECKING:
    from tests.unit.dashboard.replay import Replay

CHANNEL = "palm/t01.energy"
SECOND = 1_000_000_000
PLACES = {
    "/nodes": "/nodes",
    "/gateways": "/gateways",
    "/storage": "/storage",
    "/models": "/models",
    "/events": "/events",
    "/nodes/palm/channels": "/nodes/{node}/channels",
    "/nodes/palm/state": "/nodes/{node}/state",
    f"/series/{CHANNEL}": "/series/{node}/{channel}",
    f"/series/{CHANNEL}/threshold": "/series/{node}/{channel}/threshold",
    f"/series/{CHANNEL}/time": "/series/{node}/{channel}/time",
    f"/series/{CHANNEL}/prediction": "/series/{node}/{channel}/prediction",
    f"/series/{CHANNEL}/anomalies": "/series/{node}/{channel}/anomalies",
    f"/series/{CHANNEL}/anomalies/time": "/series/{node}/{channel}/anomalies/time",
}


@pytest.fixture(scope="module")
def description() -> dict[str, Any]:
    return describe()


@pytest.mark.parametrize("path", PLACES)
def test_recorded_answers_fit_the_description_of_the_api(
    replay: Replay, description: dict[str, Any], path: str
) -> None:
    end = replay.start + 2 * LENGTH_NS
    window = {"start": end - SECOND, "end": end, "points": 100, "parameter": "value:0:1"}
    answer = replay.get(path, **(window if path.startswith("/series") else {}))
    operation = description["paths"][f"/api/v1{PLACES[path]}"]["get"]
    schema = operation["responses"]["200"]["content"]["application/json"]["schema"]
    described = {**schema, "components": description["components"]}
    jsonschema_rs.validate(described, answer)
