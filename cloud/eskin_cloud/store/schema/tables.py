"""The store's tables, for SQLite and PostgreSQL alike.

Each key of a node's rows begins with the node's slot (`eskin.wire.slot`): writers share the
store by it, and so do machines.
Times are UTC ns since 1970, 64 bit. An unbounded side is an infinite float.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sqlalchemy import (
    DDL,
    BigInteger,
    Column,
    Double,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    Table,
    event,
)

from eskin_cloud.store.row_digests import add_row_digest
from eskin_cloud.store.schema.node_key import NODE_LENGTH, node_key
from eskin_cloud.store.text_type import Text

if TYPE_CHECKING:
    from sqlalchemy.schema import ExecutableDDLElement


def make_append_only(table: Table) -> None:
    """Reject updates and deletes of a table's rows by triggers."""
    name = table.name
    why = f"'the {name.replace('_', ' ')} is append only'"
    for verb in ("UPDATE", "DELETE"):
        _after_create(
            table,
            "sqlite",
            f"CREATE TRIGGER {name}_no_{verb.lower()} BEFORE {verb} ON {name} "
            f"BEGIN SELECT RAISE(ABORT, {why}); END",
        )
    _after_create(
        table,
        "postgresql",
        f"CREATE FUNCTION {name}_refuse() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN "
        f"RAISE EXCEPTION {why} USING ERRCODE = 'integrity_constraint_violation'; END $$",
    )
    _after_create(
        table,
        "postgresql",
        f"CREATE TRIGGER {name}_append_only BEFORE UPDATE OR DELETE OR TRUNCATE ON {name} "
        f"FOR EACH STATEMENT EXECUTE FUNCTION {name}_refuse()",
    )


def _after_create(table: Table, dialect: str, statement: str) -> None:
    made: ExecutableDDLElement = DDL(statement)  # type: ignore[no-untyped-call]  # untyped in SQLAlchemy
    event.listen(table, "after_create", made.execute_if(dialect=dialect))


metadata = MetaData()

CHANNEL_LENGTH: Final = 64
UNIT_LENGTH: Final = 16
SITE_LENGTH: Final = NODE_LENGTH + 5
GATEWAY_LENGTH: Final = NODE_LENGTH + 9

versions = Table(
    "versions",
    metadata,
    Column("version", Integer, primary_key=True, autoincrement=False),
    Column("applied", BigInteger, nullable=False),
    Column("cursor_key", LargeBinary),
)
"""The version of the schema (`eskin_cloud.store.version`), and when the tables were created.

``cursor_key`` encrypts cursors for clients (`eskin_cloud.query.opaque_ids`).
"""

feed = Table(
    "feed",
    metadata,
    Column("slot", Integer, primary_key=True, autoincrement=False),
    Column("cursor", BigInteger, nullable=False),
    Column("compacted", BigInteger, nullable=False),
    Column("writer", Text(32)),
)
"""The last cursor of each slot; it never decreases. A row is the lock of its slot's writer.

``compacted`` is the latest cursor of a frame that was compacted or removed: a stream that goes on
from before it is not given all frames.

A cursor is 64 times a number within its slot, plus the slot: unique in the store.

``writer`` names the last writer; another writer then drops what it has cached of the slot.
"""

nodes = Table(
    "nodes",
    metadata,
    *node_key(),
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
    Column("faults", Text()),  # JSON, as in the API
    *(Column(name, BigInteger) for name in ("lag_lo", "lag_hi")),
    *(
        Column(name, BigInteger)
        for name in ("clock_earliest", "clock_latest", "clock_after", "clock_before")
    ),
    *(Column(name, BigInteger) for name in ("held_boot", "held_sequence")),
    Column("layout", LargeBinary),
    Index("nodes_by_name", "node"),
)
"""Each node: latest position and status, and the lag of its latest frame.

``layout`` is the hash of its latest layout.

``held_*`` is the lowest position in the node's flash, by the latest status.

``clock_*`` are the times of a `eskin_cloud.query.clock_check.ClockCheck`, by the latest status.
"""

events = Table(
    "events",
    metadata,
    *node_key(),
    Column("cursor", BigInteger, primary_key=True, autoincrement=False),
    Column("boot", BigInteger, nullable=False),
    Column("sequence", BigInteger, nullable=False),
    Column("kind", Text(8), nullable=False),
    Column("channel", Text(CHANNEL_LENGTH)),
    Column("verdict", Text(10)),
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
    Index("events_by_cursor", "slot", "cursor"),
    Index("events_by_time", "t_lo", "cursor"),
    Index("events_by_node", "slot", "node", "t_lo", "cursor"),
)
"""Peaks, gaps, contacts, verdicts, answered commands, changes of a node's status, and conflicts.

A conflict is another message under a stored number.

``data`` is the message byte for byte; of many events from one message, the first has it.
"""

commands = Table(
    "commands",
    metadata,
    *node_key(),
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
"""Commands; ``data`` is the signed message.

``delivered`` is when a gateway first published the command; the node reports ``outcome``,
``reason`` and the time (``t_lo``, ``t_hi``).
"""

states = Table(
    "states",
    metadata,
    *node_key(),
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
"""Each node's desired and reported state (JSON); ``…_by`` is the command."""

node_verdicts = Table(
    "node_verdicts",
    metadata,
    *node_key(),
    Column("monitor", Text(CHANNEL_LENGTH), primary_key=True),
    Column("boot", BigInteger, nullable=False),
    Column("sequence", BigInteger, nullable=False),
    Column("verdict", Text(10), nullable=False),
    Column("t_lo", BigInteger, nullable=False),
    Column("t_hi", BigInteger, nullable=False),
    Column("coverage", Double, nullable=False),
    Column("detail", Text(), nullable=False),
)
"""The latest verdict that a node stated of each of its monitors; ``detail`` is that of its event.

Not of nodes whose statements are sealed.
"""

sequences = Table(
    "sequences",
    metadata,
    *node_key(),
    Column("boot", BigInteger, primary_key=True, autoincrement=False),
    Column("first", BigInteger, primary_key=True, autoincrement=False),
    Column("last", BigInteger, nullable=False),
)
"""Ranges of stored sequence numbers; they make each message stored once."""

digests = Table(
    "digests",
    metadata,
    *node_key(),
    Column("boot", BigInteger, primary_key=True, autoincrement=False),
    Column("first", BigInteger, primary_key=True, autoincrement=False),
    Column("data", LargeBinary, nullable=False),
)
"""Digests of stored messages, 8 bytes for each number from ``first`` on (`runtime.digest`)."""

dead_letters = Table(
    "dead_letters",
    metadata,
    *node_key(),
    Column("digest", Text(64), primary_key=True),
    Column("reason", Text(), nullable=False),
    Column("gateway", Text(GATEWAY_LENGTH), nullable=False),
    Column("received", BigInteger, nullable=False),
    Column("data", LargeBinary, nullable=False),
    Index("dead_letters_by_received", "received"),
)
"""Rejected messages with the reason; one row for the same bytes of a node.

``data`` is empty for what may be biometric; then there is one row for the same reason.
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
"""Bearer tokens by SHA-256."""

login_codes = Table(
    "login_codes",
    metadata,
    Column("digest", Text(64), primary_key=True),
    Column("scopes", Text(64), nullable=False),
    Column("expires", BigInteger, nullable=False),
)
"""One-time codes by SHA-256; deleted once used."""

sessions = Table(
    "sessions",
    metadata,
    Column("digest", Text(64), primary_key=True),
    Column("scopes", Text(64), nullable=False),
    Column("token", Text(64)),
    Column("expires", BigInteger, nullable=False),
)
"""Browser sessions by SHA-256; ``token`` is the one that opened the session."""

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
"""Audit log, append-only; ``digest`` chains each row to all before it."""

make_append_only(audit_log)

node_sites = Table(
    "node_sites",
    metadata,
    *node_key(),
    Column("site", Text(SITE_LENGTH), nullable=False),
    Column("certificate", LargeBinary, nullable=False),
    Column("gateway", Text(GATEWAY_LENGTH), nullable=False),
    Column("presented", BigInteger, nullable=False),
)
"""Each node with its site; ``certificate`` (DER) is the one that ``gateway`` presented."""

gateways = Table(
    "gateways",
    metadata,
    Column("gateway", Text(GATEWAY_LENGTH), primary_key=True),
    Column("site", Text(SITE_LENGTH), nullable=False),
    Column("first_heard", BigInteger, nullable=False),
    Column("last_heard", BigInteger, nullable=False),
    Column("due", BigInteger, nullable=False),
    Column("reported", BigInteger),
    Column("messages", BigInteger),
    Column("used", BigInteger),
    Column("capacity", BigInteger),
    Column("oldest", BigInteger),
    Column("dead_letters", BigInteger),
    Column("nodes", BigInteger),
    Column("stored", BigInteger, nullable=False),
    Column("duplicate", BigInteger, nullable=False),
    Column("rejected", BigInteger, nullable=False),
    Column("latest", BigInteger),
    Column("lag_lo", BigInteger),
    Column("lag_hi", BigInteger),
)
"""Each authenticated gateway.

``due`` is until when it may be silent, as it waits for an answer; ``reported`` is the time of its
latest status, ``oldest`` the age of its oldest message then. ``latest`` is when its latest frame
was stored, ``lag_lo`` to ``lag_hi`` the time since that frame's last sample.
"""

lost_ranges = Table(
    "lost_ranges",
    metadata,
    *node_key(),
    Column("boot", BigInteger, primary_key=True, autoincrement=False),
    Column("first", BigInteger, primary_key=True, autoincrement=False),
    Column("last", BigInteger, nullable=False),
)
"""Ranges of messages that a gap states as lost, or that became dead letters."""

boot_ends = Table(
    "boot_ends",
    metadata,
    *node_key(),
    Column("boot", BigInteger, primary_key=True, autoincrement=False),
    Column("last", BigInteger, nullable=False),
)
"""The greatest sequence number of a boot, as its node or a gateway stated."""

missing_ranges = Table(
    "missing_ranges",
    metadata,
    *node_key(),
    Column("boot", BigInteger, primary_key=True, autoincrement=False),
    Column("first", BigInteger, primary_key=True, autoincrement=False),
    Column("last", BigInteger, nullable=False),
    Column("since", BigInteger, nullable=False),
    Column("reported", Integer, nullable=False),
)
"""Missing messages: since when, UTC ns, and whether an event has reported them."""

clock_state = Table(
    "clock_state",
    metadata,
    Column("name", Text(16), primary_key=True),
    Column("believed", BigInteger, nullable=False),
    Column("ahead", BigInteger, nullable=False),
    Column("doubted", BigInteger, nullable=False),
)
"""One row: an `eskin_cloud.store.write.clock_state.ClockReading`."""

for _table in (
    nodes,
    events,
    commands,
    states,
    node_verdicts,
    sequences,
    tokens,
    login_codes,
    sessions,
    node_sites,
    gateways,
    lost_ranges,
    boot_ends,
    missing_ranges,
):
    add_row_digest(_table)
