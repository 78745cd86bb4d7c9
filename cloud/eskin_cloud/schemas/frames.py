"""Answers about a skin: its layout, and pictures of it."""

from typing import Final

import numpy as np
from typing_extensions import TypedDict

from eskin.wire.frames import DescribedLayout, Patch
from eskin.wire.timestamp import format_timestamp
from eskin_cloud.query.pictures import Pictures
from eskin_cloud.schemas.base import Instant, Json

_UM_PER_M: Final = 1_000_000


class PatchDocument(TypedDict):
    """A patch: channels of one quantity that are sampled together.

    ``positions`` are x and y, or x, y and z of all taxels, in m; ``neighbours`` are pairs of taxels
    that touch, by number; ``threshold`` is the value from which on there is a contact, in the unit;
    ``cell_area`` is what a taxel covers, in m²; ``page`` is that of its frames, and ``node`` sends
    them: channel ``{taxel}.{quantity}`` is that node's.
    """

    patch: str
    hash: str
    quantity: str
    unit: str
    taxels: list[str]
    positions: list[list[float]]
    neighbours: list[tuple[int, int]]
    least_width: float
    threshold: float | None
    cell_area: float | None
    page: int
    node: str


class SeamDocument(TypedDict):
    """Neighbours in two patches, which are numbered in order; ``pairs`` has a taxel of each."""

    first: int
    second: int
    pairs: list[tuple[int, int]]


class ControllerDocument(TypedDict):
    """A machine that samples pages of the skin on its own clock."""

    node: str
    pages: int


class LayoutDocument(TypedDict):
    """What a node's frames are read by; ``layout`` is its hash.

    Where several nodes share the skin, all state the same layout, and ``controllers`` names them.
    ``outline`` has the closed lines by which to draw it: x and y of their points, in m.
    """

    layout: str
    patches: list[PatchDocument]
    seams: list[SeamDocument]
    controllers: list[ControllerDocument]
    outline: list[tuple[list[float], list[float]]]


class PicturesDocument(TypedDict):
    """Pictures of a skin, a row each.

    Where one of lo and hi is null, that side is unbounded; where both are, nothing is known. A
    picture is the hull of all samples of each taxel in ``[t, t + dt)``; ``coverage`` is the
    probability that a hull encloses all its true values, whose instants lie within ``time_error``
    ns of the stated ones. ``contact`` is 2 where a taxel was certainly pressed at some time of the
    picture, 1 where it may have been, also unknown or during a gap, and 0 where it was not; null if
    no patch states a threshold.
    """

    node: str
    layout: str
    quantity: str
    unit: str
    coverage: float
    t0: Instant
    dt: int
    time_error: int
    taxels: list[str]
    t: list[int]
    lo: list[list[float | None]]
    hi: list[list[float | None]]
    contact: list[list[int]] | None


def describe_layout(node: str, described: DescribedLayout) -> LayoutDocument:
    """A layout with its patches, as a node states it."""
    layout = described.layout
    pages = [page for page, size in enumerate(layout.pages) for _ in range(size)]
    owners = described.controllers or (node,) * len(layout.pages)
    return {
        "layout": described.hash.hex(),
        "patches": [
            _patch(patch, name.hex(), page, owners[page])
            for patch, name, page in zip(described.patches, layout.patches, pages, strict=True)
        ],
        "seams": [
            {"first": seam.first, "second": seam.second, "pairs": list(seam.pairs)}
            for seam in layout.seams
        ],
        "controllers": [{"node": each.node, "pages": each.pages} for each in layout.controllers],
        "outline": [
            ([x / _UM_PER_M for x in line.x], [y / _UM_PER_M for y in line.y])
            for line in layout.outline
        ],
    }


def describe_pictures(pictures: Pictures) -> Json:
    """Pictures; written by `base.dump`, which writes infinite numbers as ``null``."""
    contact = pictures.contact
    return {
        "node": pictures.node,
        "layout": pictures.described.hash.hex(),
        "quantity": pictures.quantity,
        "unit": pictures.unit,
        "coverage": pictures.coverage,
        "t0": format_timestamp(pictures.buckets.start),
        "dt": pictures.buckets.width,
        "time_error": pictures.time_error,
        "taxels": pictures.taxels,
        "t": pictures.t,
        "lo": np.ascontiguousarray(pictures.lo),
        "hi": np.ascontiguousarray(pictures.hi),
        "contact": None if contact is None else np.ascontiguousarray(contact),
    }


def _patch(patch: Patch, name: str, page: int, node: str) -> PatchDocument:
    return {
        "patch": patch.patch_id,
        "hash": name,
        "quantity": patch.quantity,
        "unit": patch.unit,
        "taxels": list(patch.taxels),
        "positions": [[each / _UM_PER_M for each in axis] for axis in patch.positions],
        "neighbours": list(patch.neighbours),
        "least_width": patch.least_width,
        "threshold": patch.threshold,
        "cell_area": patch.cell_area,
        "page": page,
        "node": node,
    }
