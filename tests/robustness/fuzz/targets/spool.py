"""A gateway's spool whose file was damaged."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

from eskin_gateway.spool.batch import Batch, DeadLetter, NodeCertificate, SpoolMessage
from eskin_gateway.spool.node_state import NodeState
from eskin_gateway.spool.spool import Spool

from eskin.errors import SpoolError
from eskin.wire.messages import Position
from tests.robustness.fuzz.mutations.octets import mutate_image
from tests.robustness.fuzz.target import Target
from tests.unit.gateway.skins import SMALL

if TYPE_CHECKING:
    from pathlib import Path

_MIB = 1 << 20


def make(folder: Path) -> Target:
    """Only `SpoolError`; what is read back has the types that it was written with."""
    whole = folder / "whole.db"
    spool = Spool(whole, capacity=_MIB, max_dead_letters=5)
    spool.commit(_batch(1))
    spool._ingest.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    spool.close()
    path = folder / "spool.db"

    def check(data: bytes) -> None:
        for other in folder.glob("spool.db*"):
            if other.suffix != ".reserve":
                other.unlink()
        path.write_bytes(data)
        with ExitStack() as stack:
            try:
                damaged = Spool(path, capacity=_MIB, max_dead_letters=5)
                stack.callback(damaged.close)
                _use(damaged)
            except SpoolError:
                return

    return Target((whole.read_bytes(),), mutate_image, check)


def _batch(sequence: int) -> Batch:
    record = NodeState(held=Position(1, 0), status=b"status", thumbprint=b"t" * 32)
    record.add(Position(1, sequence))
    batch = Batch()
    batch.messages.append(SpoolMessage("fingertip", 5, SMALL.frame(sequence).encode()))
    batch.nodes["fingertip"] = record
    batch.certificates.append(NodeCertificate(b"t" * 32, 2**40, b"leaf", b"issuer"))
    batch.dead_letters.append(DeadLetter(5, "fingertip", "why", b"body"))
    return batch


def _use(spool: Spool) -> None:
    for name in spool.nodes():
        assert isinstance(name, str)
        spool.node(name)
    spool.certificate(b"t" * 32)
    spool.dead_letters()
    spool.oldest()
    spool.commit(_batch(2))
    taken = spool.take(10, _MIB)
    assert all(isinstance(message.body, bytes) for message in taken)
    spool.settle(taken)
