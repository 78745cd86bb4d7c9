"""The wire contract: what a node says, and how it is answered (``docs/eskin.cddl``)."""

from __future__ import annotations

from typing import TypeAlias

from eskin.errors import MessageError
from eskin.wire.messages.acknowledgement import Acknowledgement
from eskin.wire.messages.block import Block
from eskin.wire.messages.block_header import BlockSummary
from eskin.wire.messages.cbor_map import Fields, load
from eskin.wire.messages.command import Command
from eskin.wire.messages.command_schema import CommandName, Mode
from eskin.wire.messages.encoding import Encoding
from eskin.wire.messages.gap import Gap
from eskin.wire.messages.header import Kind, Position
from eskin.wire.messages.peak import Peak
from eskin.wire.messages.result import Outcome, Result
from eskin.wire.messages.status import (
    ChannelInfo,
    Energy,
    Place,
    ResetCause,
    Shedding,
    Status,
    TaxelFaults,
)

__all__ = [
    "Acknowledgement",
    "Block",
    "BlockSummary",
    "ChannelInfo",
    "Command",
    "CommandName",
    "Encoding",
    "Energy",
    "Gap",
    "Kind",
    "Message",
    "Mode",
    "Outcome",
    "Peak",
    "Place",
    "Position",
    "ResetCause",
    "Result",
    "Shedding",
    "Status",
    "TaxelFaults",
    "decode_message",
]

Message: TypeAlias = Block | Peak | Gap | Status | Result
"""Whatever a node says in its sequence."""


def decode_message(data: bytes) -> Message:
    """Read whatever a node said.

    Args:
        data: The plaintext, deterministic CBOR.

    Raises:
        MessageError: It is no message of a node.
    """
    fields = load(data)
    kind = fields.integer(1, 0, 255)
    return Block.read(fields, data) if kind == Kind.BLOCK else _read_event(kind, fields)


def _read_event(kind: int, fields: Fields) -> Peak | Gap | Status | Result:
    if kind == Kind.PEAK:
        return Peak.read(fields)
    if kind == Kind.GAP:
        return Gap.read(fields)
    if kind == Kind.STATUS:
        return Status.read(fields)
    if kind == Kind.RESULT:
        return Result.read(fields)
    raise MessageError(f"field 1 is {kind}; a node says kinds 1 to 5")
