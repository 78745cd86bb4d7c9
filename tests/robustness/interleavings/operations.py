"""What units do: each operation runs the product's functions, as its API and its jobs do."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Final

from eskin_cloud.jobs.retention import sweep
from eskin_cloud.live.feed import Feed
from eskin_cloud.privacy.subject_notice import SubjectNotice, note
from eskin_cloud.rollup.patch_tile_builder import build
from eskin_cloud.rollup.samples import read_samples
from eskin_cloud.store.feed_entry import FEED_START, FeedPosition
from eskin_cloud.store.move import move
from eskin_cloud.store.read.lookup import UnknownChannelError, find_channel
from eskin_cloud.store.read.window import Window

from eskin.errors import StoreError
from tests.robustness.interleavings.world import GATEWAY, NEAR, OPEN, bring, compact_all
from tests.support.identities import SITE
from tests.unit.cloud.messages import START

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from eskin_cloud.app_state import AppState
    from eskin_cloud.store import Store
    from eskin_cloud.store.write.ingest import Receipt
    from sqlalchemy import URL

    from tests.robustness.interleavings.world import Message, World

WINDOW: Final = Window(START - 10**6, START + 10**9)
_LOOKS: Final = 2
_AT_ONCE: Final = 2

Samples = list[tuple[int, float, float]]
"""Time and bounds of a channel's samples."""


@dataclass(slots=True)
class Unit:
    """A cloud that does one thing.

    Attributes:
        name: The operation, and which of its kind.
        operation: The operation.
        world: Where it is.
        place: The database.
        cloud: The cloud.
        batch: What it is brought, if it ingests.
        moves: How many units move a store to the database.
        receipts: How each message was answered.
        feed: The cloud's live feed.
        begun: Where a stream of it began.
        position: Up to where it has read.
        cursors: What the stream was given.
        windows: The samples of each look at the window.
        refused: Why a store that is being moved refused it, or the move was refused.
        error: What it failed with.
    """

    name: str
    operation: str
    world: World
    place: URL
    cloud: AppState
    batch: Sequence[Message]
    moves: int
    feed: Feed
    begun: FeedPosition
    position: FeedPosition
    receipts: list[tuple[Message, Receipt]] = field(default_factory=list)
    cursors: list[int] = field(default_factory=list)
    windows: list[Samples] = field(default_factory=list)
    refused: str | None = None
    error: BaseException | None = None

    @property
    def store(self) -> Store:
        """The cloud's store."""
        return self.cloud.store

    def run(self) -> None:
        """Do it; what a moving store refuses, a gateway or a job tries again later."""
        try:
            OPERATIONS[self.operation](self)
        except StoreError as error:
            # Two moves to one place disturb each other; each may be started again.
            disturbed = self.operation == "move" and self.moves > 1
            if not disturbed and not (self.moves and is_refusal(error)):
                self.error = error
            self.refused = str(error)
        except Exception as error:  # noqa: BLE001 - a finding
            self.error = error

    def follow(self) -> None:
        """Read the stream to the end, a few entries at a time."""
        asyncio.run(self._follow())

    async def _follow(self) -> None:
        await self.feed.catch_up()
        while self.position != self.feed.last:
            page = await self.feed.after(self.position, _AT_ONCE)
            self.position = page.end
            self.cursors += [entry.cursor for entry in page.entries]


class NotDurableError(Exception):
    """A message was answered as stored that no other connection sees."""


def is_refusal(error: StoreError) -> bool:
    """Whether a store refuses what is asked because of a move."""
    return any(words in str(error) for words in ("is being moved here", "not empty: it has rows"))


def make_unit(
    name: str, world: World, place: URL, *, number: int, batch: Sequence[Message], moves: int
) -> Unit:
    """A unit; its stream begins at what is stored, or at the start if all is moved here."""
    cloud = world.cloud(number, place)
    feed = Feed(cloud.store, recent=100, recent_bytes=10**6)
    start = FEED_START if moves else feed.last
    operation = name.partition("#")[0]
    return Unit(name, operation, world, place, cloud, batch, moves, feed, start, start)


def _ingest(unit: Unit) -> None:
    outcome = bring(unit.store, unit.batch, introduced=not unit.moves)
    unit.receipts += zip(unit.batch, outcome.results, strict=True)
    _require_durable(unit)
    unit.feed.append(outcome.entries)


def _require_durable(unit: Unit) -> None:
    rows = unit.world.ask(unit.place, "SELECT node, first, last FROM sequences")
    seen = {(node, number) for node, first, last in rows for number in range(first, last + 1)}
    for message, receipt in unit.receipts:
        if receipt.result == "stored" and message.place not in seen:
            raise NotDurableError(f"{message.place} was answered before its commit")


def _erase(unit: Unit) -> None:
    """Take a notice, as `eskin_cloud.api.notices` does; then delete, as the job does."""
    now, notice = unit.cloud.clock(), SubjectNotice([], [unit.world.erased])
    work = partial(note, notice=notice, site=SITE, gateway=GATEWAY, now=now)
    unit.store.write(work).result(60)
    asyncio.run(sweep(unit.cloud))


def _compact(unit: Unit) -> None:
    compact_all(unit.store)


def _build(unit: Unit) -> None:
    build(unit.store)


def _read(unit: Unit) -> None:
    for _ in range(_LOOKS):
        unit.follow()
        unit.windows.append(read_window(unit.store))


def read_window(store: Store) -> Samples:
    """The samples of a node's channel; none while the node is not known."""
    with store.read() as connection:
        try:
            channel = find_channel(connection, NEAR, OPEN)
        except UnknownChannelError:
            return []
        found = read_samples(connection, channel, WINDOW)
    columns = found.first.tolist(), found.lo.tolist(), found.hi.tolist()
    return sorted(zip(*columns, strict=True))


def _move(unit: Unit) -> None:
    target = unit.place.set(username=unit.store.location.username)  # type: ignore[union-attr]
    move(unit.world.source, target, now=unit.cloud.clock())


OPERATIONS: Final[dict[str, Callable[[Unit], None]]] = {
    "ingest": _ingest,
    "erase": _erase,
    "compact": _compact,
    "build": _build,
    "read": _read,
    "move": _move,
}
