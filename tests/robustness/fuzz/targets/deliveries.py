"""Deliveries: what a gateway asks for, and what the cloud answers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cbor2
from eskin_cloud.commands.command_queue import Holding
from eskin_cloud.ingest.errors import MalformedBatchError
from eskin_gateway.commands.poller import CommandChanges
from eskin_gateway.publish.alarms import AlarmPublisher

from eskin.errors import CloudError
from tests.robustness.fuzz.mutations.trees import mutate_tree
from tests.robustness.fuzz.target import Target

if TYPE_CHECKING:
    from pathlib import Path


def make(_: Path) -> Target:
    """Only `MalformedBatchError` from the cloud's reader, and `CloudError` from the gateway's."""
    asked = {"held": [["fingertip", 1, True], ["palm", 7, False]], "wait_s": 5.0, "published": 3}
    alarm = [4, "squeeze", '{"transition": "raised"}']
    answer = {"give": [["fingertip", 2, b"signed"]], "drop": [["palm", 7]], "alarms": [alarm]}
    return Target((cbor2.dumps(asked), cbor2.dumps(answer)), mutate_tree, check)


def check(data: bytes) -> None:
    """Read it as both."""
    try:
        holding = Holding.read(data)
        assert holding.sent <= holding.held
        assert 0.0 <= holding.wait_s <= 60.0
        assert holding.published is None or holding.published >= 0
    except MalformedBatchError:
        pass
    try:
        changes = CommandChanges.decode(data)
        assert all(isinstance(signed, bytes) for _, _, signed in changes.give)
        AlarmPublisher("homeassistant").give(changes.alarms)
    except CloudError:
        pass
