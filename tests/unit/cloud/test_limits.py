"""Floods are refused, and keep no other client out."""

from __future__ import annotations

import secrets
from typing import TYPE_CHECKING

import pytest
from eskin_cloud.settings import LimitsSection
from eskin_cloud.store.write.audit_log import read_audit_entries

from eskin.runtime.http_server.rate_limit import source_of
from tests.unit.cloud.clouds import batch, count_frames, problem, standing
from tests.unit.cloud.messages import stretch

if TYPE_CHECKING:
    from pathlib import Path

    from tests.support.identities import Identities
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio


@pytest.mark.usefixtures("standing_windows")
async def test_flood_from_one_address_is_refused(tmp_path: Path, identities: Identities) -> None:
    few = LimitsSection(requests_per_s=1)
    with standing(tmp_path, identities, limits=few) as stand:
        async with stand.client(client=("192.0.2.1", 1)) as client:
            answers = [await client.get("/api/v1/nodes") for _ in range(12)]
            assert [answer.status_code for answer in answers] == [200] * 10 + [429] * 2
            answer = answers[-1]
            assert "wait" in problem(answer, 429)
            assert answer.headers["retry-after"] == "10"
            assert answer.headers["x-frame-options"] == "DENY"
        async with stand.client(client=("192.0.2.2", 1)) as client:
            assert (await client.get("/api/v1/nodes")).status_code == 200


@pytest.mark.usefixtures("standing_windows")
async def test_bad_credentials_are_limited_and_good_ones_are_not(
    tmp_path: Path, identities: Identities
) -> None:
    few = LimitsSection(failures_per_min=3)
    with standing(tmp_path, identities, limits=few) as stand:
        bad = secrets.token_hex(8)
        async with stand.client(token=bad) as outsider:
            for _ in range(3):
                problem(await outsider.get("/api/v1/nodes"), 401)
            for _ in range(3):
                answer = await outsider.get("/api/v1/nodes")
                problem(answer, 429)
                assert answer.headers["retry-after"] == "60"
            problem(await outsider.post("/login", data={"token": "wrong"}), 429)
        assert (await stand.get("/api/v1/nodes")).status_code == 200


@pytest.mark.usefixtures("standing_windows")
async def test_refused_sign_ins_do_not_fill_the_audit_log(
    tmp_path: Path, identities: Identities
) -> None:
    few = LimitsSection(refusals_per_min=2)
    with standing(tmp_path, identities, limits=few) as stand:
        async with stand.client(token="") as outsider:
            for _ in range(5):
                answer = await outsider.post("/login", data={"token": "wrong"})
                assert answer.status_code == 401
        with stand.cloud.store.read() as connection:
            kept = [row["action"] for row in read_audit_entries(connection)]
    assert kept == ["token created", "sign in refused", "sign in refused"]


async def test_batches_that_find_no_room_in_memory_are_to_come_again(stand: Stand) -> None:
    room, body = stand.cloud.uploads, batch(stretch(0))
    with room.hold(stand.cloud.settings.gateways.uploads_bytes - len(body)):
        assert (await stand.ingest(body)).status_code == 200
        with room.hold(1):
            answer = await stand.ingest(body)
            assert "gateways.uploads_bytes" in problem(answer, 503)
            assert int(answer.headers["retry-after"]) > 0
    assert room.used == 0
    assert count_frames(stand) == 1


@pytest.mark.parametrize(
    ("address", "source"),
    [
        ("192.0.2.1", "192.0.2.1"),
        ("::ffff:192.0.2.1", "192.0.2.1"),
        ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::"),
        ("fe80::1%eth0", "fe80::"),
        ("", ""),
        ("testclient", "testclient"),
    ],
)
async def test_one_user_is_one_source(address: str, source: str) -> None:
    assert source_of(address) == source
