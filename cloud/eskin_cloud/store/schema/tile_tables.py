"""The store's tables of the pyramid: hulls of ever longer stretches of each channel's samples.

What they hold is made from `blocks` in the background, see `eskin_cloud.rollup`; nothing of a
person is in them.
"""

from __future__ import annotations

from sqlalchemy import BigInteger, Column, Integer, LargeBinary, Table

from eskin_cloud.store.schema.tables import CHANNEL_LENGTH, NODE_LENGTH, metadata
from eskin_cloud.store.schema.text_type import Text

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

stale = Table(
    "stale",
    metadata,
    Column("node", Text(NODE_LENGTH), primary_key=True),
    Column("channel", Text(CHANNEL_LENGTH), primary_key=True),
    Column("chunk", BigInteger, primary_key=True, autoincrement=False),
    Column("mark", BigInteger, nullable=False),
)
"""Chunks of a channel's lowest level whose blocks changed since they were made, or that never were.

Until they are made anew, blocks are read in their place. ``mark`` is drawn anew by each change.
"""
