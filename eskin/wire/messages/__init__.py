"""The wire contract: what a node says, and how it is answered (``docs/eskin.cddl``)."""

from __future__ import annotations

from typing import TypeAlias

from eskin.errors import MessageError
from eskin.wire.messages.acknowledgement import Acknowledgement
from eskin.wire.messages.cbor_map import Fields, load
from eskin.wire.messages.command import Command, CommandName, Mode, Outcome, Result
from eskin.wire.messages.header import Kind, Position
from eskin.wire.messages.release import Release
from eskin.wire.messages.status import (
    Energy,
    ResetCause,
    Shedding,
    Status,
    TaxelFaults,
)

__all__ = [
    "Acknowledgement",
    "Command",
    "CommandName",
    "Energy",
    "Kind",
    "Message",
    "Mode",
    "Outcome",
    "Position",
    "Release",
    "ResetCause",
    "Result",
    "Shedding",
    "Status",
    "TaxelFaults",
    "decode_message",
    "read_message",
]

Message: TypeAlias = Status | Result
"""A message with a position that is read without a layout."""


def decode_message(data: bytes) -> Message:
    """Read a status or a result.

    Args:
        data: The plaintext, deterministic CBOR.

    Raises:
        MessageError: It is neither.
    """
    return read_message(load(data))


def read_message(fields: Fields) -> Message:
    """Read a status or a result from its decoded fields.

    Raises:
        MessageError: It is neither.
    """
    kind = fields.integer(1, 0, 255)
    if kind == Kind.STATUS:
        return Status.read(fields)
    if kind == Kind.RESULT:
        return Result.read(fields)
    raise MessageError(
        f"field 1 is {kind}; expected a status ({Kind.STATUS:d}) or a result ({Kind.RESULT:d})"
    )
