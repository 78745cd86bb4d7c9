"""A gateway is healthy if all its parts are."""

from __future__ import annotations

from unittest.mock import Mock

import pytest
from eskin_gateway.ops.health import Health

_SHOWN = {
    "broker": "broker",
    "commit_loop": "spool",
    "forwarder": "cloud",
    "command_poller": "commands",
    "revocations": "revocations",
    "subject_sync": "subjects",
}


def health(broken: str | None) -> Health:
    parts = {part: Mock(fault="it is broken" if part == broken else None) for part in _SHOWN}
    return Health(receive_queue=Mock(), spool=Mock(), presence=Mock(), **parts)


@pytest.mark.parametrize("part", _SHOWN)
def test_fault_of_each_part_is_a_reason(part: str) -> None:
    assert health(part).reasons() == [f"{_SHOWN[part]}: it is broken"]


def test_gateway_without_faults_has_no_reason() -> None:
    assert health(None).reasons() == []
