"""What a client finds about the API: descriptions, examples, the page at ``/docs``, problems."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import jsonschema_rs
import pytest
from eskin_cloud.api.openapi import operations
from eskin_cloud.api.problems import PROBLEMS
from eskin_cloud.app import gateway_application, people_application

from tests.unit.cloud.messages import NODE

if TYPE_CHECKING:
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio


@pytest.fixture
def described(stand: Stand) -> list[dict[str, Any]]:
    """The descriptions of both listeners."""
    return [make(stand.cloud).openapi() for make in (people_application, gateway_application)]


def test_every_operation_has_a_short_summary(described: list[dict[str, Any]]) -> None:
    for description in described:
        for name, operation in operations(description):
            words = operation["summary"].split()
            assert 2 <= len(words) <= 12, name
            assert operation["summary"].endswith("."), name


def test_every_operation_has_an_example_that_fits_its_schema(
    described: list[dict[str, Any]],
) -> None:
    for description in described:
        for name, operation in operations(description):
            bodies = [answer for code, answer in operation["responses"].items() if code[0] == "2"]
            bodies += [operation["requestBody"]] if "requestBody" in operation else []
            contents = [next(iter(body["content"].items())) for body in bodies if "content" in body]
            for media, content in contents:
                assert "example" in content, (name, media)
                if media == "application/json":
                    schema = content["schema"] | {"components": description["components"]}
                    jsonschema_rs.validate(schema, content["example"])
            if not contents:
                assert any("example" in each for each in operation["parameters"]), name


def test_summary_is_not_repeated_in_the_description(described: list[dict[str, Any]]) -> None:
    for description in described:
        for name, operation in operations(description):
            assert operation["summary"] not in operation.get("description", ""), name


async def test_docs_page_and_its_assets_are_served_to_readers_alone(stand: Stand) -> None:
    async with stand.client(token="") as client:
        answer = await client.get("/docs")
        assert (answer.status_code, answer.headers["location"]) == (303, "/login")
    page = await stand.get("/docs")
    assert page.status_code == 200
    assert "text/html" in page.headers["content-type"]
    assets = re.findall(r'(?:src|href)="([^"]+)"', page.text)
    own = [asset for asset in assets if asset.startswith("/docs/")]
    assert len(own) == 3
    assert set(assets) - {*own} == {"/favicon.svg"}, "nothing comes from another server"
    for asset in own:
        assert (await stand.get(asset)).status_code == 200
    assert "<script>" not in page.text
    assert "style=" not in page.text
    policy = page.headers["content-security-policy"]
    assert policy.startswith("default-src 'self';")
    assert "img-src 'self' data:" in policy, "Swagger UI's style sheet holds its icons"
    for other in ("/", *own, "/api/v1/nodes"):
        assert "data:" not in (await stand.get(other)).headers["content-security-policy"]
    assert (await stand.get("/docs/../../api/problems.py")).status_code == 404


async def test_problem_type_resolves_to_a_page(stand: Stand) -> None:
    async with stand.client(token="") as client:
        for answer in (
            await client.get("/api/v1/nodes"),
            await stand.get("/api/v1/nodes/none"),
            await stand.get("/api/v1/nodes/none/of/these"),
            await stand.get("/api/v1/events", limit=0),
            await stand.get("/api/v1/tokens"),
        ):
            page = await client.get(answer.json()["type"])
            assert page.status_code == 200, answer.text
            assert answer.json()["title"] in page.text
        assert (await client.get("/problems/nothing")).status_code == 404


async def test_problem_types_tell_errors_of_one_status_apart(stand: Stand) -> None:
    async with stand.client() as client:
        scope = await client.get("/api/v1/tokens")
        headers = {"Sec-Fetch-Site": "cross-site"}
        site = await client.post(f"/api/v1/nodes/{NODE}/commands", json={}, headers=headers)
    assert scope.json()["type"] == "/problems/missing-scope"
    assert site.json()["type"] == "/problems/cross-site-request"


def test_every_kind_of_refusal_is_explained() -> None:
    kinds = {refusal.kind for refusal in PROBLEMS._refusals.values() if refusal.kind is not None}
    assert kinds <= set(PROBLEMS._remedies)
