"""Contacts of the skins that are watched, once for all viewers."""

from __future__ import annotations

import asyncio
import logging
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from cachetools import LRUCache

from eskin.errors import EskinError
from eskin.wire.frames.frame import read_head
from eskin_cloud.live.shared_skin import SharedSkin
from eskin_cloud.query.contacts import ContactSkin
from eskin_cloud.schemas.base import dump
from eskin_cloud.schemas.contacts import describe_contacts

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from eskin.wire.frames import DescribedLayout
    from eskin_cloud.live.feed import Feed
    from eskin_cloud.store.feed_entry import FeedEntry

log = logging.getLogger(__name__)

_NODES: Final = 256


@dataclass(slots=True)
class Picture:
    """The frames of one stretch.

    Attributes:
        stretch: Names it within the node.
        layout: By which it is read.
        cursor: That of its latest frame.
        frames: By page.
    """

    stretch: tuple[int, int]
    layout: bytes
    cursor: int
    frames: dict[int, bytes] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class FoundContacts:
    """Contacts of one stretch.

    Attributes:
        number: Counts what was found.
        node: The skin's first node.
        text: In JSON.
    """

    number: int
    node: str
    text: str


class LiveContacts:
    """Finds contacts once a stretch, in a thread, one skin after the other.

    Those of a skin that one node samples are at the last instant of each stretch; those of a skin
    of several nodes are at an instant that all of them have reached (`SharedSkin`). Streams hand
    over what they read, so nothing is computed for a skin that none watches. A stretch that is not
    computed when the next one is complete is skipped.

    Args:
        feed: Whose frames are read.

    Attributes:
        latest: By node.
        found: How many have been found.
    """

    def __init__(self, feed: Feed) -> None:
        self._feed = feed
        self._skins: LRUCache[bytes, ContactSkin | None] = LRUCache(_NODES)
        self._pictures: LRUCache[str, Picture] = LRUCache(_NODES)
        self._shared: LRUCache[bytes, SharedSkin] = LRUCache(_NODES)
        self._due: dict[str | bytes, Picture | SharedSkin] = {}
        self._task: asyncio.Task[None] | None = None
        self.found = 0
        self.latest: LRUCache[str, FoundContacts] = LRUCache(_NODES)

    def take(self, entry: FeedEntry, nodes: Collection[str]) -> None:
        """Take a frame that a viewer reads, if it is of a watched skin; each counts once.

        Args:
            entry: The frame.
            nodes: Those that the viewer watches.
        """
        described = self._feed.layouts.get(entry.layout)
        if described is None or entry.frame is None or entry.layout is None:
            return
        if len(set(described.controllers)) > 1:
            if not set(described.controllers).isdisjoint(nodes):
                self._take_share(entry, described)
        elif entry.node in nodes:
            self._take_page(entry, described)

    def _take_share(self, entry: FeedEntry, described: DescribedLayout) -> None:
        skin = self._shared.get(described.hash)
        if skin is None:
            skin = self._shared[described.hash] = SharedSkin(described)
        if skin.take(entry):
            self._begin(described.hash, skin)

    def _take_page(self, entry: FeedEntry, described: DescribedLayout) -> None:
        picture = self._pictures.get(entry.node)
        if picture is not None and entry.cursor <= picture.cursor:
            return
        head = read_head(entry.frame or b"")
        if picture is None or (picture.stretch, picture.layout) != (head.stretch, described.hash):
            if picture is not None and picture.frames:  # a page of it is missing
                self._begin(entry.node, picture)
            picture = self._pictures[entry.node] = Picture(
                head.stretch, described.hash, entry.cursor
            )
        picture.cursor = entry.cursor
        picture.frames[head.page] = entry.frame or b""
        # Contacts are found once for all clients, so frames of biometric pages are not in them.
        public = len(described.layout.pages) - len(described.biometric_pages)
        if len(picture.frames) == public:
            self._begin(entry.node, picture)
            # A page that comes twice begins anew.
            self._pictures[entry.node] = Picture(head.stretch, described.hash, entry.cursor)

    def _begin(self, key: str | bytes, work: Picture | SharedSkin) -> None:
        self._due[key] = work
        if self._task is None:
            self._task = asyncio.create_task(self._work())

    async def _work(self) -> None:
        try:
            while self._due:
                key, work = next(iter(self._due.items()))
                del self._due[key]
                described = self._feed.layouts.get(work.layout)
                if described is None:
                    continue
                nodes = (
                    [key] if isinstance(key, str) else list(dict.fromkeys(described.controllers))
                )
                text = await asyncio.to_thread(self._find, nodes, work, described)
                if text is None:
                    continue
                self.found += 1
                found = FoundContacts(self.found, nodes[0], text)
                # Other nodes that the layout names may be of another skin.
                for node in nodes if isinstance(work, Picture) else work.heard:
                    self.latest[node] = found
                self._feed.wake()
        finally:
            self._task = None

    def _find(
        self, nodes: Sequence[str], work: Picture | SharedSkin, described: DescribedLayout
    ) -> str | None:
        try:
            if work.layout not in self._skins:
                self._skins[work.layout] = ContactSkin.of(described)
            skin = self._skins[work.layout]
            if skin is None:
                return None
            if isinstance(work, SharedSkin):
                pressures = work.advance(skin)
            else:
                pressures = skin.read_last(list(work.frames.values()))
            if pressures is None or not pressures.known:
                return None
            found = describe_contacts(nodes, skin, pressures, skin.find(pressures))
        except EskinError as error:
            log.warning("contacts cannot be found: node=%s reason=%s", nodes[0], error)
            return None
        return dump(found).decode()
