"""Descriptions of frames, by node and hash: patches and layouts as their node stated them.

A hash names one description (`eskin.wire.frames.content_hash`), so decoded ones are shared by all
readers and nodes of a process.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from threading import Lock
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Self

import numpy as np
from cachetools import LRUCache
from sqlalchemy import and_, delete, func, insert, select

from eskin.errors import MessageError, StoreError
from eskin.privacy import is_biometric
from eskin.wire.frames import Layout, Patch, Privacy, content_hash
from eskin.wire.messages.cbor_map import load
from eskin.wire.messages.header import Kind
from eskin_cloud.store.damage import report_damaged
from eskin_cloud.store.row_digests import intact_rows
from eskin_cloud.store.schema.frame_tables import descriptions
from eskin_cloud.store.slot import slot_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray
    from sqlalchemy import Connection

    from eskin.wire.frames import FrameSummary

MOST_DESCRIPTIONS: Final = 20_000
"""Of a node: each costs a row that is never deleted."""
_CACHE_BYTES: Final = 64 << 20
_DECODED: Final = 16
"""Bytes of memory that a byte of a description takes when it is decoded, at most."""
_BIOMETRIC: Final = (
    "patch of biometric channels: sealed frames are not supported yet; send only public patches"
)


class UnknownDescriptionError(StoreError):
    """The store lacks descriptions.

    Attributes:
        want: Their hashes.
    """

    def __init__(self, node: str, want: Sequence[bytes]) -> None:
        self.want = tuple(want)
        super().__init__(
            f"{node}: the cloud lacks {len(self.want)} of the descriptions by which this is read, "
            f"first {self.want[0].hex()}; present them, then send the message again"
        )


class Description(NamedTuple):
    """A patch or a layout that a node stated.

    Attributes:
        kind: ``patch`` or ``layout``.
        hash: SHA-256 of ``data``.
        data: Its bytes.
    """

    kind: str
    hash: bytes
    data: bytes


@dataclass(frozen=True, eq=False)
class DescribedLayout:
    """A layout with its patches.

    Attributes:
        hash: The layout's.
        layout: The layout.
        patches: Its patches, in its order.
    """

    hash: bytes
    layout: Layout
    patches: tuple[Patch, ...]

    @classmethod
    def of(cls, layout: Layout, patches: Sequence[Patch]) -> Self:
        """A layout whose patches fit it.

        Raises:
            MessageError: They do not.
        """
        layout.require_patches(patches)
        return cls(layout.content_hash, layout, tuple(patches))

    @cached_property
    def places(self) -> Mapping[str, tuple[int, int]]:
        """Number of the patch and the column, by channel."""
        return {
            channel: (number, column)
            for number, patch in enumerate(self.patches)
            for column, channel in enumerate(patch.channels)
        }

    @cached_property
    def units(self) -> dict[str, str]:
        """The unit, by channel."""
        return {channel: each.unit for each in self.patches for channel in each.channels}

    @cached_property
    def columns(self) -> NDArray[np.int64]:
        """Number of each patch's columns."""
        return np.array([len(each.taxels) for each in self.patches])

    @cached_property
    def shares_errors(self) -> NDArray[np.bool_]:
        """Whether each patch's samples have shared errors."""
        return np.array([bool(each.alpha) for each in self.patches])

    @cached_property
    def least_skew(self) -> NDArray[np.int64]:
        """Least skew of each patch's columns, ns."""
        return np.array([min(each.skew, default=0) for each in self.patches])

    @cached_property
    def most_skew(self) -> NDArray[np.int64]:
        """Greatest skew of each patch's columns, ns."""
        return np.array([max(each.skew, default=0) for each in self.patches])

    @cached_property
    def ends(self) -> tuple[int, ...]:
        """For each page, the number of the first patch after it."""
        return tuple(accumulate(self.layout.pages))

    def require_frame(self, frame: FrameSummary) -> None:
        """Check that a frame fits, as `eskin.wire.frames.Frame.require_layout` does.

        Raises:
            MessageError: It does not.
        """
        if frame.page >= len(self.ends):
            raise MessageError(f"page is {frame.page}; the layout has {len(self.ends)}")
        records, end = frame.records, self.ends[frame.page]
        patches = records["patch"]
        if patches[0] < end - self.layout.pages[frame.page] or patches[-1] >= end:
            raise MessageError(
                f"patches {patches[0]} to {patches[-1]} are not all on page {frame.page}"
            )
        wrong = records["columns"] != self.columns[patches]
        if wrong.any():
            at = wrong.argmax()
            raise MessageError(
                f"patch {patches[at]} has {records['columns'][at]} columns, "
                f"not {self.columns[patches[at]]}"
            )
        alone = (records["epoch"] > 0) & ~self.shares_errors[patches]
        if alone.any():
            raise MessageError(f"patch {patches[alone.argmax()]} has an epoch, but no shared error")


class _Decoded(NamedTuple):
    value: Any
    size: int


_patches: Final[LRUCache[bytes, _Decoded]] = LRUCache(_CACHE_BYTES, lambda each: each.size)
_layouts: Final[LRUCache[bytes, _Decoded]] = LRUCache(_CACHE_BYTES, lambda each: each.size)
_lock: Final = Lock()


def read_description(data: bytes) -> Description:
    """Read a patch or a layout that may be stored.

    Raises:
        MessageError: It is neither, or it is a patch of biometric channels.
    """
    kind = load(data).integer(1, Kind.PATCH, Kind.LAYOUT)
    if kind == Kind.LAYOUT:
        again = Layout.decode(data).encode()
    else:
        patch = Patch.decode(data)
        if patch.privacy is Privacy.BIOMETRIC or any(map(is_biometric, patch.channels)):
            raise MessageError(_BIOMETRIC)
        again = patch.encode()
    if again != data:
        raise MessageError("description is not written as it would be written again")
    return Description(Kind(kind).name.lower(), content_hash(data), data)


def store_description(connection: Connection, node: str, each: Description) -> bool:
    """Store a description; returns whether it is new. A damaged row is replaced.

    Args:
        connection: The writer's, in a transaction.
        node: The node that stated it.
        each: The description.

    Raises:
        MessageError: The node has too many.
    """
    if find_descriptions(connection, node, [each.hash]):
        return False
    d, slot = descriptions.c, slot_of(node)
    here = and_(d.slot == slot, d.node == node)
    count = select(func.count()).select_from(descriptions).where(here)
    if connection.execute(count).scalar_one() >= MOST_DESCRIPTIONS:
        raise MessageError(
            f"{node} has {MOST_DESCRIPTIONS} descriptions; use those that it has, or another node"
        )
    connection.execute(delete(descriptions).where(here, d.hash == each.hash))
    row = {"slot": slot, "node": node, **each._asdict()}
    connection.execute(insert(descriptions), row)
    return True


def find_descriptions(
    connection: Connection, node: str, hashes: Iterable[bytes]
) -> dict[bytes, bytes]:
    """The bytes of a node's descriptions by hash; missing and damaged ones are left out.

    Args:
        connection: Any.
        node: The node that stated them.
        hashes: At most those of a layout.
    """
    d, named = descriptions.c, set(hashes)
    if not named:
        return {}
    query = select(descriptions).where(d.slot == slot_of(node), d.node == node, d.hash.in_(named))
    rows = connection.execute(query).mappings()
    found: dict[bytes, bytes] = {}
    for row in intact_rows(connection, descriptions, rows):
        if content_hash(row["data"]) == row["hash"]:
            found[row["hash"]] = row["data"]
        else:
            report_damaged(descriptions.name, f"{node} {row['hash'].hex()}")
    return found


def find_patch(connection: Connection, node: str, name: bytes) -> Patch:
    """A patch by its hash.

    Raises:
        UnknownDescriptionError: The node stated no such patch.
    """
    found: Patch = _find_patches(connection, node, [name])[0].value
    return found


def find_layout(connection: Connection, node: str, name: bytes) -> DescribedLayout:
    """A layout with its patches, by its hash.

    Raises:
        UnknownDescriptionError: The node did not state all of them.
        MessageError: The patches do not fit the layout.
    """
    with _lock:
        cached = _layouts.get(name)
    if cached is None:
        data = find_descriptions(connection, node, [name]).get(name)
        if data is None:
            raise UnknownDescriptionError(node, [name])
        layout = Layout.decode(data)
        patches = _find_patches(connection, node, layout.patches)
        size = _DECODED * len(data) + sum(each.size for each in patches)
        cached = _Decoded(DescribedLayout.of(layout, [each.value for each in patches]), size)
        _keep(_layouts, name, cached)
    described: DescribedLayout = cached.value
    return described


def require_stated(connection: Connection, node: str, described: DescribedLayout) -> None:
    """Check that a node itself stated a layout and its patches, and not only another node.

    Raises:
        UnknownDescriptionError: It did not.
    """
    names = (described.hash, *described.layout.patches)
    found = find_descriptions(connection, node, names)
    want = [name for name in names if name not in found]
    if want:
        raise UnknownDescriptionError(node, want)


def _find_patches(connection: Connection, node: str, names: Sequence[bytes]) -> list[_Decoded]:
    with _lock:
        found = {name: _patches[name] for name in names if name in _patches}
    rows = find_descriptions(connection, node, [name for name in names if name not in found])
    for name, data in rows.items():
        found[name] = _Decoded(Patch.decode(data), _DECODED * len(data))
        _keep(_patches, name, found[name])
    want = [name for name in names if name not in found]
    if want:
        raise UnknownDescriptionError(node, want)
    return [found[name] for name in names]


def _keep(cache: LRUCache[bytes, _Decoded], name: bytes, decoded: _Decoded) -> None:
    if decoded.size <= cache.maxsize:
        with _lock:
            cache[name] = decoded
