"""A gateway's spool: commits, and settlements with dead letters."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING, Any, Final
from unittest.mock import patch

from eskin_gateway.spool.batch import Batch, DeadLetter, SpoolMessage
from eskin_gateway.spool.node_state import NodeState
from eskin_gateway.spool.spool import Spool

from eskin.wire.messages import Position

if TYPE_CHECKING:
    import random
    from pathlib import Path

    from tests.robustness.powercut.journal import Marks

_NAME: Final = "spool.sqlite"
_NODES: Final = ("fingertip", "palm")
_BATCHES: Final = 90
_PAGES: Final = 60
"""Of the log, until it is folded into the file: few, so that this happens often."""


def work(folder: Path, draw: random.Random, marks: Marks) -> None:
    """Take what nodes say and hand it on, with a restart in the middle."""
    numbers = dict.fromkeys(_NODES, 0)
    with patch("eskin_gateway.spool.spool._CHECKPOINT_PAGES", _PAGES):
        for _ in range(2):
            spool = _open(folder)
            for _ in range(_BATCHES):
                _commit(spool, draw, marks, numbers)
                if draw.random() < 0.4:
                    _settle(spool, draw, marks)
            spool.close()


def _open(folder: Path) -> Spool:
    return Spool(folder / _NAME, capacity=1 << 30, max_dead_letters=1000)


def _commit(spool: Spool, draw: random.Random, marks: Marks, numbers: dict[str, int]) -> None:
    batch, said = Batch(), []
    for _ in range(draw.randint(1, 12)):
        node = draw.choice(_NODES)
        record = batch.nodes.setdefault(node, spool.node(node) or NodeState())
        record.add(Position(1, numbers[node]))
        batch.messages.append(SpoolMessage(node, 5, _body(node, numbers[node])))
        said.append((node, numbers[node]))
        numbers[node] += 1
    marks.tell("will", *said)
    spool.commit(batch)
    marks.tell("did", *said)


def _settle(spool: Spool, draw: random.Random, marks: Marks) -> None:
    taken = spool.take(draw.randint(1, 40), 1 << 20)
    dead = [DeadLetter(7, m.node, "no", m.body) for m in taken if draw.random() < 0.1]
    refused = {letter.body for letter in dead}
    marks.tell("settles", *[_place(m.body) for m in taken if m.body not in refused])
    spool.settle(taken, dead)


def check(folder: Path, marks: list[list[Any]]) -> None:
    """Whatever was committed waits, or the cloud has it; and no one takes it a second time."""
    will, did, settles = (
        {tuple(place) for what, places in marks if what == kind for place in places}
        for kind in ("will", "did", "settles")
    )
    with closing(_open(folder)) as spool:
        waiting = [_place(message.body) for message in spool.take(1_000_000, 1 << 40)]
        dead = {_place(letter.body) for letter in spool.dead_letters()}
        records = {node: spool.node(node) or NodeState() for node in _NODES}
        seen = {(n, k) for n, k in will if records[n].is_duplicate(Position(1, k))}
        assert spool.statistics.messages == len(waiting)
    there = set(waiting)
    assert len(there) == len(waiting), "doubled"
    assert not there & dead, "waits, and is a dead letter"
    assert there <= will, "never said"
    assert not (lost := did - there - dead - settles), f"vanished: {sorted(lost)[:5]}"
    assert not (lost := seen - there - dead - settles), f"taken, but not there: {lost}"
    assert not (again := (there | dead) - seen), f"there, but would be taken again: {again}"
    for node in _NODES:
        own = [number for name, number in waiting if name == node]
        assert own == sorted(own), "out of order"
    with closing(sqlite3.connect(folder / _NAME)) as database:
        assert database.execute("PRAGMA integrity_check").fetchall() == [("ok",)]


def _body(node: str, number: int) -> bytes:
    return f"{node} {number} ".encode() * (50 + number % 97)


def _place(body: bytes) -> tuple[str, int]:
    """Whose body it is; a corrupt one has none."""
    node, number = body.decode().split(" ")[:2]
    assert body == _body(node, int(number)), "corrupt"
    return node, int(number)
