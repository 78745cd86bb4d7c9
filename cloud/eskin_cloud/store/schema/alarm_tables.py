"""The tables of monitors and of their alarms.

They are small and central: no message of a node is written with them.
"""

from __future__ import annotations

from sqlalchemy import BigInteger, Column, Index, Integer, Table

from eskin_cloud.store.row_digests import add_row_digest
from eskin_cloud.store.schema.node_key import NODE_LENGTH
from eskin_cloud.store.schema.tables import metadata
from eskin_cloud.store.text_type import Text

MONITOR_LENGTH = 63

monitors = Table(
    "monitors",
    metadata,
    Column("name", Text(MONITOR_LENGTH), primary_key=True),
    Column("formula", Text(), nullable=False),
    Column("node", Text(NODE_LENGTH)),
    Column("raise_on", Text(8), nullable=False),
    Column("missing", Integer, nullable=False),
    Column("severity", Text(32), nullable=False),
    Column("clear_after", BigInteger, nullable=False),
    Column("escalate_after", BigInteger),
    Column("silenced_until", BigInteger),
    Column("created", BigInteger, nullable=False),
    Column("changed", BigInteger, nullable=False),
    Column("revision", BigInteger, nullable=False),
    Column("settled", BigInteger, nullable=False),
)
"""Monitors that the cloud evaluates live.

``raise_on`` is ``never``, ``possible`` or ``certain``; ``missing`` is whether samples that do not
exist count for *possible*. Each definition has another ``revision``. Verdicts before the tick
``settled`` (2t is the instant t in ns) have been evaluated, and their alarms are stored.
"""

alarms = Table(
    "alarms",
    metadata,
    Column("id", BigInteger, primary_key=True, autoincrement=False),
    Column("monitor", Text(MONITOR_LENGTH), nullable=False),
    Column("revision", BigInteger, nullable=False),
    Column("formula", Text(), nullable=False),
    Column("severity", Text(32), nullable=False),
    Column("sites", Text(), nullable=False),
    Column("verdict", Text(10), nullable=False),
    Column("began", BigInteger, nullable=False),
    Column("ended", BigInteger),
    Column("raised", BigInteger, nullable=False),
    Column("acknowledged", BigInteger),
    Column("acknowledged_by", Text(100)),
    Column("escalated", BigInteger),
    Column("cleared", BigInteger),
    Column("notified", Integer, nullable=False),
    Index("alarms_by_monitor", "monitor", "revision", "began", unique=True),
    Index("alarms_open", "cleared", "id"),
)
"""One alarm for each episode in which a formula holds.

``began`` and ``ended`` are ticks of the samples' time; the others are UTC ns of the cloud's clock.
``notified`` is whether receivers are given it: not while its monitor is silenced. ``sites`` are
those of the nodes that the formula reads, between blanks.
"""

alarm_transitions = Table(
    "alarm_transitions",
    metadata,
    Column("number", BigInteger, primary_key=True, autoincrement=False),
    Column("alarm", BigInteger),
    Column("monitor", Text(MONITOR_LENGTH), nullable=False),
    Column("kind", Text(12), nullable=False),
    Column("time", BigInteger, nullable=False),
    Column("silenced", Integer, nullable=False),
    Column("sites", Text(), nullable=False),
    Column("document", Text(), nullable=False),
    Index("alarm_transitions_by_alarm", "alarm", "number"),
    Index("alarm_transitions_by_monitor", "monitor", "number"),
)
"""Each change of an alarm, once; and when a monitor was defined or deleted, without an alarm.

``document`` is what receivers are sent, in JSON. Those that are ``silenced`` go to gateways only.
"""

alarm_receivers = Table(
    "alarm_receivers",
    metadata,
    Column("name", Text(100), primary_key=True),
    Column("delivered", BigInteger, nullable=False),
    Column("attempts", Integer, nullable=False),
    Column("failing_since", BigInteger),
    Column("next_attempt", BigInteger),
    Column("error", Text()),
    Column("given_up", BigInteger, nullable=False),
)
"""How far each receiver has been given the transitions: all up to the number ``delivered``."""

alarm_state = Table(
    "alarm_state",
    metadata,
    Column("name", Text(16), primary_key=True),
    Column("holder", Text(32)),
    Column("until", BigInteger, nullable=False),
    Column("version", BigInteger, nullable=False),
    Column("last_alarm", BigInteger, nullable=False),
    Column("last_number", BigInteger, nullable=False),
)
"""One row: which of several clouds evaluates monitors and delivers alarms, and until when.

``version`` grows with each change of a monitor or of an alarm by a caller. ``last_alarm`` and
``last_number`` are the greatest id of an alarm and number of a transition that were ever given.
"""

for _table in (monitors, alarms, alarm_transitions, alarm_receivers, alarm_state):
    add_row_digest(_table)
