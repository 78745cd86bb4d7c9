"""The wire decoder: whatever says to be a message, an acknowledgement or a command."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin.errors import MessageError
from eskin.interval import Interval
from eskin.tube import Tube
from eskin.wire.messages import (
    Acknowledgement,
    Block,
    Command,
    CommandName,
    Encoding,
    Message,
    Position,
    decode_message,
)
from tests.robustness.fuzz.mutations.trees import mutate_tree
from tests.robustness.fuzz.target import Target
from tests.unit.gateway.messages import EPOCH, result, status

if TYPE_CHECKING:
    from pathlib import Path


def make(_: Path) -> Target:
    """Only `MessageError`; what is read says the same bytes again; a block encloses as it says."""
    wave = Interval(np.array([-np.inf, 1.0, -3.0]), np.array([2.0, np.inf, -2.5]))
    tube = Tube((EPOCH, EPOCH + 9), 10**6, wave, "F", 0.99)
    place = Position(1, 7)
    ends = EPOCH + 10**12
    seeds = [Block.pack(place, "t01.capacitance", 5, tube, encoding) for encoding in Encoding]
    commands = (
        Command(1, "fingertip", EPOCH, ends, CommandName.RESET, {}),
        Command(2, "fingertip", EPOCH, ends, CommandName.SET, {"rate": 500.0, "taxel": "t01"}),
        Command(3, "n", EPOCH, ends, CommandName.SET, {"threshold": 1.0, "channel": "t01.x"}),
    )
    acknowledgement = Acknowledgement(EPOCH, ((1, 0, 7), (2, 3, 3)), (bytes(32), bytes(range(32))))
    said: tuple[Message | Command, ...] = (
        *seeds,
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
        if isinstance(message, Block):
            _check_block(message)


def _check_block(block: Block) -> None:
    values = block.tube.values
    assert block.bounds == (values.inf.min(), values.sup.max())
    assert (values.inf <= values.sup).all()
    for encoding in Encoding:
        again = Block.decode(
            Block.pack(block.position, block.channel, block.ticks, block.tube, encoding).encode()
        )
        written = again.tube.values
        assert (written.inf <= values.inf).all(), "a lower bound rose"
        assert (written.sup >= values.sup).all(), "an upper bound fell"
