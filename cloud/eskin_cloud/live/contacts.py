"""Contacts of the skins that are watched, once for all viewers."""

from __future__ import annotations

import asyncio
import logging
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from cachetools import LRUCache

from eskin.errors import EskinError
from eskin.wire.frames.frame_parts import read_head
from eskin_cloud.query.contacts import ContactSkin
from eskin_cloud.schemas.base import dump
from eskin_cloud.schemas.contacts import describe_contacts

if TYPE_CHECKING:
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
        cursor: That of the stretch's last frame.
        text: In JSON.
    """

    cursor: int
    text: str


class LiveContacts:
    """Finds contacts at the last instant of each stretch, in a thread, one skin after the other.

    Streams hand over what they read, so nothing is computed for a node that none watches. A stretch
    that is not computed when the next one is complete is skipped.

    Args:
        feed: Whose frames are read.

    Attributes:
        latest: By node.
    """

    def __init__(self, feed: Feed) -> None:
        self._feed = feed
        self._skins: LRUCache[bytes, ContactSkin | None] = LRUCache(_NODES)
        self._pictures: LRUCache[str, Picture] = LRUCache(_NODES)
        self._due: dict[str, Picture] = {}
        self._task: asyncio.Task[None] | None = None
        self.latest: LRUCache[str, FoundContacts] = LRUCache(_NODES)

    def take(self, entry: FeedEntry) -> None:
        """Take a frame that a viewer of its node is about to get; each counts once."""
        described = self._feed.layouts.get(entry.layout)
        picture = self._pictures.get(entry.node)
        known = picture is not None and entry.cursor <= picture.cursor
        if described is None or entry.frame is None or entry.layout is None or known:
            return
        head = read_head(entry.frame)
        if picture is None or (picture.stretch, picture.layout) != (head.stretch, entry.layout):
            if picture is not None and picture.frames:  # a page of it is missing
                self._begin(entry.node, picture)
            picture = self._pictures[entry.node] = Picture(head.stretch, entry.layout, entry.cursor)
        picture.cursor = entry.cursor
        picture.frames[head.page] = entry.frame
        # Contacts are found once for all clients, so frames of biometric pages are not in them.
        public = len(described.layout.pages) - len(described.biometric_pages)
        if len(picture.frames) == public:
            self._begin(entry.node, picture)
            # A page that comes twice begins anew.
            self._pictures[entry.node] = Picture(head.stretch, entry.layout, entry.cursor)

    def _begin(self, node: str, picture: Picture) -> None:
        self._due[node] = picture
        if self._task is None:
            self._task = asyncio.create_task(self._work())

    async def _work(self) -> None:
        try:
            while self._due:
                node, picture = next(iter(self._due.items()))
                del self._due[node]
                described = self._feed.layouts.get(picture.layout)
                if described is not None:
                    text = await asyncio.to_thread(self._find, node, picture, described)
                    if text is not None:
                        self.latest[node] = FoundContacts(picture.cursor, text)
                        self._feed.wake()
        finally:
            self._task = None

    def _find(self, node: str, picture: Picture, described: DescribedLayout) -> str | None:
        try:
            if picture.layout not in self._skins:
                self._skins[picture.layout] = ContactSkin.of(described)
            skin = self._skins[picture.layout]
            if skin is None:
                return None
            pressures = skin.read_last(list(picture.frames.values()))
            if not pressures.known:
                return None
            found = describe_contacts(node, skin, pressures, skin.find(pressures))
        except EskinError as error:
            log.warning("contacts cannot be found: node=%s reason=%s", node, error)
            return None
        return dump(found).decode()
