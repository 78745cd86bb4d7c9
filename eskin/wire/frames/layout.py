"""A layout: the patches of a skin, on which pages their frames are, and where they meet."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Final, NamedTuple, Self

from eskin.errors import MessageError
from eskin.wire.frames.content_hash import HASH_BYTES, content_hash
from eskin.wire.frames.patch import (
    FARTHEST,
    Pairs,
    read_differences,
    read_pairs,
    require_pairs,
    write_differences,
    write_pairs,
)
from eskin.wire.messages.cbor_map import MOST_BYTES, Fields, dump, integer, load, row, text
from eskin.wire.messages.header import Kind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin.wire.frames.patch import Patch

MOST_PATCHES: Final = 2000
MOST_PAGES: Final = 256
_MOST_SEAMS: Final = 4 * MOST_PATCHES
_MOST_CONTROLLERS: Final = 64
_MOST_LINES: Final = 16
_MOST_POINTS: Final = 500
_FIELDS: Final = frozenset(range(1, 7))


class Seam(NamedTuple):
    """Neighbours in two patches.

    Attributes:
        first: Number of the patch of the pairs' first columns.
        second: Number of the other patch, which is greater.
        pairs: A column of each.
    """

    first: int
    second: int
    pairs: Pairs


class Controller(NamedTuple):
    """A machine that samples some pages of a skin on its own clock.

    Attributes:
        node: Its name.
        pages: How many; the controllers have the pages one after the other.
    """

    node: str
    pages: int


class ClosedLine(NamedTuple):
    """A line on the map of the taxels' positions, whose last point is joined to its first one.

    Attributes:
        x: Of its points, in um.
        y: The same.
    """

    x: tuple[int, ...]
    y: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Layout:
    """What frames are read by; it is named by `content_hash`.

    Attributes:
        patches: Hash of each patch's description; patch k is the k-th.
        pages: How many patches each page has, one after the other. A frame holds one page. The
            patches of a page have one privacy class and one subject.
        seams: Neighbours that are in different patches, ascending.
        controllers: The machines; empty where the node that states it is the only one.
        outline: Closed lines by which to draw the skin: a hand's, for example.

    Raises:
        MessageError: The parts do not fit each other.
    """

    patches: tuple[bytes, ...]
    pages: tuple[int, ...]
    seams: tuple[Seam, ...] = ()
    controllers: tuple[Controller, ...] = ()
    outline: tuple[ClosedLine, ...] = ()

    def __post_init__(self) -> None:
        if not 1 <= len(self.patches) <= MOST_PATCHES:
            raise MessageError(f"field 2 has {len(self.patches)} hashes; allowed: {MOST_PATCHES}")
        if len(set(self.patches)) < len(self.patches):
            raise MessageError("field 2 names a patch twice")
        if sum(self.pages) != len(self.patches):
            raise MessageError(
                f"field 3 has pages for {sum(self.pages)} patches; there are {len(self.patches)}"
            )
        if any((a.first, a.second) >= (b.first, b.second) for a, b in pairwise(self.seams)):
            raise MessageError("field 4 names two patches twice, or not in ascending order")
        for seam in self.seams:
            if not seam.first < seam.second < len(self.patches):
                raise MessageError(f"field 4 names patches {seam[:2]}; expected two, ascending")
            require_pairs(seam.pairs, (64, 64), "field 4")
        assigned = sum(each.pages for each in self.controllers)
        if self.controllers and assigned != len(self.pages):
            raise MessageError(f"field 5 has {assigned} pages; there are {len(self.pages)}")
        for line in self.outline:
            if len(line.x) != len(line.y) or len(line.x) < 3:
                raise MessageError(
                    f"field 6 has a line with {len(line.x)} x and {len(line.y)} y; expected as "
                    "many, 3 at least"
                )

    @property
    def content_hash(self) -> bytes:
        """What names this layout."""
        return content_hash(self.encode())

    def page_range(self, page: int) -> range:
        """The numbers of a page's patches.

        Raises:
            MessageError: There is no such page.
        """
        if not 0 <= page < len(self.pages):
            raise MessageError(f"page is {page}; the layout has {len(self.pages)}")
        end = list(accumulate(self.pages))[page]
        return range(end - self.pages[page], end)

    def require_patches(self, patches: Sequence[Patch]) -> None:
        """Check that descriptions are those of this layout, and fit it.

        Raises:
            MessageError: A hash is another one, a page has two privacy classes or subjects, two
                patches have one ``patch_id`` or channel, or a seam names a column that is missing.
        """
        if tuple(patch.content_hash for patch in patches) != self.patches:
            raise MessageError("the patches are not those that the layout names")
        channels = [channel for patch in patches for channel in patch.channels]
        for names in ([patch.patch_id for patch in patches], channels):
            if len(set(names)) < len(names):
                raise MessageError("two patches of the layout have one id or one channel")
        for page in range(len(self.pages)):
            of_page = [patches[k] for k in self.page_range(page)]
            if len({(patch.privacy, patch.subject) for patch in of_page}) > 1:
                raise MessageError(f"page {page} has patches of two privacy classes or subjects")
        for seam in self.seams:
            columns = len(patches[seam.first].taxels), len(patches[seam.second].taxels)
            require_pairs(seam.pairs, columns, "field 4")

    def encode(self) -> bytes:
        """Write as CBOR.

        Raises:
            MessageError: It is longer than a message may be.
        """
        seams = [[each.first, each.second, write_pairs(each.pairs)] for each in self.seams]
        machines = [[each.node, each.pages] for each in self.controllers]
        lines = [[write_differences(axis) for axis in each] for each in self.outline]
        data = dump(
            {1: int(Kind.LAYOUT), 2: b"".join(self.patches), 3: list(self.pages)}
            | ({4: seams} if seams else {})
            | ({5: machines} if machines else {})
            | ({6: lines} if lines else {})
        )
        if len(data) > MOST_BYTES:
            raise MessageError(f"layout of {len(data)} bytes; at most {MOST_BYTES} are allowed")
        return data

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Read a layout.

        Raises:
            MessageError: It is none.
        """
        return cls.read(load(data))

    @classmethod
    def read(cls, fields: Fields) -> Self:
        """Read a layout from its decoded fields."""
        fields.only(_FIELDS)
        fields.integer(1, Kind.LAYOUT, Kind.LAYOUT)
        hashes = fields.octets(2, HASH_BYTES, HASH_BYTES * MOST_PATCHES)
        if len(hashes) % HASH_BYTES:
            raise MessageError(f"field 2 has {len(hashes)} bytes; expected {HASH_BYTES} a patch")
        return cls(
            patches=tuple(hashes[k : k + HASH_BYTES] for k in range(0, len(hashes), HASH_BYTES)),
            pages=tuple(
                integer(each, "field 3", 1, MOST_PATCHES) for each in fields.items(3, MOST_PAGES)
            ),
            seams=tuple(_seam(each) for each in fields.optional_items(4, _MOST_SEAMS)),
            controllers=tuple(
                _controller(each) for each in fields.optional_items(5, _MOST_CONTROLLERS)
            ),
            outline=tuple(_line(each) for each in fields.optional_items(6, _MOST_LINES)),
        )


def _seam(value: object) -> Seam:
    first, second, pairs = row(value, "field 4", 3)
    return Seam(
        integer(first, "field 4", 0, MOST_PATCHES - 1),
        integer(second, "field 4", 0, MOST_PATCHES - 1),
        read_pairs(pairs, "field 4"),
    )


def _controller(value: object) -> Controller:
    node, pages = row(value, "field 5", 2)
    return Controller(text(node, "field 5", 63), integer(pages, "field 5", 1, MOST_PAGES))


def _line(value: object) -> ClosedLine:
    x, y = (
        read_differences(axis, "field 6", -FARTHEST, FARTHEST, count=_MOST_POINTS)
        for axis in row(value, "field 6", 2)
    )
    return ClosedLine(x, y)
