"""Tables of encrypted biometric messages."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sqlalchemy import BigInteger, Column, Index, LargeBinary, Table, exists, select

from eskin_cloud.store.row_digests import add_row_digest
from eskin_cloud.store.schema.node_key import node_key, of_same_node
from eskin_cloud.store.schema.tables import (
    SITE_LENGTH,
    metadata,
    node_sites,
)
from eskin_cloud.store.text_type import Text

if TYPE_CHECKING:
    from collections.abc import Collection

    from sqlalchemy import ColumnElement, Connection

PLACE_LENGTH: Final = 68
"""64 digits of a hash, a point, and a page."""

sealed_messages = Table(
    "sealed_messages",
    metadata,
    *node_key(),
    Column("boot", BigInteger, primary_key=True, autoincrement=False),
    Column("sequence", BigInteger, primary_key=True, autoincrement=False),
    Column("cursor", BigInteger, nullable=False),
    Column("place", Text(PLACE_LENGTH), nullable=False),
    Column("kind", Text(10), nullable=False),
    Column("subject", Text(32), nullable=False),
    Column("t_lo", BigInteger, nullable=False),
    Column("t_hi", BigInteger, nullable=False),
    Column("received", BigInteger, nullable=False),
    Column("data", LargeBinary, nullable=False),
    Index("sealed_by_cursor", "slot", "cursor"),
    Index("sealed_by_time", "slot", "node", "place", "t_lo"),
    Index("sealed_by_coming", "slot", "node", "place", "received"),
    Index("sealed_by_subject", "subject"),
)
"""Messages of biometric channels, encrypted under their subjects' keys.

``place`` is layout and page of a frame, the layout of statements
(`eskin.privacy.sealed_message.name_place`). ``data`` is the message byte for byte; ``t_lo`` and
``t_hi`` are whole minutes; ``subject`` is a pseudonym.
"""

add_row_digest(sealed_messages)

erased_subjects = Table(
    "erased_subjects",
    metadata,
    Column("site", Text(SITE_LENGTH), primary_key=True),
    Column("subject", Text(32), primary_key=True),
    Column("erased", BigInteger, nullable=False),
    Column("removed", BigInteger),
)
"""Pseudonyms, by site, whose keys are destroyed; a job deletes their rows.

``removed`` is when none was left, and none can come any more (`eskin_cloud.jobs.erasure`).
"""
add_row_digest(erased_subjects)


def is_of_erased_subject() -> ColumnElement[bool]:
    """Whether a row of `sealed_messages` is of an erased subject of its node's site."""
    e, n = erased_subjects.c, node_sites.c
    gone = select(e.subject).where(
        e.subject == sealed_messages.c.subject,
        e.site == n.site,
        of_same_node(node_sites, sealed_messages),
    )
    return exists(gone.correlate(sealed_messages))


def find_erased(connection: Connection, site: str, subjects: Collection[str]) -> set[str]:
    """Which of some subjects of a site were erased."""
    e = erased_subjects.c
    query = select(e.subject).where(e.site == site, e.subject.in_(sorted(subjects)))
    return set(connection.execute(query).scalars())


subject_nodes = Table(
    "subject_nodes",
    metadata,
    *node_key(),
    Column("subject", Text(32), primary_key=True),
    Column("reported", BigInteger, nullable=False),
)
"""Which pseudonyms wore which nodes, as gateways reported."""
add_row_digest(subject_nodes)

removals = Table(
    "removals",
    metadata,
    *node_key(),
    Column("place", Text(PLACE_LENGTH), primary_key=True),
    Column("reason", Text(16), primary_key=True),
    Column("messages", BigInteger, nullable=False),
    Column("before", BigInteger, nullable=False),
    Column("at", BigInteger, nullable=False),
)
"""Removed messages by place and reason: their number, latest time, and time of removal.

``place`` is a patch, or that of sealed messages.
"""
add_row_digest(removals)
