"""The audit log is complete, and changes are detected."""

from __future__ import annotations

import sqlite3
from datetime import timedelta
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any

import pytest
from eskin_cloud.access import (
    Scope,
    create_login_code,
    create_token,
    digest,
    revoke_token,
    token_id,
)
from eskin_cloud.store import Store
from eskin_cloud.store.write.audit_log import (
    Action,
    AuditEntry,
    check_audit_entries,
    read_audit_entries,
    record,
)
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy.exc import SQLAlchemyError

from tests.unit.cloud.clouds import problem, put
from tests.unit.cloud.messages import NODE, START, status

if TYPE_CHECKING:
    from sqlalchemy import Connection

    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio


def admin_token(stand: Stand) -> str:
    lifetime = timedelta(days=1)
    return create_token(stand.cloud.store, scopes=list(Scope), name="boss", lifetime=lifetime)


def audit_entries(stand: Stand) -> list[tuple[str, str, str]]:
    with stand.cloud.store.read() as connection:
        assert check_audit_entries(connection) is None
        return [
            (row["actor"], row["action"], row["target"]) for row in read_audit_entries(connection)
        ]


def record_many(connection: Connection, count: int) -> None:
    for number in range(count):
        record(connection, AuditEntry("a", "b", Action.COMMAND, "node", str(number)), now=START)


async def test_actions_are_logged(stand: Stand) -> None:
    store, token = stand.cloud.store, admin_token(stand)
    put(store, status(0))
    code = create_login_code(store, lifetime=timedelta(minutes=1))
    async with stand.client(token="", client=("192.0.2.7", 1)) as browser:
        await browser.get("/login", params={"code": "wrong"})
        await browser.get("/login", params={"code": code})
        await browser.post("/logout")
        await browser.post("/login", data={"token": token})
        answer = await browser.post(f"/api/v1/nodes/{NODE}/commands", json={"name": "calibrate"})
        assert answer.status_code == 202
    revoke_token(store, token_id(digest(stand.token)))
    assert audit_entries(stand)[2:] == [
        ("command line", "login link made", ""),
        ("", "sign in refused", ""),
        ("login link", "sign in", ""),
        ("login link", "sign out", ""),
        ("boss", "sign in", ""),
        ("boss", "command asked for", NODE),
        ("boss", "command issued", NODE),
        ("command line", "token revoked", token_id(digest(stand.token))),
    ]


async def test_administrators_read_the_log_latest_first(stand: Stand) -> None:
    token = admin_token(stand)
    problem(await stand.get("/api/v1/audit-log"), 403)
    async with stand.client(token=token) as client:
        await client.post("/login", data={"token": token})
        answer = (await client.get("/api/v1/audit-log")).json()
    assert answer["next"] is None
    first = answer["items"][0]
    assert (first["id"], first["actor"], first["action"]) == (2, "boss", "sign in")
    assert first["address"] == "127.0.0.1"
    assert first["time"].startswith("2027-01-15T09:00:00")
    assert [item["id"] for item in answer["items"]] == [2, 1, 0]


async def test_pages_join(stand: Stand) -> None:
    stand.cloud.store.write(lambda connection: record_many(connection, 1100)).result(120)
    async with stand.client(token=admin_token(stand)) as client:
        one = (await client.get("/api/v1/audit-log")).json()
        two = (await client.get("/api/v1/audit-log", params={"cursor": one["next"]})).json()
    numbers = [item["id"] for item in one["items"] + two["items"]]
    assert numbers == list(range(1101, -1, -1))
    assert two["next"] is None


@pytest.mark.parametrize("change", ["UPDATE audit_log SET actor = 'x'", "DELETE FROM audit_log"])
async def test_store_rejects_changes_of_the_log(stand: Stand, change: str) -> None:
    written = stand.cloud.store.write(lambda c: c.exec_driver_sql(change))
    with pytest.raises(SQLAlchemyError, match="append only"):
        written.result(120)
    assert audit_entries(stand) == [
        ("command line", "token created", token_id(digest(stand.token)))
    ]


@pytest.mark.nightly
@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_changes_of_the_file_are_detected(tmp_path: Path, data: st.DataObject) -> None:
    path = Path(mkdtemp(dir=tmp_path)) / "store.sqlite"
    count = data.draw(st.integers(2, 6))
    with Store(path) as store:
        store.write(lambda connection: record_many(connection, count)).result(120)
    victim = data.draw(st.integers(0, count - 1))
    column = data.draw(
        st.sampled_from(["time", "actor", "address", "action", "target", "detail", "digest", ""])
    )
    tamper(path, victim, column)
    removed_at_the_end = not column and victim == count - 1
    with Store(path) as store, store.read() as connection:
        assert check_audit_entries(connection) == (None if removed_at_the_end else victim)


def tamper(path: Path, number: int, column: str) -> None:
    """Change or delete an entry in the file."""
    with sqlite3.connect(path) as file:
        for verb in ("update", "delete"):
            file.execute(f"DROP TRIGGER audit_log_no_{verb}")
        if column:
            change = f"UPDATE audit_log SET {column} = {column} || 7 WHERE number = ?"  # noqa: S608
        else:
            change = "DELETE FROM audit_log WHERE number = ?"
        file.execute(change, (number,))
    file.close()


async def test_tokens_are_made_listed_and_revoked_by_administrators(stand: Stand) -> None:
    async with stand.client(token=admin_token(stand)) as boss:
        desired_state: dict[str, Any] = {"name": "lab", "scopes": ["read"], "days": 1}
        made = await boss.post("/api/v1/tokens", json=desired_state)
        assert made.status_code == 201
        number, token = made.json()["id"], made.json()["token"]
        async with stand.client(token=token) as lab:
            assert (await lab.get("/api/v1/nodes")).status_code == 200
            for answer in (await lab.get("/api/v1/tokens"), await lab.post("/api/v1/tokens")):
                assert "admin" in problem(answer, 403)
            problem(await lab.delete(f"/api/v1/tokens/{number}"), 403)
            listed = {
                item["id"]: item for item in (await boss.get("/api/v1/tokens")).json()["items"]
            }
            assert listed[number]["name"] == "lab"
            assert listed[number]["state"] == "good"
            assert token not in str(listed)
            assert (await boss.delete(f"/api/v1/tokens/{number}")).status_code == 204
            problem(await boss.delete(f"/api/v1/tokens/{number}"), 404)
            problem(await lab.get("/api/v1/nodes"), 401)
    assert [audit_entry for audit_entry in audit_entries(stand) if audit_entry[0] == "boss"] == [
        ("boss", "token created", number),
        ("boss", "token revoked", number),
    ]


@pytest.mark.parametrize(
    "body",
    [
        {},
        {"name": "", "scopes": ["read"]},
        {"name": "x", "scopes": []},
        {"name": "x", "scopes": ["root"]},
        {"name": "x", "scopes": ["read"], "days": 0},
        {"name": "x", "scopes": ["read"], "days": 1e9},
        {"name": "x", "scopes": ["read"], "forever": True},
    ],
)
async def test_tokens_are_not_made_from_nonsense(stand: Stand, body: dict[str, Any]) -> None:
    async with stand.client(token=admin_token(stand)) as boss:
        problem(await boss.post("/api/v1/tokens", json=body), 422)
