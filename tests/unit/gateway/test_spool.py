"""The spool holds what it committed, in order, whatever happens."""

from __future__ import annotations

import json
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from typing import TYPE_CHECKING

import pytest
from eskin_gateway.spool.batch import Batch, DeadLetter, NodeCertificate, SpoolMessage
from eskin_gateway.spool.node_state import NodeState
from eskin_gateway.spool.spool import VERSION, Spool
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule, run_state_machine_as_test

from eskin.errors import SpoolError
from eskin.wire.messages import Position
from tests.support.processes import Running

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_CAPACITY = 2000


def opened(folder: Path, *, capacity: int = 10_000_000) -> Spool:
    return Spool(folder / "spool.db", capacity=capacity, max_dead_letters=3)


@pytest.fixture
def spool(tmp_path: Path) -> Iterator[Spool]:
    made = opened(tmp_path)
    yield made
    made.close()


class SpoolMachine(RuleBasedStateMachine):
    """Random commits, settlements and reopenings against a list."""

    folder: Path

    def __init__(self) -> None:
        super().__init__()
        for file in self.folder.glob("spool.db*"):
            file.unlink()
        self.spool = opened(self.folder, capacity=_CAPACITY)
        self.model: list[tuple[str, bytes]] = []
        self.accepted: set[int] = set()
        self.held = 0

    @rule(
        bodies=st.lists(st.binary(max_size=200), max_size=5),
        positions=st.lists(st.integers(0, 60), max_size=5),
        held=st.integers(0, 60),
    )
    def commit(self, bodies: list[bytes], positions: list[int], held: int) -> None:
        state = self.spool.node("n") or NodeState()
        for number in positions:
            state.add(Position(1, number))
        state.release(Position(1, held))
        batch = Batch([SpoolMessage("n", 5, body) for body in bodies], nodes={"n": state})
        used = sum(len(body) for _, body in self.model)
        if used + batch.size > _CAPACITY:
            with pytest.raises(SpoolError, match="spool is full"):
                self.spool.commit(batch)
            return
        self.spool.commit(batch)
        self.model += [("n", body) for body in bodies]
        self.accepted.update(positions)
        self.held = max(self.held, held)

    @rule(count=st.integers(0, 5))
    def settle(self, count: int) -> None:
        self.spool.settle(self.spool.take(count, 10**6) if count else [])
        del self.model[:count]

    @rule()
    def reopen(self) -> None:
        self.spool.close()
        self.spool = opened(self.folder, capacity=_CAPACITY)

    @invariant()
    def holds_what_the_list_holds(self) -> None:
        taken = self.spool.take(1000, 10**6)
        assert [(message.node, message.body) for message in taken] == self.model
        statistics = self.spool.statistics
        assert statistics.messages == len(self.model)
        assert statistics.used == sum(len(body) for _, body in self.model)

    @invariant()
    def knows_every_accepted_position(self) -> None:
        state = self.spool.node("n") or NodeState()
        for number in range(61):
            expected = number in self.accepted or number < self.held
            assert state.is_duplicate(Position(1, number)) == expected

    def teardown(self) -> None:
        self.spool.close()


def test_spool_agrees_with_a_list_under_random_operations(tmp_path: Path) -> None:
    class Machine(SpoolMachine):
        folder = tmp_path

    settings = hypothesis_settings(max_examples=40, stateful_step_count=20, deadline=None)
    run_state_machine_as_test(Machine, settings=settings)


def test_take_respects_count_and_bytes_but_gives_one_at_least(spool: Spool) -> None:
    spool.commit(Batch([SpoolMessage("n", 1, bytes(100)) for _ in range(5)]))
    assert len(spool.take(3, 10**6)) == 3
    assert len(spool.take(5, 250)) == 2
    assert len(spool.take(5, 1)) == 1


def test_settled_messages_are_gone_and_rejected_ones_are_dead_letters(spool: Spool) -> None:
    spool.commit(Batch([SpoolMessage("n", 1, b"good"), SpoolMessage("n", 2, b"bad")]))
    taken = spool.take(2, 10**6)
    letter = DeadLetter(3, "n", "cloud: not wanted", b"bad")
    spool.settle(taken, [letter])
    assert spool.take(10, 10**6) == []
    assert spool.dead_letters() == [letter]
    assert spool.statistics.used == 0


def test_dead_letters_are_bounded_and_drops_are_counted(spool: Spool) -> None:
    for number in range(5):
        spool.commit(Batch(dead_letters=[DeadLetter(number, "n", "poison", bytes([number]))] * 2))
    assert [letter.time for letter in spool.dead_letters()] == [2, 3, 4]
    assert (spool.statistics.dead_letters, spool.statistics.dead_letters_dropped) == (3, 2)


def test_certificate_and_status_survive_reopening(tmp_path: Path) -> None:
    sender = NodeCertificate(bytes(32), int(time.time()) + 1000, b"leaf", b"issuer")
    state = NodeState(status=b"status", thumbprint=bytes(32))
    first = opened(tmp_path)
    first.commit(Batch(nodes={"n": state}, certificates=[sender]))
    first.close()
    second = opened(tmp_path)
    assert second.certificate(bytes(32)) == sender
    assert second.certificate(bytes(31)) is None
    assert second.node("n") == state
    assert second.nodes() == ["n"]
    second.close()


def fill(spool: Spool) -> None:
    batch = Batch([SpoolMessage("n", 1, bytes(2000)), SpoolMessage("m", 2, bytes(2000))])
    for _ in range(1000):
        spool.commit(batch)


_WRITER = """
import sys
from pathlib import Path
from eskin.wire.messages import Position
from eskin_gateway.spool.batch import Batch, SpoolMessage
from eskin_gateway.spool.node_state import NodeState
from eskin_gateway.spool.spool import Spool
spool = Spool(Path(sys.argv[1]), capacity=10**9, max_dead_letters=3)
state = NodeState()
for number in range(10**9):
    state.add(Position(1, number))
    spool.commit(Batch([SpoolMessage("n", number, number.to_bytes(8) * 100)], nodes={"n": state}))
    if number % 7 == 6:
        spool.settle(spool.take(3, 10**6))
    print(number, flush=True)
"""


def test_killed_writer_leaves_every_committed_message(tmp_path: Path) -> None:
    log = tmp_path / "log"
    writer = Running([sys.executable, "-c", _WRITER, str(tmp_path / "spool.db")], log=log)
    for _ in range(3):
        for file in (log, *tmp_path.glob("spool.db*")):
            file.unlink(missing_ok=True)
        with writer:
            writer.wait_for(lambda: log.exists() and writer.output().count("\n") > 100, "writes")
            writer.signal(signal.SIGKILL)
            assert writer.process is not None
            writer.process.wait()
        vouched = int(writer.output().rpartition("\n")[0].rpartition("\n")[2])
        spool = opened(tmp_path)
        left = [int.from_bytes(message.body[:8]) for message in spool.take(10**6, 10**9)]
        assert left == list(range(left[0], left[-1] + 1))
        assert left[-1] >= vouched
        state = spool.node("n")
        assert state is not None
        assert list(state.ranges[1]) == [(0, left[-1])]
        spool.close()


def test_full_database_rejects_whole_batches_and_loses_nothing(tmp_path: Path) -> None:
    spool = opened(tmp_path)
    pages = spool._ingest.execute("PRAGMA page_count").fetchone()[0]
    for connection in (spool._ingest, spool._forward):
        connection.execute(f"PRAGMA max_page_count = {pages + 40}")
    with pytest.raises(SpoolError, match="full"):
        fill(spool)
    stored = spool.statistics.messages // 2
    assert stored > 5
    assert spool.statistics.messages == 2 * stored
    assert len(spool.take(10_000, 10**9)) == 2 * stored
    spool.settle(spool.take(4, 10**9))
    spool.commit(Batch([SpoolMessage("n", 1, bytes(2000))]))
    assert spool.statistics.messages == 2 * stored - 3
    spool.close()
    again = opened(tmp_path)
    assert len(again.take(10_000, 10**9)) == 2 * stored - 3
    again.close()


def test_full_disk_loses_nothing_and_still_empties_into_the_cloud(tmp_path: Path) -> None:
    command = ["unshare", "--user", "--map-root-user", "--mount", sys.executable]
    done = subprocess.run(
        [*command, "-m", "tests.unit.gateway.full_disk", str(tmp_path)],
        capture_output=True, text=True, timeout=200, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout)
    assert seen["committed"] > 500
    assert "full" in seen["refusal"]
    assert seen["taken"] == list(range(seen["committed"]))
    assert seen["again"] > 100


def test_folder_that_cannot_be_created_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SpoolError, match="cannot be opened"):
        Spool(tmp_path / "file" / "spool.db", capacity=10**7, max_dead_letters=3)


def test_spool_of_another_version_is_rejected(tmp_path: Path) -> None:
    opened(tmp_path).close()
    connection = sqlite3.connect(tmp_path / "spool.db")
    connection.execute(f"PRAGMA user_version = {VERSION + 1}")
    connection.close()
    with pytest.raises(SpoolError, match="version"):
        opened(tmp_path)


def test_confirmed_sequences_are_kept_for_the_latest_boots(tmp_path: Path) -> None:
    spool = opened(tmp_path)
    entries = [SpoolMessage("n", 1, b"x", boot, k) for boot in range(20) for k in (3, 1)]
    spool.commit(
        Batch([*entries, SpoolMessage("m", 1, b"y", 7, 5), SpoolMessage("m", 1, b"z", 7, 6)])
    )
    stored = spool.take(100, 10**6)
    spool.settle(stored, [DeadLetter(1, "m", "no", b"z")], confirmed=stored[:-1])
    assert spool.confirmed() == [("m", 7, 5), *(("n", boot, 3) for boot in range(20))]
    spool.close()
    again = opened(tmp_path)
    assert again.confirmed() == [("m", 7, 5), *(("n", boot, 3) for boot in range(4, 20))]
    again.close()


def test_expired_certificates_are_deleted_at_the_start(tmp_path: Path) -> None:
    spool = opened(tmp_path)
    soon = int(time.time()) + 1000
    spool.commit(
        Batch(
            certificates=[
                NodeCertificate(b"old", 5, b"", b""),
                NodeCertificate(b"new", soon, b"", b""),
            ]
        )
    )
    spool.close()
    again = opened(tmp_path)
    assert again.certificate(b"old") is None
    assert again.certificate(b"new") is not None
    again.close()


def test_second_gateway_on_one_spool_is_rejected(tmp_path: Path, spool: Spool) -> None:
    with pytest.raises(SpoolError, match="another gateway runs on it"):
        opened(tmp_path)
    spool.close()
    opened(tmp_path).close()


def damage(folder: Path, change: str) -> None:
    """Change the file behind the gateway's back."""
    with closing(sqlite3.connect(folder / "spool.db")) as db, db:
        db.execute(change)


@pytest.mark.parametrize(
    "change", ["body = x'6f6e66'", "node = 'o'", "received = 7", "boot = 3", "sequence = 8"]
)
def test_damaged_message_becomes_a_dead_letter_and_others_go_on(
    tmp_path: Path, change: str
) -> None:
    spool = opened(tmp_path)
    spool.commit(Batch([SpoolMessage("n", 5, b"one", 1, 9), SpoolMessage("n", 6, b"two", 1, 10)]))
    spool.close()
    damage(tmp_path, f"UPDATE messages SET {change} WHERE id = 1")  # noqa: S608 - ours
    spool = opened(tmp_path)
    assert [message.body for message in spool.take(1, 1000) or spool.take(1, 1000)] == [b"two"]
    (letter,) = spool.dead_letters()
    assert "damaged" in letter.reason
    assert (spool.statistics.messages, spool.statistics.dead_letters) == (1, 1)
    spool.close()


def test_damaged_node_state_is_dropped(tmp_path: Path) -> None:
    spool = opened(tmp_path)
    state = NodeState(held=Position(1, 3))
    state.add(Position(1, 7))
    spool.commit(Batch(nodes={"n": state}))
    spool.close()
    damage(tmp_path, "UPDATE nodes SET held_sequence = 99")
    spool = opened(tmp_path)
    assert spool.node("n") is None
    spool.commit(Batch(nodes={"n": state}))
    again = spool.node("n")
    assert again is not None
    assert again.held == state.held
    spool.close()
