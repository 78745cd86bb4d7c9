"""The audit: every interval that the cloud stored, against the truth that the emulator kept."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain, pairwise
from typing import TYPE_CHECKING, Final

from eskin_cloud.store.compacted_rows import block_bytes
from eskin_cloud.store.damage import DamagedRowError, RowHeader, collect_damaged_rows
from eskin_cloud.store.location import StoreLocation, reading_engine
from eskin_cloud.store.schema.tables import blocks as table
from eskin_sensor_node.node.ground_truth import GroundTruth
from sqlalchemy import func, select

from eskin.demo.audit.channel import ChannelAudit
from eskin.demo.audit.delivery import Delivery, UnderWay, deliveries
from eskin.demo.audit.frames import StoredFrames, audit_frames, count_frames
from eskin.demo.audit.sealed import count_sealed, sealed_pages
from eskin.errors import AuditError
from eskin.wire.messages import Block, Position

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from sqlalchemy import Connection

    from eskin.demo.layout import Layout

_PAGE: Final = 500
_COLUMNS: Final = [
    table.c[name]
    for name in ("channel", "t", "t_end", "t_lo", "t_hi", "dt", "n", "lo", "hi", "coverage")
]
_ROW: Final = [table.c[name] for name in ("data", "head", *RowHeader._fields)]


@dataclass(frozen=True, slots=True)
class Audit:
    """What the audit found.

    Attributes:
        channels: One entry a channel, by node and channel.
        deliveries: One entry a node.
        letters: Messages that the gateway refused to take: the node and the reason.
        doubled: Frames that are stored twice, by node.
        damaged: Rows that are not as they were written, which could not be compared.
    """

    channels: list[ChannelAudit]
    deliveries: list[Delivery]
    letters: list[str]
    doubled: dict[str, list[Position]]
    damaged: list[str]

    @property
    def passes(self) -> bool:
        """Whether every channel keeps its promise, and nothing vanished silently."""
        kept = all(entry.passes for entry in self.channels)
        once = not any(self.doubled.values())
        return kept and once and not self.damaged and all(each.passes for each in self.deliveries)


def audit(
    layout: Layout,
    *,
    store: StoreLocation | None = None,
    progress: Callable[[int, int], None] = lambda _done, _all: None,
) -> Audit:
    """Compare all blocks and frames in the store with the truth; also while the demo runs.

    Args:
        layout: The demo's data folder.
        store: Where the cloud's store is; ``None``: in that folder.
        progress: Called with rows done and rows in all.

    Raises:
        AuditError: There is no store, no block, or a block that no node's emulator knows.
    """
    if store is None and not layout.store.exists():
        raise AuditError(f"{layout.root}: no store here; has `eskin demo` run on this folder?")
    seen = UnderWay.look(layout)
    engine = reading_engine(store or layout.store, readers=1)
    try:
        with engine.begin() as connection:
            with collect_damaged_rows() as damaged:
                channels, framed = _audit(layout, seen.truths, connection, progress)
                complete = {node: found.complete for node, found in framed.items()}
                delivered = deliveries(seen, connection, complete)
            doubled = {node: found.doubled for node, found in framed.items()}
            return Audit(channels, delivered, seen.letters, doubled, [str(row) for row in damaged])
    finally:
        engine.dispose()


def _audit(
    layout: Layout,
    files: Mapping[str, Path],
    connection: Connection,
    progress: Callable[[int, int], None],
) -> tuple[list[ChannelAudit], dict[str, StoredFrames]]:
    messages = func.sum(func.coalesce(table.c.packed, 1))
    counts = select(table.c.node, messages).group_by(table.c.node).order_by(table.c.node)
    nodes = {row[0]: int(row[1]) for row in connection.execute(counts)}
    sealed, framed = count_sealed(connection), count_frames(connection)
    total, done = sum(sum(each.values()) for each in (nodes, sealed, framed)), 0
    if total == 0:
        raise AuditError(f"{layout.store}: the store holds no samples yet; let the demo run longer")
    found: list[ChannelAudit] = []
    stored: dict[str, StoredFrames] = {}

    def advance(rows: int) -> None:
        nonlocal done
        done += rows
        progress(done, total)

    for node in sorted(nodes.keys() | sealed.keys() | framed.keys()):
        path = files.get(node)
        if path is None:
            raise AuditError(f"{layout.nodes}: the emulator's truth of node {node!r} is missing")
        closed = sealed_pages(layout, connection, node) if node in sealed else ()
        pages = chain(_pages(connection, node), closed)
        entries = _audit_blocks(path, node, pages, advance)
        if node in framed:
            stored[node] = audit_frames(path, connection, node, advance)
            entries |= {entry.channel: entry for entry in stored[node].patches}
        found += (entries[channel] for channel in sorted(entries))
    if not any(entry.samples for entry in found):
        raise AuditError(f"{layout.nodes}: the emulator has dropped the truth behind all samples")
    return found, stored


def _audit_blocks(
    path: Path,
    node: str,
    pages: Iterable[list[tuple[Block, bool]]],
    advance: Callable[[int], None],
) -> dict[str, ChannelAudit]:
    """Compare the blocks of a node; gives an entry a channel."""
    found: dict[str, ChannelAudit] = {}
    for page in pages:
        truths = GroundTruth.read(path, [block.position for block, _ in page], node=node)
        oldest = GroundTruth.oldest(path, node=node)
        for block, fits in page:
            new = ChannelAudit(node, block.channel, block.tube.unit)
            entry = found.setdefault(block.channel, new)
            entry.mislabelled += not fits
            truth = truths.get(block.position)
            if truth is not None and len(truth.values) == len(block.tube):
                entry.compare(block, truth.time, truth.values)
                entry.mislabelled += (truth.channel, truth.dt) != (block.channel, block.tube.dt)
            elif oldest is not None and block.position < oldest:
                entry.forgotten += 1
            else:
                raise AuditError(f"{path}: no truth behind {block.position} of node {node!r}")
        advance(len(page))
    return found


def _columns_of(blocks: Sequence[Block]) -> tuple[object, ...]:
    """What the store's columns, from which queries are answered first, must say of a row's blocks.

    A pack's blocks follow each other in even steps.
    """
    tubes = [block.tube for block in blocks]
    even = all(a.moments[-1] + a.dt == b.first_moment for a, b in pairwise(tubes))
    (channel,) = {block.channel for block in blocks}
    (dt,) = {tube.dt for tube in tubes}
    return (
        channel if even else None,
        tubes[0].first_moment,
        int(tubes[-1].moments[-1]),
        *tubes[0].time,
        dt,
        sum(map(len, tubes)),
        min(block.bounds[0] for block in blocks),
        max(block.bounds[1] for block in blocks),
        min(tube.coverage for tube in tubes),
    )


def _pages(connection: Connection, node: str) -> Iterator[list[tuple[Block, bool]]]:
    """The node's blocks, and whether their columns fit, in order; one page in memory at most."""
    last = Position(-1, -1)
    while True:
        query = (
            select(*_ROW)
            .where(table.c.node == node)
            .where(
                (table.c.boot > last.boot)
                | ((table.c.boot == last.boot) & (table.c.sequence > last.sequence))
            )
            .order_by(table.c.boot, table.c.sequence)
            .limit(_PAGE)
        )
        rows = connection.execute(query).mappings().all()
        if not rows:
            return
        page = []
        for row in rows:
            try:
                blocks = [Block.decode(data) for data in block_bytes(row)]
            except DamagedRowError:
                continue  # it is collected
            fits = tuple(row[column.name] for column in _COLUMNS) == _columns_of(blocks)
            page += [(block, fits) for block in blocks]
        yield page
        last = Position(rows[-1]["boot"], rows[-1]["sequence"])
