"""What a gateway tells of itself with each request."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import jwt

from eskin.errors import SpoolError
from gateway.batch import Batch, DeadLetter, Entry
from gateway.condition import Condition
from gateway.presence import Presence
from gateway.spool import Spool
from gateway.warrants import Warrants

if TYPE_CHECKING:
    from pathlib import Path

    from tests.identities import Identities


def claims(warrants: Warrants) -> dict[str, Any]:
    token = warrants.headers(b"body")["Authorization"].removeprefix("Bearer ")
    found: dict[str, Any] = jwt.decode(token, options={"verify_signature": False})
    return found


def test_token_tells_what_waits_in_the_spool(tmp_path: Path, identities: Identities) -> None:
    spool = Spool(tmp_path / "spool.db", capacity=1000, letters=10)
    passed = [0.0]
    condition = Condition(spool, Presence(15.0), clock=lambda: passed[0], now=lambda: 500)
    warrants = Warrants(identities.gateway)
    assert "state" not in claims(warrants)
    warrants.tell(condition)
    empty = {"messages": 0, "bytes": 0, "capacity_bytes": 1000, "oldest_ns": None}
    assert claims(warrants)["state"] == empty | {"dead_letters": 0, "nodes": 0}
    entries = [Entry("n", 200, b"123"), Entry("n", 300, b"4567")]
    spool.commit(Batch(entries, [DeadLetter(1, "n", "why", b"x")]))
    assert claims(warrants)["state"]["messages"] == 0, "it does not look each time"
    passed[0] = 1.0
    told = {"messages": 2, "bytes": 7, "capacity_bytes": 1000, "oldest_ns": 300}
    assert claims(warrants)["state"] == told | {"dead_letters": 1, "nodes": 0}
    spool.close()


def test_spool_that_cannot_be_read_hinders_no_request(identities: Identities) -> None:
    def broken() -> dict[str, object]:
        raise SpoolError("damaged")

    warrants = Warrants(identities.gateway)
    warrants.tell(broken)
    assert "state" not in claims(warrants)
