"""The store's tables, for SQLite and PostgreSQL alike.

What nodes say is keyed by ``node`` first: it is the column by which a larger store is distributed.
Times are UTC ns since 1970, 64 bit. An unbounded side is an infinite float.
"""

from __future__ import annotations

from typing import Final

from sqlalchemy import BigInteger, Column, Double, Index, Integer, LargeBinary, MetaData, Table

from eskin_cloud.store.row_digests import keep_checked
from eskin_cloud.store.schema.append_only import keep_append_only
from eskin_cloud.store.schema.text_type import Text

metadata = MetaData()

NODE_LENGTH: Final = 63
CHANNEL_LENGTH: Final = 64
UNIT_LENGTH: Final = 16

versions = Table(
    "versions",
    metadata,
    Column("version", Integer, primary_key=True, autoincrement=False),
    Column("applied", BigInteger, nullable=False),
)
"""The version of the schema (`eskin_cloud.store.version`), and when the tables were made."""

feed = Table(
    "feed",
    metadata,
    Column("name", Text(16), primary_key=True),
    Column("cursor", BigInteger, nullable=False),
    Column("writer", Text(32)),
    Column("ids", LargeBinary),
)
"""The last cursor given out; it never runs backwards, whatever is removed later.

``ids`` is the key under which cursors leave the cloud (`eskin_cloud.query.opaque_ids`).

``writer`` is who gave it out: what others remember of the store is then no longer all.
"""

nodes = Table(
    "nodes",
    metadata,
    Column("node", Text(NODE_LENGTH), primary_key=True),
    Column("first_seen", BigInteger, nullable=False),
    Column("last_seen", BigInteger, nullable=False),
    Column("online", Integer, nullable=False),
    Column("boot", BigInteger, nullable=False),
    Column("sequence", BigInteger, nullable=False),
    Column("status_boot", BigInteger),
    Column("status_sequence", BigInteger),
    Column("profile", Text(64)),
    Column("description", Text(200)),
    Column("uptime", BigInteger),
    Column("messages", BigInteger),
    Column("used", BigInteger),
    Column("capacity", BigInteger),
    Column("gaps", BigInteger),
    Column("stored_lo", Double),
    Column("stored_hi", Double),
    Column("charge_lo", Double),
    Column("charge_hi", Double),
    Column("sustained", Integer),
    Column("shedding", Integer),
    Column("faults", Text()),  # JSON, as the API tells it
    Column("places", Text()),
    *(Column(name, BigInteger) for name in ("lag_lo", "lag_hi")),
    *(
        Column(name, BigInteger)
        for name in ("clock_earliest", "clock_latest", "clock_after", "clock_before")
    ),
    *(Column(name, BigInteger) for name in ("held_boot", "held_sequence")),
)
"""Each node: latest position and status, and how long after its last sample a block was stored.

``held_*`` is the lowest position that it still held, by the latest status.

``clock_*`` are the times of a `eskin_cloud.query.clock_check.ClockCheck`, by the latest status.

``places`` is JSON: ``[taxel, x, y]`` of each taxel on the map of its skin, in m.
"""

channels = Table(
    "channels",
    metadata,
    Column("node", Text(NODE_LENGTH), primary_key=True),
    Column("channel", Text(CHANNEL_LENGTH), primary_key=True),
    Column("unit", Text(UNIT_LENGTH), nullable=False),
    Column("coverage", Double, nullable=False),
    Column("dt", BigInteger, nullable=False),
    Column("blocks", BigInteger, nullable=False),
    Column("samples", BigInteger, nullable=False),
    Column("t_first", BigInteger),
    Column("t_last", BigInteger),
    Column("longest", BigInteger, nullable=False),
    Column("lo", Double),
    Column("hi", Double),
    Column("grain", Integer),
    Column("built", BigInteger),
    Column("packed", BigInteger),
    Column("bytes", BigInteger),
)
"""Each channel with sums over its blocks; ``longest`` is the greatest ``t_end - t`` of a row.

``bytes`` is how long all ``data`` of its rows in `blocks` are. What is sealed is not counted: then
anybody could see when its peaks come.

``grain`` is the lowest level of its pyramid, and ``built`` up to when there is one, UTC ns; before
``packed``, blocks were packed where that is possible.
"""

blocks = Table(
    "blocks",
    metadata,
    Column("node", Text(NODE_LENGTH), primary_key=True),
    Column("boot", BigInteger, primary_key=True, autoincrement=False),
    Column("sequence", BigInteger, primary_key=True, autoincrement=False),
    Column("cursor", BigInteger, nullable=False),
    Column("channel", Text(CHANNEL_LENGTH), nullable=False),
    Column("t", BigInteger, nullable=False),
    Column("t_end", BigInteger, nullable=False),
    Column("error", BigInteger, nullable=False),
    Column("t_lo", BigInteger, nullable=False),
    Column("t_hi", BigInteger, nullable=False),
    Column("dt", BigInteger, nullable=False),
    Column("n", Integer, nullable=False),
    Column("lo", Double, nullable=False),
    Column("hi", Double, nullable=False),
    Column("coverage", Double, nullable=False),
    Column("received", BigInteger, nullable=False),
    Column("data", LargeBinary, nullable=False),
    Column("digest", LargeBinary, nullable=False),
    Column("packed", Integer),
    Column("head", BigInteger, nullable=False),
    Index("blocks_by_cursor", "cursor"),
    # Holds all that bounds are answered from, so that no block's bytes are touched for them.
    Index(
        "blocks_by_time",
        "node",
        "channel",
        "t",
        "t_end",
        "n",
        "lo",
        "hi",
        "coverage",
        "error",
        "dt",
    ),
)
"""Blocks byte for byte, compressed (`messages.compression`), or ``packed`` of them in a row.

``t`` and ``t_end`` are the first and the last sample's middle; ``t_lo`` and ``t_hi`` enclose the
first sample's moment; ``error`` is how far a moment may lie from its middle; ``digest`` is that of
``data`` (`runtime.digest`), and ``head`` that of the columns (`store.damage`): every reader of
``data`` checks both.
"""

events = Table(
    "events",
    metadata,
    Column("node", Text(NODE_LENGTH), primary_key=True),
    Column("cursor", BigInteger, primary_key=True, autoincrement=False),
    Column("boot", BigInteger, nullable=False),
    Column("sequence", BigInteger, nullable=False),
    Column("kind", Text(8), nullable=False),
    Column("channel", Text(CHANNEL_LENGTH)),
    Column("verdict", Text(8)),
    Column("t_lo", BigInteger, nullable=False),
    Column("t_hi", BigInteger, nullable=False),
    Column("count_lo", BigInteger),
    Column("count_hi", BigInteger),
    Column("height_lo", Double),
    Column("height_hi", Double),
    Column("prominence_lo", Double),
    Column("prominence_hi", Double),
    Column("unit", Text(UNIT_LENGTH)),
    Column("coverage", Double),
    Column("detail", Text()),
    Column("received", BigInteger, nullable=False),
    Column("data", LargeBinary),
    Index("events_by_cursor", "cursor"),
    Index("events_by_time", "t_lo", "cursor"),
    Index("events_by_node", "node", "t_lo", "cursor"),
)
"""Peaks, gaps, answered commands, what changed in a node's status, and conflicts.

A conflict is a message under a number under which another one was stored.

``data`` is the message byte for byte.
"""

commands = Table(
    "commands",
    metadata,
    Column("node", Text(NODE_LENGTH), primary_key=True),
    Column("id", BigInteger, primary_key=True, autoincrement=False),
    Column("name", Text(16), nullable=False),
    Column("arguments", Text(), nullable=False),
    Column("issued", BigInteger, nullable=False),
    Column("expires", BigInteger, nullable=False),
    Column("delivered", BigInteger),
    Column("outcome", Text(8)),
    Column("reason", Text(200)),
    Column("t_lo", BigInteger),
    Column("t_hi", BigInteger),
    Column("data", LargeBinary, nullable=False),
    Index("commands_open", "outcome", "expires"),
)
"""Commands, ``data`` as they were signed.

``delivered`` is when a gateway first had handed it to its broker; ``outcome``, ``reason`` and the
time (``t_lo``, ``t_hi``) are the node's word.
"""

states = Table(
    "states",
    metadata,
    Column("node", Text(NODE_LENGTH), primary_key=True),
    Column("desired", Text()),
    Column("desired_at", BigInteger),
    Column("desired_by", BigInteger),
    Column("reported", Text()),
    Column("boot", BigInteger),
    Column("sequence", BigInteger),
    Column("t_lo", BigInteger),
    Column("t_hi", BigInteger),
    Column("reported_by", BigInteger),
)
"""How each node should be set (JSON), and how it says that it is; ``…_by`` is the command."""

sequences = Table(
    "sequences",
    metadata,
    Column("node", Text(NODE_LENGTH), primary_key=True),
    Column("boot", BigInteger, primary_key=True, autoincrement=False),
    Column("first", BigInteger, primary_key=True, autoincrement=False),
    Column("last", BigInteger, nullable=False),
)
"""Which sequence numbers were stored, as ranges: the memory behind *once*."""

digests = Table(
    "digests",
    metadata,
    Column("node", Text(NODE_LENGTH), primary_key=True),
    Column("boot", BigInteger, primary_key=True, autoincrement=False),
    Column("first", BigInteger, primary_key=True, autoincrement=False),
    Column("data", LargeBinary, nullable=False),
)
"""Digests of stored messages, 8 bytes for each number from ``first`` on (`runtime.digest`)."""

dead_letters = Table(
    "dead_letters",
    metadata,
    Column("node", Text(NODE_LENGTH), primary_key=True),
    Column("digest", Text(64), primary_key=True),
    Column("reason", Text(), nullable=False),
    Column("gateway", Text(NODE_LENGTH + 9), nullable=False),
    Column("received", BigInteger, nullable=False),
    Column("data", LargeBinary, nullable=False),
    Index("dead_letters_by_received", "received"),
)
"""What was refused, and why; once for the same bytes of the same node.

Of what may tell of a person ``data`` holds nothing; then it is once for the same reason.
"""

tokens = Table(
    "tokens",
    metadata,
    Column("digest", Text(64), primary_key=True),
    Column("name", Text(100), nullable=False),
    Column("scopes", Text(64), nullable=False),
    Column("created", BigInteger, nullable=False),
    Column("expires", BigInteger),
    Column("revoked", BigInteger),
)
"""Bearer tokens by SHA-256; the token itself is known to its holder only."""

login_codes = Table(
    "login_codes",
    metadata,
    Column("digest", Text(64), primary_key=True),
    Column("scopes", Text(64), nullable=False),
    Column("expires", BigInteger, nullable=False),
)
"""One-time codes by SHA-256; gone once used."""

sessions = Table(
    "sessions",
    metadata,
    Column("digest", Text(64), primary_key=True),
    Column("scopes", Text(64), nullable=False),
    Column("token", Text(64)),
    Column("expires", BigInteger, nullable=False),
)
"""Sessions of browsers by SHA-256; ``token`` is the one that opened it, and closes it."""

audit_log = Table(
    "audit_log",
    metadata,
    Column("number", BigInteger, primary_key=True, autoincrement=False),
    Column("time", BigInteger, nullable=False),
    Column("actor", Text(100), nullable=False),
    Column("address", Text(64), nullable=False),
    Column("action", Text(32), nullable=False),
    Column("target", Text(200), nullable=False),
    Column("detail", Text(), nullable=False),
    Column("digest", Text(64), nullable=False),
)
"""Who did what, append only; ``digest`` chains each row to all before it."""

keep_append_only(audit_log)

for _table in (nodes, channels, events, commands, states, sequences, tokens, login_codes, sessions):
    keep_checked(_table)
