"""Descriptions of frames, by node and hash: patches and layouts as their node stated them.

A hash names one description (`eskin.wire.frames.content_hash`), so decoded ones are shared by all
readers and nodes of a process.
"""

from __future__ import annotations

from threading import Lock
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from cachetools import FIFOCache, LRUCache
from sqlalchemy import and_, delete, func, insert, select

from eskin.errors import MessageError, StoreError
from eskin.wire.frames import (
    Controller,
    DescribedLayout,
    Layout,
    Patch,
    Privacy,
    content_hash,
)
from eskin.wire.messages.cbor_map import load
from eskin.wire.messages.header import Kind
from eskin_cloud.store.damage import report_damaged
from eskin_cloud.store.row_digests import intact_rows
from eskin_cloud.store.schema.frame_tables import descriptions
from eskin_cloud.store.slot import slot_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sqlalchemy import Connection

MOST_DESCRIPTIONS: Final = 20_000
"""Of a node: each costs a row that is never deleted."""
_CACHE_BYTES: Final = 128 << 20
_MOST_REFUSED: Final = 10_000
_DECODED: Final = 32
"""Bytes of memory that a byte of a description takes when it is decoded, at most."""


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
        biometric: 1 for a patch of biometric channels.
    """

    kind: str
    hash: bytes
    data: bytes
    biometric: int = 0


class Share(NamedTuple):
    """What one node samples of a skin.

    Attributes:
        node: The node.
        patches: Their numbers in the layout.
        stated: Whether that node stated this layout itself: else its frames are not of this skin.
    """

    node: str
    patches: range
    stated: bool


class _Decoded(NamedTuple):
    value: Any
    size: int


_patches: Final[LRUCache[bytes, _Decoded]] = LRUCache(_CACHE_BYTES, lambda each: each.size)
_layouts: Final[LRUCache[bytes, _Decoded]] = LRUCache(_CACHE_BYTES, lambda each: each.size)
_refused: Final[FIFOCache[tuple[str, bytes], str]] = FIFOCache(_MOST_REFUSED)
_lock: Final = Lock()


def read_description(data: bytes) -> Description:
    """Read a patch or a layout that may be stored.

    Raises:
        MessageError: It is neither.
    """
    kind = load(data).integer(1, Kind.PATCH, Kind.LAYOUT)
    described = Layout.decode(data) if kind == Kind.LAYOUT else Patch.decode(data)
    if described.encode() != data:
        raise MessageError("description is not written as it would be written again")
    biometric = isinstance(described, Patch) and described.privacy is Privacy.BIOMETRIC
    return Description(Kind(kind).name.lower(), content_hash(data), data, int(biometric))


def store_descriptions(
    connection: Connection, node: str, presented: Sequence[Description]
) -> list[str]:
    """Store a node's descriptions, as far as it may have more. Damaged rows are replaced.

    Args:
        connection: The writer's, in a transaction.
        node: The node that stated them.
        presented: The descriptions.

    Returns:
        For each ``stored``, ``duplicate`` or ``rejected``; the same for the same one.
    """
    found = find_descriptions(connection, node, (each.hash for each in presented))
    fresh = {each.hash: each for each in presented if each.hash not in found}
    if not fresh:
        return ["duplicate"] * len(presented)
    d, slot = descriptions.c, slot_of(node)
    here = and_(d.slot == slot, d.node == node)
    connection.execute(delete(descriptions).where(here, d.hash.in_(fresh)))
    count = select(func.count()).select_from(descriptions).where(here)
    room = max(0, MOST_DESCRIPTIONS - connection.execute(count).scalar_one())
    rows = [{"slot": slot, "node": node, **each._asdict()} for each in fresh.values()]
    if room:
        connection.execute(insert(descriptions), rows[:room])
    results = dict.fromkeys(found, "duplicate")
    results |= dict.fromkeys(list(fresh)[:room], "stored")
    results |= dict.fromkeys(list(fresh)[room:], "rejected")
    return [results[each.hash] for each in presented]


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


def refuse_description(node: str, name: bytes, reason: str) -> None:
    """Remember, until the process ends, that a description cannot be stored, and why.

    Else a gateway would present it without end for the messages that need it.
    """
    with _lock:
        _refused[node, name] = reason


def find_refusal(node: str, names: Iterable[bytes]) -> str | None:
    """Why one of a node's descriptions cannot be stored; ``None`` if all may yet come."""
    with _lock:
        return next((_refused[node, name] for name in names if (node, name) in _refused), None)


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
    """Check that this node stated a layout and its patches.

    Raises:
        UnknownDescriptionError: It did not.
    """
    names = (described.hash, *described.layout.patches)
    found = find_descriptions(connection, node, names)
    want = [name for name in names if name not in found]
    if want:
        raise UnknownDescriptionError(node, want)


def find_shares(connection: Connection, node: str, described: DescribedLayout) -> list[Share]:
    """Which nodes sample the patches of a layout, in its order.

    Args:
        connection: Any.
        node: A node that stated it; it samples all where the layout names no controllers.
        described: The layout.
    """
    layout, found, page = described.layout, [], 0
    for controller in layout.controllers or (Controller(node, len(layout.pages)),):
        own = described.page_ranges[page : page + controller.pages]
        page += controller.pages
        stated = controller.node == node or described.hash in find_descriptions(
            connection, controller.node, [described.hash]
        )
        found.append(Share(controller.node, range(own[0].start, own[-1].stop), stated))
    return found


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
