"""The public status of a node."""

from __future__ import annotations

from dataclasses import replace

import orjson
from eskin_gateway.publish import public_payloads
from eskin_gateway.publish.presence import Presence

from eskin.interval import Verdict
from eskin.wire.messages import (
    TaxelFaults,
)
from tests.unit.gateway.messages import status


def test_status_lists_faulty_taxels() -> None:
    stated = replace(status(1), faults=(TaxelFaults("t05", Verdict.IMPOSSIBLE, Verdict.CERTAIN),))
    said = orjson.loads(public_payloads.status("n", stated, online=True)[1])
    assert said["faults"] == [{"taxel": "t05", "dead": "impossible", "stuck": "certain"}]
    assert "faults" not in orjson.loads(public_payloads.status("n", status(1), online=True)[1])


def test_presence_publishes_changes_and_every_status() -> None:
    presence = Presence(10.0)

    def said(*messages: tuple[str, bytes, bool]) -> list[bool]:
        assert all(kept for _, _, kept in messages)
        return [orjson.loads(body)["online"] for _, body, _ in messages]

    assert said(*presence.update("n", None, live=True, now=0.0)) == []
    assert said(*presence.update("n", status(1), live=True, now=1.0)) == [True]
    assert said(*presence.update("n", None, live=True, now=2.0)) == []
    assert said(*presence.expire(11.9)) == []
    assert presence.online == 1
    assert said(*presence.expire(12.0)) == [False]
    assert said(*presence.expire(13.0)) == []
    assert said(*presence.update("n", status(2), live=False, now=14.0)) == [False]
    assert said(*presence.update("n", None, live=True, now=15.0)) == [True]
