"""How a skin is described: its taxels in patches, these on pages, and whose they are.

A patch is a compact tile of a surface: at most 8 × 8 cells of its flat map. Surfaces that no pair
of neighbours joins, as fingers and palm, share no patch.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.contacts.components import label_components
from eskin.errors import SettingsError
from eskin.wire.frames import Controller, Layout, Patch, Seam
from eskin.wire.frames.frame import frame_limit
from eskin.wire.messages.cbor_map import MOST_BYTES
from eskin_sensor_node.world.skin.skin import NO_NEIGHBOUR

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_sensor_node.world.skin import Skin
    from eskin_sensor_node.world.skin.skin import Indices

_SIDE: Final = 8
"""Cells of a tile's side, at most: 64 channels are the most of a patch."""
_MICRO: Final = 1e6


@dataclass(frozen=True, slots=True)
class PatchQuantity:
    """What all patches of a skin state alike.

    Attributes:
        name: The quantity.
        unit: Its UCUM code.
        least_width: Least width of a measured interval by design, in the unit.
        threshold: From which value on there is a contact.
    """

    name: str
    unit: str
    least_width: float
    threshold: float


@dataclass(frozen=True, slots=True)
class SkinPlan:
    """A skin as it is described.

    Attributes:
        layout: By which frames are read.
        patches: The descriptions that it names, in its order.
        tiles: Numbers of each patch's taxels, column by column.
        own: Numbers of the patches that this node samples.
    """

    layout: Layout
    patches: tuple[Patch, ...]
    tiles: tuple[Indices, ...]
    own: range


def plan_skin(
    skin: Skin, quantity: PatchQuantity, *, rows: int, controllers: Sequence[str], node: str
) -> SkinPlan:
    """Describe a skin.

    Args:
        skin: Where its taxels are.
        quantity: What is measured of each.
        rows: Samples of a taxel in a stretch, at most.
        controllers: The nodes that share it, in order; empty: one node has all of it.
        node: One of them, or the only node.

    Raises:
        SettingsError: It has more controllers than patches, or a patch fits no page.
    """
    tiles = tile(skin)
    shares = _shares([len(each) for each in tiles], max(len(controllers), 1))
    if not all(shares):
        raise SettingsError(
            "skin.controllers", f"{len(shares)} nodes share {len(tiles)} patches; use fewer nodes"
        )
    pages = [_pages([len(tiles[k]) for k in share], rows) for share in shares]
    patch_of, column_of = np.empty(len(skin), np.int64), np.empty(len(skin), np.int64)
    for number, each in enumerate(tiles):
        patch_of[each], column_of[each] = number, np.arange(len(each))
    inside, seams = _adjacency(skin, patch_of, column_of)
    digits = len(str(len(tiles) - 1))
    positions = np.rint(skin.unrolled * _MICRO).astype(np.int64)
    patches = tuple(
        Patch(
            patch_id=f"p{number:0{digits}d}",
            quantity=quantity.name,
            unit=quantity.unit,
            taxels=tuple(skin.names[k] for k in each.tolist()),
            least_width=quantity.least_width,
            positions=tuple(tuple(axis) for axis in positions[each].T.tolist()),
            neighbours=inside.get(number, ()),
            threshold=quantity.threshold,
            cell_area=skin.cell_area,
        )
        for number, each in enumerate(tiles)
    )
    layout = Layout(
        patches=tuple(patch.content_hash for patch in patches),
        pages=tuple(itertools.chain(*pages)),
        seams=seams,
        controllers=tuple(
            Controller(name, len(each)) for name, each in zip(controllers, pages, strict=False)
        ),
        outline=(skin.closed_line,),
    )
    own = shares[controllers.index(node)] if controllers else shares[0]
    return SkinPlan(layout, patches, tuple(tiles), own)


def tile(skin: Skin) -> list[Indices]:
    """Cut a skin into tiles of neighbouring taxels; gives the ascending numbers of each."""
    there = skin.neighbours != NO_NEIGHBOUR
    starts = np.concatenate([[0], np.cumsum(there.sum(axis=1))])
    surface = np.empty(len(skin), np.int64)
    everywhere = np.ones(len(skin), np.bool_)
    count = label_components(everywhere, starts, skin.neighbours[there], surface)
    found: list[Indices] = []
    for number in range(count):
        members = np.flatnonzero(surface == number)
        corner = skin.unrolled[members]
        cells = np.rint((corner - corner.min(axis=0)) / skin.pitch).astype(np.int64)
        sides = cells.max(axis=0) + 1
        # As many tiles as are needed, as equal as they can be.
        across, along = (cells * -(-sides // _SIDE) // sides).T
        keys = along * (across.max() + 1) + across
        found += [members[keys == key] for key in np.unique(keys)]
    return found


def _shares(sizes: Sequence[int], parts: int) -> list[range]:
    """Cut items into consecutive parts of about the same size."""
    ends = np.cumsum(sizes)
    middles = ends - np.asarray(sizes) / 2.0
    part = (middles * parts / ends[-1]).astype(np.int64)
    edges = np.searchsorted(part, np.arange(parts + 1)).tolist()
    return [range(begin, end) for begin, end in itertools.pairwise(edges)]


def _pages(sizes: Sequence[int], rows: int) -> list[int]:
    """How many patches each page has, as many as the greatest message allows.

    Raises:
        SettingsError: A page cannot hold even one patch.
    """
    pages: list[list[int]] = []
    for size in sizes:
        if not pages or frame_limit([*pages[-1], size], rows) > MOST_BYTES:
            pages.append([])
        pages[-1].append(size)
    if max(frame_limit(page, rows) for page in pages) > MOST_BYTES:
        raise SettingsError(
            "skin.stretch_ms",
            f"a patch of {max(sizes)} taxels with {rows} samples each fits no frame; use a shorter "
            "stretch",
        )
    # As equal as they can be, if that fits, too.
    even = [[sizes[k] for k in share] for share in _shares(sizes, len(pages))]
    if max(frame_limit(page, rows) for page in even) > MOST_BYTES or not all(even):
        even = pages
    return [len(page) for page in even]


def _adjacency(
    skin: Skin, patch_of: Indices, column_of: Indices
) -> tuple[dict[int, tuple[tuple[int, int], ...]], tuple[Seam, ...]]:
    """Neighbours within each patch, and those in two patches."""
    found: dict[tuple[int, int], set[tuple[int, int]]] = {}
    for taxel, around in enumerate(skin.neighbours.tolist()):
        for other in around:
            if other == NO_NEIGHBOUR:
                continue
            ends = sorted((int(patch_of[k]), int(column_of[k])) for k in (taxel, other))
            pair = ends[0][1], ends[1][1]
            found.setdefault((ends[0][0], ends[1][0]), set()).add(pair)
    ordered = {key: tuple(sorted(found[key])) for key in sorted(found)}
    inside = {first: pairs for (first, second), pairs in ordered.items() if first == second}
    seams = (Seam(*key, pairs) for key, pairs in ordered.items() if key[0] != key[1])
    return inside, tuple(seams)
