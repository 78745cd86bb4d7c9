"""The audit log: an append-only hash chain.

Triggers reject updates and deletes. A change of the file itself breaks the chain, unless all later
rows are rewritten; `check_audit_entries` finds the first such row.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Final

from sqlalchemy import insert, select

from eskin_cloud.store.damage import report_damaged
from eskin_cloud.store.schema.tables import audit_log
from eskin_cloud.store.text_type import storable

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from typing import Any

    from sqlalchemy import Connection, RowMapping

_LONGEST_DETAIL: Final = 1000
_HASHED: Final = ("number", "time", "actor", "address", "action", "target", "detail")


class Action(StrEnum):
    """Actions that are logged."""

    SIGN_IN = "sign in"
    SIGN_IN_REFUSED = "sign in refused"
    SIGN_OUT = "sign out"
    SESSION_REVOKED = "session revoked"
    LOGIN_LINK = "login link made"
    TOKEN_CREATED = "token created"  # noqa: S105 - no secret
    TOKEN_REVOKED = "token revoked"  # noqa: S105 - no secret
    COMMAND_ASKED = "command asked for"
    COMMAND = "command issued"
    MONITOR_DEFINED = "monitor defined"
    MONITOR_DELETED = "monitor deleted"
    MONITOR_SILENCED = "monitor silenced"
    ALARM_ACKNOWLEDGED = "alarm acknowledged"
    SUBJECT_ASSIGNED = "subject assigned"
    SUBJECT_ERASED = "subject erased"
    SUBJECT_REMOVED = "subject's messages removed"
    KEY_CONFLICT = "subject key differs"
    SUBJECT_EXPORTED = "subject exported"


@dataclass(frozen=True, slots=True)
class AuditEntry:
    """One entry.

    Attributes:
        actor: A token's name, ``login link``, ``command line``, or empty if unknown.
        address: From where; empty for this machine's command line.
        action: What.
        target: To what, such as a node or a token's id.
        detail: What else matters; never a secret.
    """

    actor: str
    address: str
    action: Action
    target: str = ""
    detail: str = ""


def record(connection: Connection, audit_entry: AuditEntry, *, now: int) -> None:
    """Append an entry, in the transaction of the action.

    Args:
        connection: The writer's, in a transaction.
        audit_entry: The action.
        now: UTC ns.
    """
    query = select(audit_log.c.number, audit_log.c.digest).order_by(audit_log.c.number.desc())
    last = connection.execute(query.limit(1)).one_or_none()
    number, before = (0, "") if last is None else (last[0] + 1, last[1])
    row = {
        "number": number,
        "time": now,
        "actor": storable(audit_entry.actor[:100]),
        "address": storable(audit_entry.address[:64]),
        "action": audit_entry.action.value,
        "target": storable(audit_entry.target[:200]),
        "detail": storable(audit_entry.detail[:_LONGEST_DETAIL]),
    }
    connection.execute(insert(audit_log), row | {"digest": _chain_digest(before, row)})


def list_audit_entries(
    connection: Connection, *, before: int | None, limit: int
) -> tuple[Sequence[RowMapping], int | None]:
    """One page of entries, latest first, and the number before which the next page starts.

    Damaged entries are reported and left out; so is the entry after a damaged digest.
    """
    query = select(audit_log).order_by(audit_log.c.number.desc()).limit(limit + 1)
    if before is not None:
        query = query.where(audit_log.c.number < before)
    found = connection.execute(query).mappings().all()
    older = [*(row["digest"] for row in found[1:]), ""]
    pairs = zip(older[:limit], found[:limit], strict=True)
    page = [row for before_, row in pairs if _is_intact(before_, row)]
    return page, found[limit - 1]["number"] if len(found) > limit else None


def read_audit_entries(connection: Connection) -> Iterable[RowMapping]:
    """All entries, oldest first."""
    query = select(audit_log).order_by(audit_log.c.number)
    return connection.execution_options(stream_results=True).execute(query).mappings()


def check_audit_entries(connection: Connection) -> int | None:
    """The first missing or changed number; ``None`` if the chain is intact.

    A chain does not show entries that were cut off at its end: keep the latest digest elsewhere.
    """
    before, expected = "", 0
    for row in read_audit_entries(connection):
        if row["number"] != expected or row["digest"] != _chain_digest(before, row):
            return expected
        before, expected = row["digest"], expected + 1
    return None


def _is_intact(before: str, row: RowMapping) -> bool:
    if row["digest"] == _chain_digest(before, row):
        return True
    report_damaged(audit_log.name, f"{audit_log.name} {row['number']}")
    return False


def _chain_digest(before: str, row: Mapping[str, Any] | RowMapping) -> str:
    text = json.dumps([before, *(row[name] for name in _HASHED)], ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()
