"""What must hold after each schedule, by the product's readers and by plain SQL."""

from __future__ import annotations

from collections import Counter, defaultdict
from typing import TYPE_CHECKING, Any, Final

from eskin_cloud.rollup.hulls import read_ranges
from eskin_cloud.rollup.patch_tile_builder import build
from eskin_cloud.store.feed_entry import last_position
from eskin_cloud.store.move import TABLES, move
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.row_digests import ROW_DIGEST, without_digest
from eskin_cloud.store.sample_grid import STEP, TOP, patch_level
from eskin_cloud.store.schema.frame_tables import (
    frames,
    pages,
    patch_rows,
    patch_tiles,
    patches,
    stale_patch_chunks,
)
from eskin_cloud.store.schema.sealed_tables import erased_subjects, sealed_messages
from eskin_cloud.store.schema.tables import audit_log, events, feed, sequences
from eskin_cloud.store.store import Store
from eskin_cloud.store.write.audit_log import Action, check_audit_entries
from eskin_cloud.store.write.duplicates import find_digest
from eskin_cloud.store.write.ingest import CONFLICT
from eskin_cloud.store.write.parsed_message import ParsedMessage
from eskin_cloud.store.write.write_cache import MOVING
from sqlalchemy import func, select

from eskin.errors import EskinError
from eskin.wire.slot import slot_of, slot_of_cursor
from tests.robustness.interleavings.operations import WINDOW, read_window
from tests.robustness.interleavings.world import NEAR, OPEN, bring, compact_all

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sqlalchemy import Table

    from tests.robustness.interleavings.operations import Samples, Unit
    from tests.robustness.interleavings.scheduler import Execution
    from tests.robustness.interleavings.world import Message, World

_LEVELS: Final = tuple(patch_level(1) + k * STEP for k in range(2))
_ALL_LEVELS: Final = tuple(range(patch_level(1), TOP, 4 * STEP))
"""Some up to the highest, which are made of each other."""


class _Found(Exception):  # noqa: N818 - not raised out of this module
    """A law is broken."""


def find_violations(world: World, execution: Execution) -> list[str]:
    """Which laws a schedule broke; none if all hold."""
    failed = [f"{unit.name} failed: {unit.error!r}" for unit in execution.units if unit.error]
    if failed:
        return failed
    if execution.deadlock:
        return [f"deadlock: {'; '.join(map(str, execution.deadlock))}"]
    try:
        _Check(world, execution.units).run()
    except (_Found, EskinError) as error:
        return [f"{error}" if isinstance(error, _Found) else repr(error)]
    return []


def _require(holds: object, said: str) -> None:
    if not holds:
        raise _Found(said)


class _Check:
    """The laws, one after the other."""

    def __init__(self, world: World, units: Sequence[Unit]) -> None:
        self._world, self._units = world, units
        self._place = units[0].place
        self._plain = world.cloud(None, self._place).store
        self._moved = any(unit.operation == "move" and not unit.refused for unit in units)
        self._begun = [] if units[0].moves and not self._moved else world.stored
        self._erasing = [u for u in units if u.operation == "erase" and not u.refused]

    def run(self) -> None:
        self._check_move()
        accepted = self._check_receipts()
        self._check_once(accepted)
        self._check_numbers(accepted)
        self._check_feed()
        self._check_values(accepted)
        self._check_erasure()
        self._bring_again(accepted)
        self._check_tiles(accepted)

    def _ask(self, query: Any) -> list[dict[str, Any]]:
        with self._plain.read() as connection:
            return [without_digest(row) for row in connection.execute(query).mappings()]

    def _check_move(self) -> None:
        """A moved store has all of its source, and no cloud wrote before."""
        moves = [unit for unit in self._units if unit.operation == "move"]
        if not moves:
            return
        if len(moves) > 1 and not self._moved:  # they disturbed each other: one goes on
            move(self._world.source, self._place, now=self._world.clock())
            self._moved, self._begun = True, self._world.stored
        writers = {row["writer"] for row in self._ask(select(feed.c.writer))}
        _require(MOVING not in writers, "no move runs, and the store is still closed")
        if self._moved:
            changed = not {unit.operation for unit in self._units} <= {"move", "read"}
            with Store(self._world.source, clock=self._world.clock) as source:
                for table in TABLES:
                    _require_copied(source, self._plain, table, changed=changed)
        else:
            stored = [r for unit in self._units for _, r in unit.receipts if r.result == "stored"]
            _require(stored or self._erasing, "the move was refused though nothing was stored")

    def _check_receipts(self) -> list[Message]:
        """Of the copies of a number one is stored, the same bytes are duplicates, others not."""
        answers: dict[tuple[str, int], list[tuple[Message, str]]] = defaultdict(list)
        for message in self._begun:
            answers[message.place].append((message, "stored"))
        for unit in self._units:
            for message, receipt in unit.receipts:
                result = "conflict" if receipt.reason == CONFLICT else receipt.result
                answers[message.place].append((message, result))
        accepted = []
        for place, given in answers.items():
            stored = [message for message, result in given if result == "stored"]
            _require(len(stored) == 1, f"{place} was answered {[result for _, result in given]}")
            accepted += stored
            for message, result in given:
                same = message.data == stored[0].data
                expected = ("stored", "duplicate") if same else ("conflict",)
                _require(result in expected, f"{place} was answered {result}, not {expected[-1]}")
        return accepted

    def _check_once(self, accepted: Sequence[Message]) -> None:
        """Each frame is a frame or in compacted rows, once; totals are those of the rows."""
        expected = Counter(message.node for message in accepted if message.frame is not None)
        stored = self._ask(select(frames.c.node, frames.c.sequence, frames.c.data))
        found = Counter(row["node"] for row in stored)
        for row in self._ask(select(patch_rows.c.node, patch_rows.c.frames)):
            found[row["node"]] += row["frames"]
        _require(found == expected, f"frames are {dict(found)}, not {dict(expected)}")
        of = {message.place: message.data for message in accepted}
        for row in stored:
            place = row["node"], row["sequence"]
            _require(of.get(place) == row["data"], f"the frame {place} is another one")
        self._check_totals()

    def _check_totals(self) -> None:
        f, p, r, v = frames.c, pages.c, patch_rows.c, sealed_messages.c
        open_ = select(f.node, f.layout, f.page, func.count().label("n"), func.min(f.t).label("t"))
        counted: dict[Any, Any] = {}
        for row in self._ask(open_.group_by(f.node, f.layout, f.page)):
            counted[row["node"], row["layout"], row["page"]] = row["n"], row["t"]
        sealed = select(v.node, v.place, func.count().label("n"), func.min(v.t_lo).label("t"))
        for row in self._ask(sealed.group_by(v.node, v.place)):
            counted[row["node"], row["place"]] = row["n"], row["t"]
        for row in self._ask(select(p.node, p.layout, p.page, p.frames, p.t_first)):
            keys = [
                (row["node"], row["layout"], row["page"]),
                (row["node"], f"{row['layout'].hex()}.{row['page']}"),
            ]
            right = next((counted[key] for key in keys if key in counted), (0, None))
            stated = row["frames"], row["t_first"]
            _require(stated == right, f"totals of a page are {stated}, not {right}")
        size = func.sum(func.length(r.data)).label("bytes")
        totals = (func.count().label("rows"), func.sum(r.samples).label("samples"), size,
                  func.min(r.t).label("t_first"), func.max(r.t_end).label("t_last"))  # fmt: skip
        query = select(r.node, r.patch, *totals).group_by(r.node, r.patch)
        of_patches = {(row["node"], row["patch"]): row for row in self._ask(query)}
        for row in self._ask(select(patches)):
            due = of_patches[row["node"], row["patch"]]
            said = {name: row[name] for name in due}
            _require(said == due, f"totals of a patch of {row['node']} are {said}, not {due}")

    def _check_numbers(self, accepted: Sequence[Message]) -> None:
        """Numbers are those of the messages."""
        expected: dict[str, set[int]] = defaultdict(set)
        for message in accepted:
            expected[message.node].add(message.sequence)
        found: dict[str, set[int]] = defaultdict(set)
        for row in self._ask(select(sequences)):
            these = set(range(row["first"], row["last"] + 1))
            _require(not these & found[row["node"]], f"ranges of {row['node']} overlap")
            found[row["node"]] |= these
        _require(found == expected, f"numbers are {dict(found)}, not {dict(expected)}")

    def _check_digests(self, accepted: Sequence[Message]) -> None:
        with self._plain.read() as connection:
            for message in accepted:
                own = ParsedMessage.parse(message.node, message.data).digest
                kept = find_digest(connection, message.node, 1, message.sequence)
                _require(kept == own, f"{message.place} has another digest")

    def _check_feed(self) -> None:
        """A stream gives each entry once, in the order of its slot, and leaves out none."""
        cursors: dict[int, tuple[str, int]] = {}
        for table in (frames, sealed_messages, events):
            c = table.c
            for row in self._ask(select(c.slot, c.node, c.cursor, c.sequence)):
                cursor = row["cursor"]
                _require(cursor not in cursors, f"cursor {cursor} is there twice")
                right = slot_of_cursor(cursor) == row["slot"] == slot_of(row["node"])
                _require(right, f"cursor {cursor} is of another slot")
                cursors[cursor] = row["node"], row["sequence"]
        with self._plain.read() as connection:
            last = last_position(connection)
        _require(all(cursor in last for cursor in cursors), "a cursor is after the slot's last")
        for unit in self._units:
            start = unit.begun
            unit.follow()
            seen = unit.cursors
            _require(len(set(seen)) == len(seen), f"the stream of {unit.name} repeats an entry")
            for slot in {slot_of_cursor(cursor) for cursor in seen}:
                own = [cursor for cursor in seen if slot_of_cursor(cursor) == slot]
                _require(own == sorted(own), f"the stream of {unit.name} is out of order")
            missed = {cursor for cursor in cursors if cursor not in start} - set(seen)
            names = [cursors[cursor] for cursor in missed]
            _require(not missed, f"the stream of {unit.name} skips {names}")

    def _check_values(self, accepted: Sequence[Message]) -> None:
        """Each look at the window has what was stored before, and nothing that is not stored."""
        everything, before = _samples(accepted), _samples(self._begun)
        for unit in self._units:
            for samples in unit.windows:
                read = Counter(samples)
                _require(not read - Counter(everything), f"{unit.name} reads what is not stored")
                if not unit.moves:
                    _require(not Counter(before) - read, f"{unit.name} misses samples")
        found = read_window(self._plain)
        _require(found == everything, "the window's samples are not those of the messages")

    def _check_erasure(self) -> None:
        """What is recorded as removed is not stored, and stays away."""
        erased = self._ask(select(erased_subjects))
        if not self._erasing:
            _require(not erased, "an erasure is recorded that no unit asked for")
            return
        _require(len(erased) == 1, "the erasure is not recorded")
        left = self._ask(select(sealed_messages.c.node, sealed_messages.c.sequence))
        if erased[0]["removed"] is not None:
            _require(not left, f"removed, and still stored: {left}")
        actions = Counter(row["action"] for row in self._ask(select(audit_log.c.action)))
        for action in (Action.SUBJECT_ERASED, Action.SUBJECT_REMOVED):
            wanted = 1 if action is Action.SUBJECT_ERASED or erased[0]["removed"] else 0
            _require(actions[action.value] == wanted, f"{action.value}: {actions[action.value]}")
        with self._plain.read() as connection:
            _require(check_audit_entries(connection) is None, "the audit log's chain is broken")

    def _bring_again(self, accepted: list[Message]) -> None:
        """Each cloud knows what the others stored: new messages are counted, copies are not."""
        introduced = not self._units[0].moves
        for unit, fresh in zip(self._units, self._world.later, strict=False):
            (receipt,) = bring(unit.store, [fresh], introduced=introduced).results
            _require(receipt.result == "stored", f"{fresh.place} is answered {receipt.result}")
            accepted.append(fresh)
        self._check_once(accepted)
        self._check_numbers(accepted)
        for unit in self._units:
            answers = [
                each.result for each in bring(unit.store, accepted, introduced=introduced).results
            ]
            same = answers == ["duplicate"] * len(accepted)
            _require(same, f"copies at {unit.name} are answered {answers}")
        self._check_digests(accepted)

    def _check_tiles(self, accepted: Sequence[Message]) -> None:
        """Tiles say what the samples say, now and after all is built."""
        samples = _samples(accepted)
        self._require_hulls(samples, _LEVELS)
        if any(unit.operation in {"compact", "build"} for unit in self._units):
            compact_all(self._plain)
            build(self._plain)
            _require(not self._ask(select(frames.c.sequence)), "a frame is not compacted")
            _require(not self._ask(select(stale_patch_chunks)), "a chunk stays stale")
            self._require_hulls(samples, _ALL_LEVELS)

    def _require_hulls(self, samples: Samples, levels: Sequence[int]) -> None:
        for level in levels:
            with self._plain.read() as connection:
                channel = find_channel(connection, NEAR, OPEN)
                ranges = [(WINDOW.start >> level, (WINDOW.end >> level) + 1)]
                found = read_ranges(connection, channel, level, ranges)
            columns = found.first, found.last, found.n, found.lo, found.hi
            read = zip(*(column.tolist() for column in columns), strict=True)
            expected = [(t, t, 1, lo, hi) for t, lo, hi in samples]
            same = _united(read, level) == _united(expected, level)
            _require(same, f"hulls of level {level} are not those of the samples")


_Hull = tuple[int, int, int, float, float]
"""First and last time, number, and bounds of some samples."""


def _united(hulls: Iterable[_Hull], level: int) -> dict[int, _Hull]:
    """One hull for each tile; a part of it may be of samples that are not in tiles yet."""
    found: dict[int, _Hull] = {}
    for hull in hulls:
        a, b = found.get(hull[0] >> level, hull), hull
        count = hull[2] + (a[2] if hull[0] >> level in found else 0)
        united = min(a[0], b[0]), max(a[1], b[1]), count, min(a[3], b[3]), max(a[4], b[4])
        found[hull[0] >> level] = united
    return found


_REMOVED: Final = {frames, sealed_messages, stale_patch_chunks, patch_tiles}
"""Tables of which units remove rows; other checks read what became of them."""


def _require_copied(source: Store, target: Store, table: Table, *, changed: bool) -> None:
    """All rows of the source are in the target; their keys, where units changed some later."""
    names = table.primary_key.columns.keys() if changed else table.columns.keys()
    rows = []
    for store in (source, target):
        with store.read() as connection:
            found = connection.execute(select(table)).mappings()
            rows.append({tuple(row[n] for n in names if n != ROW_DIGEST) for row in found})
    if table not in _REMOVED or not changed:
        _require(rows[0] <= rows[1], f"{table.name}: {len(rows[0] - rows[1])} rows were not moved")
    if not changed:
        _require(rows[0] == rows[1], f"{table.name}: {len(rows[1] - rows[0])} rows too many")


def _samples(messages: Sequence[Message]) -> Samples:
    """The samples of the node's channel, as the messages state them."""
    found: Samples = []
    for message in messages:
        if message.node != NEAR or message.frame is None:
            continue
        grid, values = message.frame.grids[0], message.frame.values[0].reshape(-1)
        first = sum(message.frame.time) // 2 + grid.delay
        columns = values.inf.tolist(), values.sup.tolist()
        found += [
            (first + k * grid.period, *each) for k, each in enumerate(zip(*columns, strict=True))
        ]
    return sorted(found)
