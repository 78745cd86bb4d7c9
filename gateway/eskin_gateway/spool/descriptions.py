"""Patches and layouts of nodes: each spooled frame is named with what it is read by.

A description is kept by its node and its hash. A node may have so many; then the oldest are evicted
that no message in the spool needs.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from eskin.errors import MessageError
from eskin.privacy import is_biometric
from eskin.wire.frames import Layout, Patch, Privacy, content_hash
from eskin_gateway.spool.batch import Description

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from numpy.typing import NDArray

    from eskin.wire.frames import FrameSummary, Statements
    from eskin_gateway.spool.batch import Batch
    from eskin_gateway.spool.spool import Spool

MOST_BYTES: Final = 16_777_216
"""Of the descriptions of one node: two of the largest skins."""
MOST: Final = 8192
"""Descriptions of one node."""
_MOST_CHANNELS: Final = 500_000
"""Of all skins in memory, some 100 bytes each."""
_MAX_NODES: Final = 4096
_BIOMETRIC: Final = "holds biometric patches; sealed frames are not supported yet"


@dataclass(frozen=True, eq=False)
class Skin:
    """A layout with its patches.

    Attributes:
        layout: By which frames are read.
        patches: Its patches, in its order.
        biometric: Numbers of the patches whose samples are data about a person.
        channels: How many channels all patches have.
    """

    layout: Layout
    patches: tuple[Patch, ...]
    biometric: frozenset[int]
    channels: int

    @classmethod
    def join(cls, layout: Layout, patches: Sequence[Patch]) -> Self:
        """Join a layout and its patches.

        Raises:
            MessageError: They do not fit.
        """
        layout.require_patches(patches)
        biometric = frozenset(k for k, patch in enumerate(patches) if _is_biometric(patch))
        return cls(layout, tuple(patches), biometric, sum(len(each.taxels) for each in patches))

    def public_patches(self, node: str) -> list[Patch]:
        """The patches that a node samples and whose samples are not data about a person."""
        owners = [c.node for c in self.layout.controllers for _ in range(c.pages)]
        return [
            self.patches[number]
            for page in range(len(self.layout.pages))
            if not owners or owners[page] == node
            for number in self.layout.page_range(page)
            if number not in self.biometric
        ]

    @cached_property
    def columns(self) -> NDArray[np.int64]:
        """How many columns each patch has."""
        return np.array([len(patch.taxels) for patch in self.patches])

    @cached_property
    def ends(self) -> tuple[int, ...]:
        """For each page, the number of the first patch after it."""
        return tuple(accumulate(self.layout.pages))

    @cached_property
    def _shares_errors(self) -> NDArray[np.bool_]:
        return np.array([bool(patch.alpha) for patch in self.patches])

    def require_frame(self, frame: FrameSummary) -> None:
        """Check that a frame fits, as `Frame.require_layout` does, and that none is biometric.

        Raises:
            MessageError: It does not, or some is.
        """
        if frame.page >= len(self.ends):
            raise MessageError(f"page is {frame.page}; the layout has {len(self.ends)}")
        numbers, end = frame.records["patch"], self.ends[frame.page]
        if numbers[0] < end - self.layout.pages[frame.page] or numbers[-1] >= end:
            raise MessageError(
                f"patches {numbers[0]} to {numbers[-1]} are not all on page {frame.page}"
            )
        for wrong, what in (
            (frame.records["columns"] != self.columns[numbers], "another number of columns"),
            ((frame.records["epoch"] > 0) & ~self._shares_errors[numbers], "no shared error"),
        ):
            if wrong.any():
                number = numbers[np.flatnonzero(wrong)[0]]
                raise MessageError(f"patch {number} has {what} by its description")
        if self.biometric and not self.biometric.isdisjoint(numbers.tolist()):
            raise MessageError(_BIOMETRIC)

    def require_statements(self, message: Statements) -> None:
        """Check that statements fit, and that none is on biometric patches.

        Raises:
            MessageError: They do not, or one is.
        """
        self._require_named(message)
        # A contact and a monitor may be of any patch.
        if any(peak.patch in self.biometric for peak in message.peaks) or (
            self.biometric and (message.contacts or message.verdicts)
        ):
            raise MessageError(_BIOMETRIC)

    def _require_named(self, message: Statements) -> None:
        named = [peak.patch for peak in message.peaks]
        named += [number for gap in message.gaps for number in gap.patches]
        if named and max(named) >= len(self.patches):
            raise MessageError(
                f"patch {max(named)} is named; the layout has {len(self.patches)} patches"
            )
        for peak in message.peaks:
            columns = len(self.patches[peak.patch].taxels)
            if peak.column >= columns:
                raise MessageError(
                    f"column {peak.column} of patch {peak.patch} is named; it has {columns}"
                )


class Descriptions:
    """The descriptions of all nodes, read from the spool on first use. Not thread-safe.

    Args:
        spool: Where they are durable.
        most_bytes: Most bytes of one node.
        most: Most descriptions of one node.
    """

    def __init__(self, spool: Spool, *, most_bytes: int = MOST_BYTES, most: int = MOST) -> None:
        self._spool = spool
        self._most_bytes = most_bytes
        self._most = most
        self._sizes: OrderedDict[str, dict[bytes, int]] = OrderedDict()
        self._skins: OrderedDict[tuple[str, bytes], Skin | str] = OrderedDict()
        self._channels = 0
        self._added: dict[tuple[str, bytes], bytes] = {}
        self._evicted: list[tuple[str, bytes]] = []
        self._used: set[tuple[str, bytes]] = set()

    def add(self, node: str, body: bytes) -> None:
        """Keep a description.

        Raises:
            MessageError: The node has too many that messages in the spool need.
            SpoolError: The spool cannot be read.
        """
        name = content_hash(body)
        sizes = self._of(node)
        if name in sizes and self._body(node, name) is not None:
            return
        sizes.pop(name, None)
        if not self._has_room(sizes, len(body)):
            self._evict(node, sizes, len(body))
        if not self._has_room(sizes, len(body)):
            raise MessageError(
                f"node has {len(sizes)} descriptions of {sum(sizes.values())} bytes that messages "
                f"in the spool need; at most {self._most} of {self._most_bytes} bytes are kept"
            )
        sizes[name] = len(body)
        self._added[node, name] = body

    def find(self, node: str, layout: bytes) -> Skin | tuple[bytes, ...]:
        """Find a layout of a node with its patches.

        Returns:
            The skin, or the hashes of what is missing.

        Raises:
            MessageError: The layout and its patches do not fit.
            SpoolError: The spool cannot be read.
        """
        key = node, layout
        found = self._skins.get(key) or self._read(node, layout)
        if isinstance(found, tuple):
            return found
        if key not in self._skins:
            self._keep(key, found)
        self._skins.move_to_end(key)
        if isinstance(found, str):
            raise MessageError(found)
        return found

    def latest(self, node: str) -> Skin | None:
        """The skin of the node's latest message in the spool, if the spool has all of it.

        Raises:
            SpoolError: The spool cannot be read.
        """
        layout = self._spool.latest_layout(node)
        try:
            found = () if layout is None else self.find(node, layout)
        except MessageError:
            return None
        return found if isinstance(found, Skin) else None

    def use(self, node: str, layout: bytes) -> None:
        """Note that a message of the next commit needs a layout."""
        self._used.add((node, layout))

    def fill(self, batch: Batch) -> None:
        """Add what the next commit must write."""
        batch.descriptions = [Description(*key, body) for key, body in self._added.items()]
        batch.evicted = list(self._evicted)
        batch.layouts = set(self._used)

    def committed(self) -> None:
        """Note that all that `fill` added is durable."""
        self._added.clear()
        self._evicted.clear()
        self._used.clear()
        while len(self._sizes) > _MAX_NODES:
            self._sizes.popitem(last=False)

    def reset(self) -> None:
        """Drop what is in memory after a failed commit."""
        self.committed()
        self._sizes.clear()
        self._skins.clear()
        self._channels = 0

    def _of(self, node: str) -> dict[bytes, int]:
        sizes = self._sizes.get(node)
        if sizes is None:
            sizes = self._sizes[node] = self._spool.description_sizes(node)
        self._sizes.move_to_end(node)
        return sizes

    def _body(self, node: str, name: bytes) -> bytes | None:
        return self._added.get((node, name)) or self._spool.description(node, name)

    def _read(self, node: str, name: bytes) -> Skin | str | tuple[bytes, ...]:
        """The skin, or why it cannot be read, or what is missing."""
        body = self._body(node, name)
        if body is None:
            return (name,)
        try:
            layout = Layout.decode(body)
            sizes = self._of(node)
            missing = tuple(each for each in layout.patches if each not in sizes)
            if missing:
                return missing
            bodies = {each: self._body(node, each) for each in layout.patches}
            missing = tuple(each for each, found in bodies.items() if found is None)
            if missing:
                return missing
            return Skin.join(layout, [Patch.decode(found) for found in bodies.values() if found])
        except MessageError as error:
            return f"layout {name.hex()}: {error}"

    def _keep(self, key: tuple[str, bytes], found: Skin | str) -> None:
        self._skins[key] = found
        self._channels += _size(found)
        while self._channels > _MOST_CHANNELS and len(self._skins) > 1:
            _, dropped = self._skins.popitem(last=False)
            self._channels -= _size(dropped)

    def _has_room(self, sizes: dict[bytes, int], size: int) -> bool:
        return len(sizes) < self._most and sum(sizes.values()) + size <= self._most_bytes

    def _evict(self, node: str, sizes: dict[bytes, int], size: int) -> None:
        """Evict the oldest that are not needed, a quarter of all that a node may have."""
        needed = self._needed(node)
        count, used = len(sizes), sum(sizes.values())
        for name in [each for each in sizes if each not in needed]:
            if count < self._most * 3 // 4 and used + size <= self._most_bytes * 3 // 4:
                break
            count, used = count - 1, used - sizes.pop(name)
            self._added.pop((node, name), None)
            self._evicted.append((node, name))
        for key in [key for key in self._skins if key[0] == node]:
            self._channels -= _size(self._skins.pop(key))

    def _needed(self, node: str) -> Collection[bytes]:
        """Layouts that messages in the spool or in the next commit name, and their patches."""
        layouts = set(self._spool.layouts_in_use(node))
        layouts |= {layout for used, layout in self._used if used == node}
        needed = set(layouts)
        for layout in layouts:
            body = self._body(node, layout)
            if body is not None:
                needed.update(Layout.decode(body).patches)
        return needed


def _is_biometric(patch: Patch) -> bool:
    """By its privacy class or, as everywhere, by its channels' names."""
    return patch.privacy is Privacy.BIOMETRIC or any(map(is_biometric, patch.channels))


def _size(found: Skin | str) -> int:
    return found.channels if isinstance(found, Skin) else 1
