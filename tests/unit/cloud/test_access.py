"""Who is let in: no one without a token, a code or a session."""

from __future__ import annotations

from contextlib import AsyncExitStack
from datetime import timedelta
from typing import TYPE_CHECKING

import httpx
import pytest
from eskin_cloud.access import (
    Scope,
    create_login_code,
    create_token,
    digest,
    revoke_token,
    token_id,
)
from eskin_cloud.api.dependencies import Unproven, cookie_name
from eskin_cloud.settings import PeopleSection
from eskin_cloud.store import Store
from eskin_cloud.store.schema.tables import login_codes, sessions, tokens
from sqlalchemy import select

from eskin.identity import IdentityKind
from tests.unit.cloud.clouds import problem, put, standing
from tests.unit.cloud.messages import stretch

if TYPE_CHECKING:
    from pathlib import Path

    from tests.support.identities import Identities
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio

GUARDED = (
    "/api/v1/nodes",
    "/api/v1/nodes/x",
    "/api/v1/nodes/x/channels",
    "/api/v1/series/x/y",
    "/api/v1/series/x/y/threshold?above=1",
    "/api/v1/events",
    "/api/v1/live",
    "/api/v1/nothing",
    "/openapi.json",
)


@pytest.mark.parametrize("path", GUARDED)
async def test_caller_without_a_token_is_refused(stand: Stand, path: str) -> None:
    for token in ("", "eskin_wrong", "x" * 5000):
        async with stand.client(token=token) as client:
            answer = await client.get(path)
        reason = Unproven.UNKNOWN if token else Unproven.MISSING
        assert problem(answer, 401).startswith(reason)
        assert answer.headers["www-authenticate"] == "Bearer"


@pytest.mark.parametrize("path", GUARDED)
async def test_token_without_the_scope_is_refused(stand: Stand, path: str) -> None:
    token = create_token(
        stand.cloud.store, scopes=[Scope.OPERATE], name="x", lifetime=timedelta(hours=1)
    )
    async with stand.client(token=token) as client:
        assert "read" in problem(await client.get(path), 403)


async def test_token_expires_and_is_revoked(stand: Stand) -> None:
    store = stand.cloud.store
    short = create_token(store, scopes=[Scope.READ], name="a", lifetime=timedelta(minutes=1))
    lasting = create_token(store, scopes=[Scope.READ], name="b", lifetime=None)

    async def status(token: str) -> int:
        async with stand.client(token=token) as client:
            return (await client.get("/api/v1/nodes")).status_code

    assert (await status(short), await status(lasting)) == (200, 200)
    stand.clock.turn(60)
    assert (await status(short), await status(lasting)) == (401, 200)
    assert revoke_token(store, token_id(digest(lasting)))
    assert not revoke_token(store, token_id(digest(lasting)))
    assert await status(lasting) == 401


async def test_secrets_are_kept_as_hashes_only(stand: Stand) -> None:
    store = stand.cloud.store
    code = create_login_code(store, lifetime=timedelta(minutes=1))
    async with stand.client(token="") as client:
        await client.post("/login", data={"token": stand.token})
        session = client.cookies[cookie_name(stand.cloud)]
        with store.read() as connection:
            kept = [
                str(row)
                for table in (tokens, login_codes, sessions)
                for row in connection.execute(select(table))
            ]
    assert len(kept) == 3
    for secret in (stand.token, code, session):
        assert all(secret not in row for row in kept)


async def test_code_made_by_another_process_signs_in_once(stand: Stand) -> None:
    with Store(stand.cloud.store.location, clock=stand.clock) as elsewhere:
        code = create_login_code(elsewhere, lifetime=timedelta(minutes=1))
    async with stand.client(token="") as client:
        answer = await client.get("/login", params={"code": code})
        assert (answer.status_code, answer.headers["location"]) == (303, "/")
        cookie = answer.headers["set-cookie"]
        assert "HttpOnly" in cookie
        assert "SameSite=strict" in cookie
        assert "Secure" not in cookie
        assert (await client.get("/api/v1/nodes")).status_code == 200
    async with stand.client(token="") as client:
        answer = await client.get("/login", params={"code": code})
        assert answer.status_code == 401
        assert "used already" in answer.text
        assert "set-cookie" not in answer.headers


async def test_code_expires(stand: Stand) -> None:
    code = create_login_code(stand.cloud.store, lifetime=timedelta(minutes=1))
    stand.clock.turn(60)
    async with stand.client(token="") as client:
        assert (await client.get("/login", params={"code": code})).status_code == 401


async def test_token_form_signs_in_and_out(stand: Stand) -> None:
    async with stand.client(token="") as client:
        assert (await client.post("/login", data={"token": "wrong"})).status_code == 401
        assert (await client.post("/login", json={})).status_code == 415
        answer = await client.post("/login", data={"token": f" {stand.token} "})
        assert answer.status_code == 303
        assert (await client.get("/api/v1/nodes")).status_code == 200
        session = client.cookies[cookie_name(stand.cloud)]
        answer = await client.post("/logout")
        assert (answer.status_code, answer.headers["location"]) == (303, "/login")
        client.cookies.set(cookie_name(stand.cloud), session)
        assert (await client.get("/api/v1/nodes")).status_code == 401


async def test_session_ends_with_its_time_and_with_its_token(stand: Stand) -> None:
    for end in (
        lambda: revoke_token(stand.cloud.store, token_id(digest(stand.token))),
        lambda: stand.clock.turn(1),
    ):
        token = create_token(stand.cloud.store, scopes=[Scope.READ], name="x", lifetime=None)
        async with stand.client(token="") as client:
            await client.post("/login", data={"token": token})
            assert (await client.get("/api/v1/nodes")).status_code == 200
            end()
            assert (await client.get("/api/v1/nodes")).status_code == 200
            revoke_token(stand.cloud.store, token_id(digest(token)))
            assert (await client.get("/api/v1/nodes")).status_code == 401
    code = create_login_code(stand.cloud.store, lifetime=timedelta(minutes=1))
    async with stand.client(token="") as client:
        await client.get("/login", params={"code": code})
        stand.clock.turn(12 * 3600 - 1)
        assert (await client.get("/api/v1/nodes")).status_code == 200
        stand.clock.turn(1)
        assert (await client.get("/api/v1/nodes")).status_code == 401


async def test_form_of_another_site_is_refused(stand: Stand) -> None:
    async with stand.client(token="") as client:
        for path in ("/login", "/logout"):
            answer = await client.post(
                path, data={"token": stand.token}, headers={"Sec-Fetch-Site": "cross-site"}
            )
            problem(answer, 403)


async def test_huge_form_is_refused(stand: Stand) -> None:
    async with stand.client(token="") as client:
        problem(await client.post("/login", data={"token": "x" * 5000}), 413)


async def test_login_page_needs_nothing_and_escapes(stand: Stand) -> None:
    async with stand.client(token="") as client:
        page = await client.get("/login")
        style = await client.get("/login.css")
    assert page.status_code == style.status_code == 200
    assert "prefers-color-scheme: dark" in style.text
    assert "<style" not in page.text
    assert "<script" not in page.text


async def test_every_answer_carries_protecting_headers(stand: Stand) -> None:
    async with stand.client(token="") as client:
        for path in ("/", "/login", "/api/v1/nodes", "/healthz", "/nothing"):
            headers = (await client.get(path)).headers
            assert "default-src 'self'" in headers["content-security-policy"]
            assert "unsafe" not in headers["content-security-policy"]
            assert headers["x-content-type-options"] == "nosniff"
            assert headers["referrer-policy"] == "no-referrer"
            assert headers["cache-control"] == "no-store"
            assert "strict-transport-security" not in headers


async def test_clouds_on_one_host_leave_each_other_s_sessions_alone(
    tmp_path: Path, identities: Identities
) -> None:
    async with AsyncExitStack() as stack:
        clouds = [
            stack.enter_context(
                standing(tmp_path / str(port), identities, people=PeopleSection(port=port))
            )
            for port in (8080, 8090)
        ]
        jar = httpx.Cookies()  # by host, whatever the port, as a browser has them
        for each in clouds:
            async with each.client(token="") as browser:
                browser.cookies = jar
                await browser.post("/login", data={"token": each.token})
                jar = browser.cookies
        for each in clouds:
            async with each.client(token="") as browser:
                browser.cookies = jar
                assert (await browser.get("/api/v1/nodes")).status_code == 200


async def test_cookie_is_secure_over_https(tmp_path: Path, identities: Identities) -> None:
    own = identities.make(IdentityKind.SERVER, "server.people").directory
    people = PeopleSection(host="0.0.0.0", identity=own)  # noqa: S104 - that is the point
    with standing(tmp_path, identities, people=people) as stand:
        async with stand.client(token="") as client:
            answer = await client.post("/login", data={"token": stand.token})
    cookie = answer.headers["set-cookie"]
    assert cookie.startswith("__Host-")
    assert "Secure" in cookie
    assert "Path=/" in cookie
    assert "Domain" not in cookie
    assert answer.headers["strict-transport-security"]


async def test_dashboard_is_for_those_who_signed_in(stand: Stand) -> None:
    folder = stand.cloud.dashboard
    async with stand.client(token="") as client:
        answer = await client.get("/")
        assert (answer.status_code, answer.headers["location"]) == (303, "/login")
        await client.post("/login", data={"token": stand.token})
        answer = await client.get("/")
        assert answer.status_code == 503
        assert "not built" in answer.text
        (folder / "assets").mkdir(parents=True)
        (folder / "index.html").write_text("<p>dashboard</p>")
        (folder / "assets" / "a.js").write_text("1")
        (folder.parent / "secret.txt").write_text("secret")
        answer = await client.get("/")
        assert answer.text == "<p>dashboard</p>"
        assert answer.headers["cache-control"] == "no-cache"
        answer = await client.get("/assets/a.js")
        assert "immutable" in answer.headers["cache-control"]
        for path in ("/../secret.txt", "/..%2fsecret.txt", "/assets", "/%00", "/nothing.js"):
            problem(await client.get(path), 404)


async def test_figures_are_served_on_loopback_only(stand: Stand) -> None:
    put(stand.cloud.store, stretch(0))
    for host, status in (
        ("127.0.0.1", 200),
        ("::1", 200),
        ("10.0.0.5", 403),
        ("::ffff:10.0.0.5", 403),
    ):
        async with stand.client(token="", client=(host, 5)) as client:
            answer = await client.get("/metrics")
        assert answer.status_code == status
    async with stand.client(token="", client=("::ffff:127.0.0.1", 5)) as client:
        text = (await client.get("/metrics")).text
    assert "eskin_cloud_commits" in text
    assert 'eskin_cloud_requests_total{method="GET",status="403"} 2.0' in text
