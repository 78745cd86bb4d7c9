"""Tables of encrypted biometric data, beside those of `eskin_cloud.store.schema.tables`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sqlalchemy import BigInteger, Column, Index, LargeBinary, Table, exists, select

from eskin_cloud.store.row_digests import keep_checked
from eskin_cloud.store.schema.tables import CHANNEL_LENGTH, NODE_LENGTH, metadata
from eskin_cloud.store.schema.text_type import Text
from eskin_cloud.store.write.node_sites import SITE_LENGTH, node_sites

if TYPE_CHECKING:
    from sqlalchemy import ColumnElement

veiled = Table(
    "veiled",
    metadata,
    Column("node", Text(NODE_LENGTH), primary_key=True),
    Column("boot", BigInteger, primary_key=True, autoincrement=False),
    Column("sequence", BigInteger, primary_key=True, autoincrement=False),
    Column("cursor", BigInteger, nullable=False),
    Column("channel", Text(CHANNEL_LENGTH), nullable=False),
    Column("kind", Text(8), nullable=False),
    Column("subject", Text(32), nullable=False),
    Column("t_lo", BigInteger, nullable=False),
    Column("t_hi", BigInteger, nullable=False),
    Column("received", BigInteger, nullable=False),
    Column("data", LargeBinary, nullable=False),
    Index("veiled_by_cursor", "cursor"),
    Index("veiled_by_time", "node", "channel", "t_lo"),
    Index("veiled_by_coming", "node", "channel", "received"),
    Index("veiled_by_subject", "subject"),
)
"""Blocks and peaks of biometric channels, sealed under their subjects' keys, byte for byte.

``t_lo`` and ``t_hi`` are whole minutes; ``subject`` is a pseudonym. Nothing else is known of them.
"""

keep_checked(veiled)

erased_subjects = Table(
    "erased_subjects",
    metadata,
    Column("site", Text(SITE_LENGTH), primary_key=True),
    Column("subject", Text(32), primary_key=True),
    Column("erased", BigInteger, nullable=False),
)
"""Pseudonyms, by site, whose keys are destroyed; what is left of their data is removed in time."""
keep_checked(erased_subjects)


def is_of_erased() -> ColumnElement[bool]:
    """Whether a row of `veiled` is of a subject that its node's site has erased."""
    e, n = erased_subjects.c, node_sites.c
    gone = select(e.subject).where(
        e.subject == veiled.c.subject, e.site == n.site, n.node == veiled.c.node
    )
    return exists(gone.correlate(veiled))


wearers = Table(
    "wearers",
    metadata,
    Column("node", Text(NODE_LENGTH), primary_key=True),
    Column("subject", Text(32), primary_key=True),
    Column("told", BigInteger, nullable=False),
)
"""Which pseudonyms wore which nodes, as gateways told."""
keep_checked(wearers)

removals = Table(
    "removals",
    metadata,
    Column("node", Text(NODE_LENGTH), primary_key=True),
    Column("channel", Text(CHANNEL_LENGTH), primary_key=True),
    Column("reason", Text(16), primary_key=True),
    Column("messages", BigInteger, nullable=False),
    Column("before", BigInteger, nullable=False),
    Column("at", BigInteger, nullable=False),
)
"""What was removed of each channel and why: how many messages, all before when, and when last."""
keep_checked(removals)
