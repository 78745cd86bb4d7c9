"""Tables of frames, of what describes them, and of what is made of them.

Keys begin with the slot of the node (`eskin.wire.slot`). Times are UTC ns.
"""

from __future__ import annotations

from typing import Final

from sqlalchemy import BigInteger, Column, Double, Index, Integer, LargeBinary, Table

from eskin_cloud.store.row_digests import add_row_digest
from eskin_cloud.store.schema.node_key import node_key
from eskin_cloud.store.schema.tables import metadata
from eskin_cloud.store.text_type import Text

PATCH_LENGTH: Final = 31


descriptions = Table(
    "descriptions",
    metadata,
    *node_key(),
    Column("hash", LargeBinary, primary_key=True),
    Column("kind", Text(8), nullable=False),
    Column("biometric", Integer, nullable=False),
    Column("data", LargeBinary, nullable=False),
)
"""Patches and layouts byte for byte, by the SHA-256 of ``data``; ``kind`` is patch or layout.

``biometric`` is 1 for patches of biometric channels.
"""
Index(
    "biometric_descriptions",
    descriptions.c.slot,
    descriptions.c.node,
    sqlite_where=descriptions.c.biometric == 1,
    postgresql_where=descriptions.c.biometric == 1,
)
add_row_digest(descriptions)

pages = Table(
    "pages",
    metadata,
    *node_key(),
    Column("layout", LargeBinary, primary_key=True),
    Column("page", Integer, primary_key=True, autoincrement=False),
    Column("frames", BigInteger, nullable=False),
    Column("samples", BigInteger, nullable=False),
    Column("bytes", BigInteger, nullable=False),
    Column("t_first", BigInteger),
    Column("t_last", BigInteger),
    Column("longest", BigInteger, nullable=False),
    Column("compacted", BigInteger),
)
"""Totals of the rows in `frames` of one page of a layout.

Of a biometric page, whose frames are in `sealed_messages`, only ``frames``, ``t_first`` and
``t_last`` are known, by the minute.

``longest`` is the greatest ``t_end - t`` of a row, ever. Frames before ``compacted`` are in
`patch_rows`.
"""
add_row_digest(pages)

frames = Table(
    "frames",
    metadata,
    *node_key(),
    Column("boot", BigInteger, primary_key=True, autoincrement=False),
    Column("sequence", BigInteger, primary_key=True, autoincrement=False),
    Column("cursor", BigInteger, nullable=False),
    Column("layout", LargeBinary, nullable=False),
    Column("page", Integer, nullable=False),
    Column("t", BigInteger, nullable=False),
    Column("t_end", BigInteger, nullable=False),
    Column("error", BigInteger, nullable=False),
    Column("t_lo", BigInteger, nullable=False),
    Column("t_hi", BigInteger, nullable=False),
    Column("samples", Integer, nullable=False),
    Column("received", BigInteger, nullable=False),
    Column("data", LargeBinary, nullable=False),
    Column("digest", LargeBinary, nullable=False),
    Column("head", BigInteger, nullable=False),
    Index("frames_by_cursor", "slot", "cursor"),
    Index("frames_by_time", "slot", "node", "page", "t", "t_end"),
)
"""Frames byte for byte.

``t`` and ``t_end`` are the middles of the first and the last sample's time, skews included;
``t_lo`` and ``t_hi`` enclose the first instant; ``error`` is the greatest distance of a sample's
time from its middle; ``digest`` is that of ``data`` (`runtime.digest`), and ``head`` that of the
other columns (`store.damage`). Every reader of ``data`` checks both.
"""

patches = Table(
    "patches",
    metadata,
    *node_key(),
    Column("patch", Text(PATCH_LENGTH), primary_key=True),
    Column("hash", LargeBinary, nullable=False),
    Column("rows", BigInteger, nullable=False),
    Column("samples", BigInteger, nullable=False),
    Column("bytes", BigInteger, nullable=False),
    Column("t_first", BigInteger),
    Column("t_last", BigInteger),
    Column("longest", BigInteger, nullable=False),
    Column("grain", Integer),
    Column("built", BigInteger),
)
"""Each patch of a node: its latest description, and totals of its rows in `patch_rows`.

``grain`` is the lowest level of its tiles; they are built up to ``built``. ``samples`` counts all
columns.
"""
add_row_digest(patches)

patch_rows = Table(
    "patch_rows",
    metadata,
    *node_key(),
    Column("patch", Text(PATCH_LENGTH), primary_key=True),
    Column("t", BigInteger, primary_key=True, autoincrement=False),
    Column("boot", BigInteger, primary_key=True, autoincrement=False),
    Column("sequence", BigInteger, primary_key=True, autoincrement=False),
    Column("hash", LargeBinary, nullable=False),
    Column("t_end", BigInteger, nullable=False),
    Column("error", BigInteger, nullable=False),
    Column("frames", Integer, nullable=False),
    Column("samples", Integer, nullable=False),
    Column("lo", Double, nullable=False),
    Column("hi", Double, nullable=False),
    Column("coverage", Double, nullable=False),
    Column("data", LargeBinary, nullable=False),
    Column("digest", LargeBinary, nullable=False),
    Column("head", BigInteger, nullable=False),
)
"""Samples of one patch from many frames (`store.patch_rows`).

``boot`` and ``sequence`` are those of the first frame, ``hash`` is the patch's description, ``lo``
and ``hi`` are the hull of all samples.
"""

patch_tiles = Table(
    "patch_tiles",
    metadata,
    *node_key(),
    Column("patch", Text(PATCH_LENGTH), primary_key=True),
    Column("level", Integer, primary_key=True, autoincrement=False),
    Column("chunk", BigInteger, primary_key=True, autoincrement=False),
    Column("data", LargeBinary, nullable=False),
    Column("digest", LargeBinary, nullable=False),
)
"""Tiles of a patch: a matrix of hulls, buckets of a level by columns."""

stale_patch_chunks = Table(
    "stale_patch_chunks",
    metadata,
    *node_key(),
    Column("patch", Text(PATCH_LENGTH), primary_key=True),
    Column("chunk", BigInteger, primary_key=True, autoincrement=False),
    Column("mark", BigInteger, nullable=False),
)
"""Chunks of a patch's lowest level that must be built again; each change draws a new ``mark``."""
