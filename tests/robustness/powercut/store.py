"""The cloud's SQLite store: batches as gateways bring them."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any, Final

from eskin_cloud.store import Store
from eskin_cloud.store.write.ingest import DUPLICATE, STORED
from eskin_cloud.store.write.parsed_message import ParsedMessage

from tests.robustness.chaos.verdict import Verdict, add_up
from tests.support.files import ask
from tests.unit.cloud.clouds import put_items
from tests.unit.cloud.messages import NODE, peak, stretch

if TYPE_CHECKING:
    import random
    from pathlib import Path

    from tests.robustness.powercut.journal import Marks

_NAME: Final = "store.sqlite"
_BATCHES: Final = 45
_SAMPLES: Final = 250


def work(folder: Path, draw: random.Random, marks: Marks) -> None:
    """Store batches, with a restart in the middle."""
    number = 0
    for _ in range(2):
        with Store(folder / _NAME) as store:
            for _ in range(_BATCHES):
                new = range(number, number + draw.randint(1, 25))
                marks.tell("will", *new)
                put_items(store, [_item(number) for number in new])
                marks.tell("did", *new)
                number = new.stop


def check(folder: Path, marks: list[list[Any]]) -> None:
    """Whatever was answered for is stored, byte for byte; all that comes again is stored once."""
    will, did = (
        [number for what, numbers in marks if what == kind for number in numbers]
        for kind in ("will", "did")
    )
    with Store(folder / _NAME) as store:
        _require_sums(folder)
        there = _stored(folder)
        assert not (lost := set(did) - there), f"vanished: {sorted(lost)[:5]}"
        answers = put_items(store, [_item(number) for number in will]).results
        for number, answer in zip(will, answers, strict=True):
            assert answer.result == (DUPLICATE if number in there else STORED), number
        _require_sums(folder)
        assert _stored(folder) == set(will)
    assert ask(folder / _NAME, "PRAGMA integrity_check") == [("ok",)]


def _stored(folder: Path) -> set[int]:
    rows = ask(folder / _NAME, "SELECT sequence, data FROM frames")
    rows += ask(folder / _NAME, "SELECT sequence, data FROM events WHERE kind = 'peak'")
    assert all(_item(number).data == data for number, data in rows), "corrupt"
    found = {number for number, _ in rows}
    assert len(found) == len(rows), "doubled"
    return found


def _require_sums(folder: Path) -> None:
    verdict = Verdict()
    add_up(folder / _NAME, verdict)
    assert not verdict.faults, verdict.faults
    query = (
        "SELECT count(*), count(DISTINCT cursor), min(cursor <= last) FROM ("
        "SELECT slot, cursor FROM frames UNION ALL SELECT slot, cursor FROM events"
        ") JOIN (SELECT slot, cursor AS last FROM feed) USING (slot)"
    )
    ((places, different, before_the_next),) = ask(folder / _NAME, query)
    assert places == different
    assert before_the_next in {None, 1}


@cache
def _item(number: int) -> ParsedMessage:
    if number % 11 == 10:
        return ParsedMessage.parse(NODE, peak(number).encode())
    made = stretch(number, [float(number)] * _SAMPLES, [number + 1.0] * _SAMPLES)
    return ParsedMessage.parse(NODE, made.encode())
