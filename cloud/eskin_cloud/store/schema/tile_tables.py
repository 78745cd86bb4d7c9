"""Tables of rollups: hulls of a channel's samples over ever longer buckets.

`eskin_cloud.rollup` builds them from `blocks`; they hold nothing biometric.
"""

from __future__ import annotations

from sqlalchemy import BigInteger, Column, Integer, LargeBinary, Table

from eskin_cloud.store.schema.tables import CHANNEL_LENGTH, NODE_LENGTH, metadata
from eskin_cloud.store.text_type import Text

tiles = Table(
    "tiles",
    metadata,
    Column("node", Text(NODE_LENGTH), primary_key=True),
    Column("channel", Text(CHANNEL_LENGTH), primary_key=True),
    Column("level", Integer, primary_key=True, autoincrement=False),
    Column("chunk", BigInteger, primary_key=True, autoincrement=False),
    Column("data", LargeBinary, nullable=False),
    Column("digest", LargeBinary, nullable=False),
)
"""Chunks of tiles, packed; the tiles of a level are ``2^level`` ns wide.

``digest`` is that of ``data`` (`eskin.runtime.digest`).
"""

stale_chunks = Table(
    "stale_chunks",
    metadata,
    Column("node", Text(NODE_LENGTH), primary_key=True),
    Column("channel", Text(CHANNEL_LENGTH), primary_key=True),
    Column("chunk", BigInteger, primary_key=True, autoincrement=False),
    Column("mark", BigInteger, nullable=False),
)
"""Chunks of a channel's lowest level that must be rebuilt; readers use blocks instead.

Each change draws a new random ``mark``.
"""
