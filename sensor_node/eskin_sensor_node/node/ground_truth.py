"""Ground truth: the true samples behind every frame, which only the emulator knows.

A file of its own for a node, or for a whole fleet, written before the flash's commit, so that every
stored frame has its truth.
"""

from __future__ import annotations

import sqlite3
import zlib
from collections import defaultdict
from contextlib import ExitStack, closing, contextmanager, nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from eskin.errors import FlashError, LockedError
from eskin.runtime.files.lock import LockFile
from eskin.runtime.sqlite_integrity import UNREADABLE, why
from eskin.wire.messages import Position

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from contextlib import AbstractContextManager
    from pathlib import Path

    from numpy.typing import NDArray

    from eskin.interval import Floats

_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS fact (key TEXT PRIMARY KEY, value INTEGER NOT NULL) STRICT;
CREATE TABLE IF NOT EXISTS supply (
    node TEXT PRIMARY KEY,
    time INTEGER NOT NULL,   -- true UTC, ns since 1970
    energy REAL NOT NULL     -- what it held then, in J
) STRICT;
CREATE TABLE IF NOT EXISTS departure (
    node TEXT NOT NULL,
    description TEXT NOT NULL, -- which taxel leaves its data sheet, why and when
    PRIMARY KEY (node, description)
) STRICT, WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS true_frame (
    id INTEGER PRIMARY KEY,  -- in the order of their making
    node TEXT NOT NULL,
    boot INTEGER NOT NULL,
    sequence INTEGER NOT NULL,
    layout BLOB NOT NULL,    -- hash of the layout by which the frame is read
    ticks INTEGER NOT NULL,  -- the node's clock at the first instant
    lasting INTEGER NOT NULL, -- ns of the node's clock from then until its samples are complete
    time INTEGER NOT NULL,   -- true UTC of the first instant, ns since 1970
    "end" INTEGER NOT NULL,  -- true UTC when its samples are complete
    sizes BLOB NOT NULL,     -- pairs of uint32, little endian: number and cells of each patch
    samples BLOB NOT NULL    -- float64, little endian, first all first bytes and so on; deflated
) STRICT;
CREATE UNIQUE INDEX IF NOT EXISTS true_frame_position ON true_frame (boot, sequence, node);
CREATE TABLE IF NOT EXISTS settled (
    node TEXT NOT NULL,
    boot INTEGER NOT NULL,
    sequence INTEGER NOT NULL, -- below it all was in flash, or is named by a gap
    PRIMARY KEY (node, boot)
) STRICT, WITHOUT ROWID;
"""
_INSERT: Final = (
    "INSERT OR REPLACE INTO true_frame (node, boot, sequence, layout, ticks, lasting, time, "
    '"end", sizes, samples) VALUES (?,?,?,?,?,?,?,?,?,?)'
)
_KEEP: Final = "INSERT OR REPLACE INTO fact VALUES (?, ?)"
_LATER: Final = (
    "INSERT INTO fact VALUES ('end', ?) ON CONFLICT (key) DO UPDATE SET value = max(value, ?1)"
)
_SETTLED: Final = "INSERT OR REPLACE INTO settled VALUES (?, ?, ?)"
_SLACK: Final = 128
_FORGOTTEN_AT_ONCE: Final = 64


@dataclass(frozen=True, slots=True)
class TrueFrame:
    """The truth behind one frame.

    Attributes:
        position: The frame's boot and sequence.
        layout: Hash of the layout by which it is read.
        ticks: The node's clock at its first instant, ns.
        lasting: From then until all of its samples are complete, by the node's clock, ns.
        time: True UTC of its first instant, ns.
        end: True UTC when all of its samples are complete, ns.
        sizes: Number and cells (rows times columns) of each patch, shape ``(patches, 2)``.
        values: True values in the units of their patches, without noise: patch after patch as in
            the frame, row after row.
    """

    position: Position
    layout: bytes
    ticks: int
    lasting: int
    time: int
    end: int
    sizes: NDArray[np.uint32]
    values: Floats


class GroundTruth:
    """The ground truth's file. One process writes, others may read meanwhile.

    Args:
        path: Database file; created if missing.
        limit: Bytes of samples to keep; the oldest are dropped.

    Raises:
        FlashError: It cannot be opened.
    """

    def __init__(self, path: Path, *, limit: int) -> None:
        self._path = path
        self._limit = limit
        try:
            with ExitStack() as opened:
                self._owner = opened.enter_context(LockFile(path))
                self._db = opened.enter_context(closing(_connect(path)))
                self._db.executescript(_SCHEMA)
                self._used = self._db.execute(
                    f"SELECT coalesce(sum(length(samples) + {_SLACK}), 0) FROM true_frame"  # noqa: S608 - a constant
                ).fetchone()[0]
                opened.pop_all()
        except LockedError as error:
            raise FlashError(f"{path}: another process writes this truth; stop it first") from error
        except (OSError, *UNREADABLE) as error:
            raise FlashError(f"{path}: the truth cannot be opened: {why(error)}") from error

    @classmethod
    def read_frames(
        cls, path: Path, positions: Iterable[Position], *, node: str
    ) -> dict[Position, TrueFrame]:
        """Read the truth behind some frames of a node, also while it writes.

        Returns:
            What is (still) there.

        Raises:
            FlashError: The file cannot be read.
        """
        query = (
            'SELECT layout, ticks, lasting, time, "end", sizes, samples FROM true_frame '
            "WHERE boot = ? AND sequence = ?"
        )
        found: dict[Position, TrueFrame] = {}
        with _reading(path) as db:
            for position in positions:
                row = db.execute(*_of(node, query, position.boot, position.sequence)).fetchone()
                if row is not None:
                    sizes = np.frombuffer(row[5], "<u4").reshape(-1, 2).astype(np.uint32)
                    layout, ticks, lasting, time, end = row[:5]
                    found[position] = TrueFrame(
                        position, layout, ticks, lasting, time, end, sizes, _inflated(row[6])
                    )
        return found

    @classmethod
    def made(cls, path: Path) -> dict[str, list[Position]]:
        """Positions of all frames whose truth is there, in order, of each node.

        Raises:
            FlashError: The file cannot be read.
        """
        found: dict[str, list[Position]] = defaultdict(list)
        with _reading(path) as db:
            query = "SELECT node, boot, sequence FROM true_frame ORDER BY boot, sequence"
            for node, boot, sequence in db.execute(query):
                found[node].append(Position(boot, sequence))
        return dict(found)

    @classmethod
    def positions(cls, path: Path) -> list[Position]:
        """The same of a file that has one node.

        Raises:
            FlashError: The file cannot be read.
        """
        return [position for each in cls.made(path).values() for position in each]

    @classmethod
    def oldest(cls, path: Path, *, node: str | None = None) -> Position | None:
        """The least position whose truth is still there; ``None`` if there is none.

        Raises:
            FlashError: The file cannot be read.
        """
        query, values = _of(node, "SELECT boot, sequence FROM true_frame WHERE boot >= ?", 0)
        with _reading(path) as db:
            row = db.execute(f"{query} ORDER BY boot, sequence LIMIT 1", values).fetchone()
        return None if row is None else Position(*row)

    def end(self) -> int | None:
        """True UTC in ns after the latest sample of all that ever was; ``None`` if none was."""
        return self._fact("end")

    def seed(self, wanted: int | None) -> int:
        """The wanted seed, else the recorded one, else a new one; records it."""
        seed = self._fact("seed") if wanted is None else wanted
        if seed is None:
            seed = int(np.random.SeedSequence().generate_state(1)[0])
        self._db.execute(_KEEP, ("seed", seed))
        return seed

    def supply(self, node: str) -> tuple[int, float] | None:
        """True UTC in ns, and J that a node's supply held then; ``None`` if none was kept."""
        query = "SELECT time, energy FROM supply WHERE node = ?"
        row: tuple[int, float] | None = self._db.execute(query, (node,)).fetchone()
        return row

    def store_supply(self, node: str, time: int, energy: float) -> None:
        """Store how much a node's supply holds at an instant.

        Raises:
            FlashError: It cannot be written.
        """
        try:
            self._db.execute("INSERT OR REPLACE INTO supply VALUES (?, ?, ?)", (node, time, energy))
        except UNREADABLE as error:
            raise FlashError(f"{self._path}: the truth cannot be written: {why(error)}") from error

    def store_departures(self, node: str, descriptions: Iterable[str]) -> None:
        """Store which taxels of a node leave their data sheets, besides what is stored already.

        Raises:
            FlashError: It cannot be written.
        """
        with self._writing():
            self._db.executemany(
                "INSERT OR IGNORE INTO departure VALUES (?, ?)",
                [(node, each) for each in descriptions],
            )

    @classmethod
    def departures(cls, path: Path) -> dict[str, list[str]]:
        """Of each node, which taxels leave their data sheets, why and when.

        Raises:
            FlashError: The file cannot be read.
        """
        found: dict[str, list[str]] = defaultdict(list)
        with _reading(path) as db:
            for node, each in db.execute("SELECT node, description FROM departure ORDER BY 1, 2"):
                found[node].append(each)
        return dict(found)

    @classmethod
    def settled(cls, path: Path) -> dict[str, dict[int, int]]:
        """Of each node and boot: the number below which all was in flash, or is named by a gap.

        Known at the latest `store`; what was committed to flash after it is not in it.

        Raises:
            FlashError: The file cannot be read.
        """
        found: dict[str, dict[int, int]] = defaultdict(dict)
        with _reading(path) as db:
            for node, boot, sequence in db.execute("SELECT node, boot, sequence FROM settled"):
                found[node][boot] = sequence
        return dict(found)

    def store(
        self,
        made: Mapping[str, Sequence[TrueFrame]],
        settled: Mapping[str, tuple[int, int]] | None = None,
    ) -> None:
        """Store the truth behind frames of some nodes, in one commit.

        Args:
            made: By node.
            settled: Of each node, the position of its boot below which all was in flash before, or
                is named by a gap.

        Raises:
            FlashError: It cannot be written.
        """
        rows = [_row(node, true) for node, each in made.items() for true in each]
        if not rows:
            return
        end = max(true.end for each in made.values() for true in each)
        used = self._used + sum(len(row[-1]) + _SLACK for row in rows)
        with self._commit(), self._writing():
            self._db.executemany(_INSERT, rows)
            self._db.execute(_LATER, (end,))
            settled_rows = [(node, *position) for node, position in (settled or {}).items()]
            self._db.executemany(_SETTLED, settled_rows)
            used -= self._drop(used - self._limit)
        self._used = used

    @contextmanager
    def together(self) -> Iterator[None]:
        """Commit what is stored inside of the block at its end.

        Raises:
            FlashError: It cannot be written.
        """
        with self._writing():
            self._db.execute("BEGIN IMMEDIATE")
        try:
            yield
            with self._writing():
                self._db.execute("COMMIT")
        finally:
            if self._db.in_transaction:
                self._db.execute("ROLLBACK")

    def _commit(self) -> AbstractContextManager[None]:
        return nullcontext() if self._db.in_transaction else self.together()

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except UNREADABLE as error:
            raise FlashError(f"{self._path}: the truth cannot be written: {why(error)}") from error

    def close(self) -> None:
        """Close the file."""
        self._db.close()
        self._owner.close()

    def _fact(self, key: str) -> int | None:
        row = self._db.execute("SELECT value FROM fact WHERE key = ?", (key,)).fetchone()
        return None if row is None else int(row[0])

    def _drop(self, excess: int) -> int:
        """Drop the oldest; gives the bytes that this frees."""
        freed = 0
        while freed < excess:
            rows = self._db.execute(
                "DELETE FROM true_frame WHERE id IN "
                "(SELECT id FROM true_frame ORDER BY id LIMIT ?) "
                "RETURNING length(samples)",
                (_FORGOTTEN_AT_ONCE,),
            ).fetchall()
            if not rows:
                break
            freed += sum(row[0] + _SLACK for row in rows)
        return freed


@contextmanager
def _reading(path: Path) -> Iterator[sqlite3.Connection]:
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as db:
            yield db
    except UNREADABLE as error:
        raise FlashError(f"{path}: the truth cannot be read: {why(error)}") from error


def _of(node: str | None, query: str, *values: int) -> tuple[str, tuple[int | str, ...]]:
    """A query for one node."""
    return (query, values) if node is None else (f"{query} AND node = ?", (*values, node))


def _row(node: str, true: TrueFrame) -> tuple[Any, ...]:
    place = node, true.position.boot, true.position.sequence
    instants = true.ticks, true.lasting, true.time, true.end
    sizes = true.sizes.astype("<u4").tobytes()
    return *place, true.layout, *instants, sizes, _deflated(true.values)


def _deflated(values: Floats) -> bytes:
    # Bytes of one weight follow each other: neighbours have the same sign, exponent and first bits.
    planes = values.astype("<f8").view(np.uint8).reshape(-1, 8).T
    return zlib.compress(planes.tobytes(), level=1)


def _inflated(data: bytes) -> Floats:
    planes = np.frombuffer(zlib.decompress(data), np.uint8).reshape(8, -1)
    return np.ascontiguousarray(planes.T).view("<f8").ravel().astype(np.float64)


def _connect(path: Path) -> sqlite3.Connection:
    db = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
    db.execute("PRAGMA journal_mode = WAL")
    db.execute("PRAGMA synchronous = FULL")
    return db
