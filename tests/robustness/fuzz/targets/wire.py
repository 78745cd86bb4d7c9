"""The wire decoder: whatever says to be a message, an acknowledgement or a command."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin.errors import MessageError
from eskin.wire.messages import (
    Acknowledgement,
    Command,
    CommandName,
    Message,
    decode_message,
)
from tests.robustness.fuzz.mutations.trees import mutate_tree
from tests.robustness.fuzz.target import Target
from tests.unit.gateway.messages import EPOCH, result, status

if TYPE_CHECKING:
    from pathlib import Path


def make(_: Path) -> Target:
    """Only `MessageError`; what is read says the same bytes again."""
    ends = EPOCH + 10**12
    commands = (
        Command(1, "fingertip", EPOCH, ends, CommandName.RESET, {}),
        Command(2, "fingertip", EPOCH, ends, CommandName.SET, {"rate": 500.0, "taxel": "t01"}),
        Command(3, "n", EPOCH, ends, CommandName.SET, {"threshold": 1.0, "channel": "t01.x"}),
    )
    acknowledgement = Acknowledgement(EPOCH, ((1, 0, 7), (2, 3, 3)), (bytes(32), bytes(range(32))))
    said: tuple[Message | Command, ...] = (
        status(4),
        result(5, 1),
        *commands,
    )
    return Target((*(one.encode() for one in said), acknowledgement.encode()), mutate_tree, check)


def check(data: bytes) -> None:
    """Read it as all that it may be."""
    for decode in (decode_message, Acknowledgement.decode, Command.decode):
        try:
            message = decode(data)
        except MessageError:
            continue
        assert message.encode() == data, "not the bytes that were read"
