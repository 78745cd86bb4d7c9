"""The gateway's status in the headers of each request."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any
from unittest.mock import Mock

from eskin_gateway.forward.status_report import HEADER, StatusReport
from eskin_gateway.publish.presence import Presence
from eskin_gateway.spool.batch import Batch, DeadLetter, SpoolMessage
from eskin_gateway.spool.spool import Spool

from eskin.errors import SpoolError

if TYPE_CHECKING:
    from pathlib import Path


def read(report: StatusReport) -> Any:
    return json.loads(report.headers()[HEADER])


def test_header_reports_the_spool(tmp_path: Path) -> None:
    spool = Spool(tmp_path / "spool.db", capacity=1000, max_dead_letters=10)
    passed = [0.0]
    report = StatusReport(spool, Presence(15.0), clock=lambda: passed[0], now=lambda: 500)
    empty = {"messages": 0, "bytes": 0, "capacity_bytes": 1000, "oldest_ns": None}
    assert read(report) == empty | {"dead_letters": 0, "nodes": 0}
    entries = [SpoolMessage("n", 200, b"123"), SpoolMessage("n", 300, b"4567")]
    spool.commit(Batch(entries, [DeadLetter(1, "n", "why", b"x")]))
    assert read(report)["messages"] == 0, "it is cached"
    passed[0] = 1.0
    filled = {"messages": 2, "bytes": 7, "capacity_bytes": 1000, "oldest_ns": 300}
    assert read(report) == filled | {"dead_letters": 1, "nodes": 0}
    spool.close()


def test_unreadable_spool_blocks_no_request() -> None:
    spool = Mock(**{"oldest.side_effect": SpoolError("damaged")})
    assert StatusReport(spool, Presence(15.0)).headers() == {"Content-Type": "application/cbor"}
