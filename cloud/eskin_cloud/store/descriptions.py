"""Descriptions of frames, by node and hash: patches and layouts as their node stated them.

A hash names one description (`eskin.wire.frames.content_hash`), so decoded ones are shared by all
readers and nodes of a process.
"""

from __future__ import annotations

from threading import Lock
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

from cachetools import FIFOCache, LRUCache
from sqlalchemy import delete, func, insert, select, tuple_

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
from eskin.wire.slot import key_of, slot_of
from eskin_cloud.store.damage import report_damaged
from eskin_cloud.store.key_batches import key_batches
from eskin_cloud.store.row_digests import intact_rows
from eskin_cloud.store.schema.frame_tables import descriptions
from eskin_cloud.store.schema.node_key import of_node

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sqlalchemy import Connection

MOST_DESCRIPTIONS: Final = 20_000
"""Of a node: each costs a row that is never deleted."""
_CACHE_BYTES: Final = 128 << 20
_MOST_REFUSED: Final = 10_000
_READ_AT_ONCE: Final = 1000
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


DescriptionKey: TypeAlias = tuple[str, bytes]
"""A node, and the hash of a description that it stated."""
LayoutResult: TypeAlias = DescribedLayout | UnknownDescriptionError | MessageError
"""A layout, or why there is none."""


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


class SkinShare(NamedTuple):
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
    d = descriptions.c
    here = of_node(descriptions, node)
    connection.execute(delete(descriptions).where(here, d.hash.in_(fresh)))
    count = select(func.count()).select_from(descriptions).where(here)
    room = max(0, MOST_DESCRIPTIONS - connection.execute(count).scalar_one())
    rows = [{"slot": slot_of(node), "node": node, **each._asdict()} for each in fresh.values()]
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
        hashes: Their hashes.
    """
    found = _find_stated(connection, ((node, name) for name in hashes))
    return {name: data for (_, name), data in found.items()}


def _find_stated(
    connection: Connection, named: Iterable[DescriptionKey]
) -> dict[DescriptionKey, bytes]:
    """The bytes of descriptions by node and hash, in few statements.

    Missing and damaged ones are left out. Nodes that state the same share the bytes.
    """
    d, whole = descriptions.c, dict[bytes, bytes]()
    key, found = tuple_(d.slot, d.node, d.hash), dict[DescriptionKey, bytes]()
    keys = [(*key_of(node), name) for node, name in dict.fromkeys(named)]
    for part in key_batches(keys, _READ_AT_ONCE):
        rows = connection.execute(select(descriptions).where(key.in_(part))).mappings()
        for row in intact_rows(connection, descriptions, rows):
            if content_hash(row["data"]) == row["hash"]:
                data = whole.setdefault(row["hash"], row["data"])
                found[row["node"], row["hash"]] = data
            else:
                report_damaged(descriptions.name, f"{row['node']} {row['hash'].hex()}")
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
    described = _cached_layout(name)
    if described is None:
        data = find_descriptions(connection, node, [name]).get(name)
        if data is None:
            raise UnknownDescriptionError(node, [name])
        layout = Layout.decode(data)
        described = _describe(layout, data, _find_patches(connection, node, layout.patches))
    return described


def find_intact_layout(connection: Connection, node: str, name: bytes) -> DescribedLayout | None:
    """The same; ``None`` if a part of it is missing or damaged, which is reported."""
    try:
        return find_layout(connection, node, name)
    except (UnknownDescriptionError, MessageError):
        return None


def find_stated_layout(connection: Connection, node: str, name: bytes) -> DescribedLayout:
    """A layout of which this node itself stated each part, by its hash.

    Raises:
        UnknownDescriptionError: The node did not state all of them.
        MessageError: The patches do not fit the layout.
    """
    found = find_stated_layouts(connection, [(node, name)])[node, name]
    if isinstance(found, Exception):
        raise found
    return found


def find_stated_layouts(
    connection: Connection, named: Iterable[DescriptionKey]
) -> dict[DescriptionKey, LayoutResult]:
    """Layouts of which the nodes themselves stated each part, in few statements.

    Args:
        connection: Any.
        named: Nodes with the hashes of their layouts.

    Returns:
        Each with its patches, or the error that `find_stated_layout` raises.
    """
    keys = list(dict.fromkeys(named))
    stated = _find_stated(connection, keys)
    known = {name: each for _, name in keys if (each := _cached_layout(name)) is not None}
    layouts = {name: described.layout for name, described in known.items()}
    for (_, name), data in stated.items():
        if name not in layouts:
            layouts[name] = Layout.decode(data)
    parts = [
        (node, part) for node, name in keys if name in layouts for part in layouts[name].patches
    ]
    stated |= _find_stated(connection, parts)
    found: dict[DescriptionKey, LayoutResult] = {}
    for node, name in keys:
        names = (name, *layouts[name].patches) if name in layouts else (name,)
        want = [each for each in names if (node, each) not in stated]
        if want:
            found[node, name] = UnknownDescriptionError(node, want)
            continue
        try:
            if name not in known:
                patches = [_decode_patch(each, stated[node, each]) for each in names[1:]]
                known[name] = _describe(layouts[name], stated[node, name], patches)
            found[node, name] = known[name]
        except MessageError as error:
            found[node, name] = error
    return found


def find_shares(connection: Connection, node: str, described: DescribedLayout) -> list[SkinShare]:
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
        found.append(SkinShare(controller.node, range(own[0].start, own[-1].stop), stated))
    return found


def _cached_layout(name: bytes) -> DescribedLayout | None:
    cached = _cached(_layouts, name)
    return None if cached is None else cached.value


def _describe(layout: Layout, data: bytes, patches: Sequence[_Decoded]) -> DescribedLayout:
    """A layout with its patches, kept for later.

    Raises:
        MessageError: The patches do not fit the layout.
    """
    described = DescribedLayout.of(layout, [each.value for each in patches])
    size = _DECODED * len(data) + sum(each.size for each in patches)
    _keep(_layouts, described.hash, _Decoded(described, size))
    return described


def _find_patches(connection: Connection, node: str, names: Sequence[bytes]) -> list[_Decoded]:
    with _lock:
        found = {name: _patches[name] for name in names if name in _patches}
    want = [name for name in names if name not in found]
    if want:
        rows = find_descriptions(connection, node, want)
        found |= {name: _decode_patch(name, data) for name, data in rows.items()}
        want = [name for name in want if name not in found]
    if want:
        raise UnknownDescriptionError(node, want)
    return [found[name] for name in names]


def _decode_patch(name: bytes, data: bytes) -> _Decoded:
    decoded = _cached(_patches, name)
    if decoded is None:
        decoded = _Decoded(Patch.decode(data), _DECODED * len(data))
        _keep(_patches, name, decoded)
    return decoded


def _cached(cache: LRUCache[bytes, _Decoded], name: bytes) -> _Decoded | None:
    with _lock:
        return cache.get(name)


def _keep(cache: LRUCache[bytes, _Decoded], name: bytes, decoded: _Decoded) -> None:
    if decoded.size <= cache.maxsize:
        with _lock:
            cache[name] = decoded
