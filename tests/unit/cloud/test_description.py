"""The OpenAPI description holds: no fault, no undocumented answer, and what fits it is accepted."""

from __future__ import annotations

from datetime import timedelta
from typing import TYPE_CHECKING, Any

import pytest
import schemathesis
from eskin_cloud.access import Scope, create_token
from eskin_cloud.app import gateway_application, people_application
from hypothesis import HealthCheck, Phase, given, settings

from tests.support.examples import examples
from tests.unit.cloud.clouds import put
from tests.unit.cloud.described import check_answer
from tests.unit.cloud.messages import CHANNEL, NODE, gap, peak, status, stretch

if TYPE_CHECKING:
    from tests.unit.cloud.clouds import Stand


def operator(stand: Stand) -> dict[str, str]:
    """Headers of a caller who may do everything."""
    scopes = list(Scope)
    lifetime = timedelta(hours=1)
    token = create_token(stand.cloud.store, scopes=scopes, name="operator", lifetime=lifetime)
    return {"Authorization": f"Bearer {token}"}


def validate(schema: Any, headers: dict[str, str]) -> int:
    """Ask each operation with drawn cases that fit; gives how many operations there are."""
    count = 0
    for result in schema.get_all_operations():
        operation = result.ok()
        count += 1

        @settings(
            max_examples=examples(15),
            deadline=None,
            database=None,
            phases=(Phase.explicit, Phase.generate),
            suppress_health_check=list(HealthCheck),
        )
        @given(case=operation.as_strategy())
        def ask(case: Any) -> None:
            check_answer(case, headers)

        ask()
    return count


@pytest.mark.nightly
def test_people_are_answered_as_described(stand: Stand) -> None:
    put(stand.cloud.store, status(0), stretch(1), peak(2), gap(3))
    headers = operator(stand)
    app = people_application(stand.cloud)
    schema = schemathesis.openapi.from_asgi("/openapi.json", app, headers=headers)
    # The live stream never ends; its refusals and its events have tests of their own.
    assert validate(schema.exclude(path="/api/v1/live"), headers) == 47


def test_known_places_are_answered_as_described(stand: Stand) -> None:
    put(stand.cloud.store, status(0), stretch(1, [1.0] * 50, [2.0] * 50), peak(2), gap(3))
    headers = operator(stand)
    app = people_application(stand.cloud)
    raw = app.openapi()
    for path in list(raw["paths"]):
        item = raw["paths"].pop(path)
        known = path.replace("{node}", NODE).replace("{channel}", CHANNEL).replace("{id}", "1")
        for operation in item.values():
            listed = operation.get("parameters", [])
            operation["parameters"] = [p for p in listed if p["in"] != "path"]
        if path.startswith(("/api/v1/series", "/api/v1/nodes/")):
            raw["paths"][known] = item
    schema = schemathesis.openapi.from_dict(raw)
    schema.app = app
    assert validate(schema, headers) == 18


def test_gateways_listener_describes_what_gateways_post_and_nothing_else(stand: Stand) -> None:
    described = gateway_application(stand.cloud).openapi()["paths"]
    # What they hold is drawn in the tests of refusals: no schema says what CBOR holds.
    assert all(set(methods) == {"post"} for methods in described.values())
    posted = {"/api/v1/ingest", "/api/v1/deliveries", "/api/v1/subjects"}
    assert posted <= set(described)


def test_description_is_of_version_3_1(stand: Stand) -> None:
    raw = people_application(stand.cloud).openapi()
    assert raw["openapi"].startswith("3.1")
    schemes = raw["components"]["securitySchemes"]
    (bearer,) = (said for said in schemes.values() if said.get("scheme") == "bearer")
    assert "docs/rest.md" in bearer["description"], "no scope is right for all routes"
    assert raw["paths"]["/api/v1/series/{node}/{channel}"]["get"]["security"]
    live = raw["paths"]["/api/v1/live"]["get"]["responses"]["200"]["content"]
    assert list(live) == ["text/event-stream"]
