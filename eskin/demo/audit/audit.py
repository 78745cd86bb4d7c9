"""The audit: every interval that the cloud stored, against the truth that the emulator kept."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from eskin_cloud.store.damage import collect_damaged_rows
from eskin_cloud.store.location import StoreLocation, reading_engine

from eskin.demo.audit.delivery import Delivery, UnderWay, deliveries
from eskin.demo.audit.frames import StoredFrames, audit_frames, count_frames
from eskin.demo.audit.sealed import count_sealed, open_keys
from eskin.errors import AuditError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from sqlalchemy import Connection

    from eskin.demo.audit.channel import ChannelAudit
    from eskin.demo.layout import DemoFolder
    from eskin.wire.messages import Position


@dataclass(frozen=True, slots=True)
class Audit:
    """What the audit found.

    Attributes:
        channels: One entry a patch, by node and patch.
        deliveries: One entry a node.
        letters: Messages that the gateway refused to take: the node and the reason.
        doubled: Frames that are stored twice, by node.
        damaged: Rows that are not as they were written, which could not be compared.
        departures: By node, which taxels the world takes out of their data sheets, why and when.
            Their violations count as any.
    """

    channels: list[ChannelAudit]
    deliveries: list[Delivery]
    letters: list[str]
    doubled: dict[str, list[Position]]
    damaged: list[str]
    departures: dict[str, list[str]]

    @property
    def passes(self) -> bool:
        """Whether every patch keeps its promise, and nothing vanished silently."""
        kept = all(entry.passes for entry in self.channels)
        once = not any(self.doubled.values())
        return kept and once and not self.damaged and all(each.passes for each in self.deliveries)


def audit(
    layout: DemoFolder,
    *,
    store: StoreLocation | None = None,
    progress: Callable[[int, int], None] = lambda _done, _all: None,
) -> Audit:
    """Compare all frames in the store with the truth; also while the demo runs.

    Args:
        layout: The demo's data folder.
        store: Where the cloud's store is; ``None``: in that folder.
        progress: Called with rows done and rows in all.

    Raises:
        AuditError: There is no store, no frame, or a frame that no node's emulator knows.
    """
    if store is None and not layout.store.exists():
        raise AuditError(f"{layout.root}: no store here; has `eskin demo` run on this folder?")
    seen = UnderWay.look(layout)
    engine = reading_engine(store or layout.store, readers=1)
    try:
        with engine.begin() as connection:
            with collect_damaged_rows() as damaged:
                channels, framed = _audit(layout, seen.truths, connection, progress)
                delivered = deliveries(seen, connection, framed)
            doubled = {node: found.doubled for node, found in framed.items()}
            rows = [str(row) for row in damaged]
            return Audit(channels, delivered, seen.letters, doubled, rows, seen.departures)
    finally:
        engine.dispose()


def _audit(
    layout: DemoFolder,
    files: Mapping[str, Path],
    connection: Connection,
    progress: Callable[[int, int], None],
) -> tuple[list[ChannelAudit], dict[str, StoredFrames]]:
    sealed, framed = count_sealed(connection), count_frames(connection)
    total, done = sum(sum(each.values()) for each in (sealed, framed)), 0
    if total == 0:
        raise AuditError(f"{layout.store}: the store holds no samples yet; let the demo run longer")
    found: list[ChannelAudit] = []
    stored: dict[str, StoredFrames] = {}

    def advance(rows: int) -> None:
        nonlocal done
        done += rows
        progress(done, total)

    reader = open_keys(layout) if sealed else None
    for node in sorted(sealed.keys() | framed.keys()):
        path = files.get(node)
        if path is None:
            raise AuditError(f"{layout.nodes}: the emulator's truth of node {node!r} is missing")
        stored[node] = audit_frames(path, connection, node, advance, reader=reader)
        found += sorted(stored[node].patches, key=lambda entry: entry.channel)
    if not any(entry.samples for entry in found):
        raise AuditError(f"{layout.nodes}: the emulator has dropped the truth behind all samples")
    return found, stored
