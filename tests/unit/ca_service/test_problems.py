"""Whatever the CA service refuses, it says so as problem details."""

from __future__ import annotations

import asyncio
from datetime import timedelta
from typing import TYPE_CHECKING

import httpx
import pytest
from eskin_ca.app import create_application
from eskin_ca.tokens import Tokens

from eskin.identity import CertificateAuthority

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(
    ("method", "path", "status", "title", "detail"),
    [
        ("GET", "/nothing", 404, "Not Found", "GET of this path is not offered"),
        ("PUT", "/enrol", 405, "Method Not Allowed", "PUT of this path is not offered"),
        ("GET", "/certificates/palm", 404, "Not Found", "no certificate was issued to 'palm' yet"),
        ("GET", "/revoked/unknown", 422, "Unprocessable Content", "kind: 'unknown' is not allowed"),
        ("POST", "/renew", 422, "Unprocessable Content", "request: is missing"),
    ],
)
def test_refusal_is_a_problem_that_says_what_to_do(
    tmp_path: Path, method: str, path: str, status: int, title: str, detail: str
) -> None:
    authority = CertificateAuthority.open(tmp_path)
    day = timedelta(days=1)
    app = create_application(authority, Tokens(tmp_path / "tokens.json"), lifetime=day, grace=day)

    async def ask() -> httpx.Response:
        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url="https://ca") as client:
            return await client.request(method, path)

    answer = asyncio.run(ask())
    assert answer.headers["content-type"] == "application/problem+json"
    said = answer.json()
    assert (answer.status_code, said["status"], said["title"]) == (status, status, title)
    assert said["detail"].startswith(detail)
    assert ("allow" in answer.headers) == (status == 405)
