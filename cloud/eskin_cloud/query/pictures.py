"""Pictures of a skin: hulls of all channels of one quantity, over neighbouring stretches of time.

A picture is the hull of the samples of each channel in ``[t, t + dt)``. Those of a skin that one
node samples are by that node's clock. Of a skin of several nodes, whose clocks are uncertain by
different errors, a sample belongs to each picture that its true time may lie in. Pictures are read
under the latest layout of their window; samples of other layouts are those of the channels with the
same names.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.errors import QueryError
from eskin.union_bound import union_coverage
from eskin.wire.frames import Privacy
from eskin_cloud.rollup.picture_fold import PictureHulls
from eskin_cloud.rollup.picture_reading import PictureReader, choose_pictures
from eskin_cloud.store.descriptions import find_layout, find_shares
from eskin_cloud.store.read.lookup import UnknownChannelError
from eskin_cloud.store.read.patch_runs import find_layouts, read_pages

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray
    from sqlalchemy import Connection

    from eskin.interval import Floats
    from eskin.wire.frames import DescribedLayout, Patch
    from eskin_cloud.rollup.aggregates import Integers
    from eskin_cloud.rollup.buckets import Buckets
    from eskin_cloud.store.read.window import Window

MOST_VALUES: Final = 4_000_000
"""Most channels times pictures of an answer."""


@dataclass(frozen=True, slots=True)
class Pictures:
    """Pictures of a skin.

    Attributes:
        node: The node.
        described: The layout by which they are read.
        quantity: The quantity.
        unit: UCUM code.
        patches: Numbers of the patches of the quantity; the channels are their columns, in order.
        taxels: Of each channel.
        buckets: When the pictures are: each is the hull of the samples in its bucket.
        lo: Lower bounds, shape ``(pictures, channels)``; infinite where nothing is known.
        hi: Upper bounds.
        contact: Whether each taxel was pressed at some time: 0 impossible, 1 possible, 2 certain;
            ``None`` if no patch states a threshold.
        coverage: Probability that a hull encloses all its true values.
        time_error: Greatest distance of a sample's true time from its stated time, ns.
    """

    node: str
    described: DescribedLayout
    quantity: str
    unit: str
    patches: tuple[int, ...]
    taxels: tuple[str, ...]
    buckets: Buckets
    lo: Floats
    hi: Floats
    contact: NDArray[np.uint8] | None
    coverage: float
    time_error: int

    @property
    def t(self) -> Integers:
        """When each picture begins, ns after the first."""
        return self.buckets.width * np.arange(self.buckets.count, dtype=np.int64)


def find_sealed(
    connection: Connection, node: str, window: Window, quantity: str | None
) -> list[tuple[DescribedLayout, int]]:
    """The biometric pages whose channels are in pictures of a node's skin, by their layouts."""
    chosen = quantity or _usual_quantity(_find_layout_of(connection, node, window))
    found = []
    for row in read_pages(connection, node):
        described = find_layout(connection, node, bytes(row["layout"]))
        if row["page"] in described.biometric_pages:
            numbers = described.page_ranges[row["page"]]
            if any(described.patches[number].quantity == chosen for number in numbers):
                found.append((described, row["page"]))
    return found


def _usual_quantity(described: DescribedLayout) -> str:
    """Pressure, the quantity of a touch; that of the first patch where a skin has none."""
    quantities = [patch.quantity for patch in described.patches]
    return "pressure" if "pressure" in quantities else quantities[0]


def read_pictures(
    connection: Connection,
    node: str,
    window: Window,
    *,
    points: int,
    quantity: str | None = None,
    own: bool = False,
    decrypted: Connection | None = None,
) -> Pictures:
    """Read pictures of a node's skin.

    A picture lasts long enough for a sample of each channel: 1.5 sampling periods at least.

    Args:
        connection: In a read transaction.
        node: The node.
        window: The window.
        points: Most pictures.
        quantity: Which; else pressure, or that of the layout's first patch where it has none.
        own: Whether only what the node itself samples is read; else all nodes of its skin.
        decrypted: A store in memory with the node's sealed frames, if they are read, too.

    Raises:
        UnknownChannelError: The node has no layout.
        QueryError: None of its patches has the quantity; or the answer, or what must be read for
            it, is too large.
        UnknownDescriptionError: A layout is damaged in the store.
    """
    described = _find_layout_of(connection, node, window)
    patches = described.patches
    chosen = _usual_quantity(described) if quantity is None else quantity
    shares = find_shares(connection, node, described)
    if own:
        shares = [share for share in shares if share.node == node]
    mine = [
        [number for number in share.patches if patches[number].quantity == chosen]
        for share in shares
    ]
    numbers = tuple(number for each in mine for number in each)
    if not numbers:
        names = ", ".join(sorted({patches[k].quantity for each in shares for k in each.patches}))
        raise QueryError(
            "quantity", f"{chosen!r} is that of no patch of {node}; it has {names or 'none'}"
        )
    units = sorted({patches[number].unit for number in numbers})
    if len(units) > 1:
        raise QueryError("quantity", f"{chosen!r} has several units: {', '.join(units)}")
    taxels = tuple(taxel for number in numbers for taxel in patches[number].taxels)
    if len(taxels) * points > MOST_VALUES:
        most = MOST_VALUES // len(taxels)
        raise QueryError("points", f"is {points}; {node} has {len(taxels)} taxels: at most {most}")
    # Biometric patches are in the store in memory, if anywhere.
    parts = [
        (share, list(group), connection if decrypted is None or not biometric else decrypted)
        for share, each in zip(shares, mine, strict=True)
        for biometric, group in groupby(each, lambda k: patches[k].privacy is Privacy.BIOMETRIC)
    ]
    readers = [
        PictureReader(
            source,
            share.node,
            [patches[number] for number in each],
            spread=len(shares) > 1,
            share=len(parts),
        )
        if share.stated
        else None
        for share, each, source in parts
    ]
    read = [reader for reader in readers if reader is not None]
    buckets = choose_pictures(read, window, points)
    hulls = PictureHulls.joined(
        [
            PictureHulls.empty(buckets.count, sum(len(patches[number].taxels) for number in each))
            if reader is None
            else reader.fold(buckets)
            for reader, (_, each, _) in zip(readers, parts, strict=True)
        ]
    )
    seen = hulls.n > 0
    return Pictures(
        node=node,
        described=described,
        quantity=chosen,
        unit=units[0],
        patches=numbers,
        taxels=taxels,
        buckets=buckets,
        lo=np.where(seen, hulls.lo, -np.inf),
        hi=np.where(seen, hulls.hi, np.inf),
        contact=_contact(hulls, [patches[number] for number in numbers]),
        coverage=union_coverage(
            min((reader.coverage for reader in read), default=1.0), n=int(hulls.n.max(initial=0))
        ),
        time_error=max((reader.time_error for reader in read), default=0),
    )


def _find_layout_of(connection: Connection, node: str, window: Window) -> DescribedLayout:
    """The latest layout of a window; of a node without frames up to its end, the latest one."""
    begun = [
        (row["t_first"], bytes(row["layout"]))
        for row in read_pages(connection, node)
        if row["t_first"] is not None and row["t_first"] < window.end
    ]
    if begun:
        return find_layout(connection, node, max(begun)[1])
    known = find_layouts(connection, node)
    if not known:
        raise UnknownChannelError(
            "node", f"{node} states no layout, so there is no picture of its skin"
        )
    return known[0]


def _contact(hulls: PictureHulls, patches: Sequence[Patch]) -> NDArray[np.uint8] | None:
    if all(patch.threshold is None for patch in patches):
        return None
    least = [np.nan if patch.threshold is None else patch.threshold for patch in patches]
    threshold = np.repeat(np.array(least), [len(patch.taxels) for patch in patches])
    unknown = (hulls.n == 0) | hulls.gap | np.isnan(threshold)
    possible = unknown | (hulls.hi > threshold)
    found: NDArray[np.uint8] = possible.astype(np.uint8) + (hulls.peak > threshold)
    return found
