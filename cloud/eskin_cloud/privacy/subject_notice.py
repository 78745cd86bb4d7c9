"""A gateway's notice of subjects: who wears what, which keys the cloud may have, who is erased."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from sqlalchemy import insert, select

from eskin.errors import IdentityError, MessageError
from eskin.identity import IdentityKind
from eskin.privacy.subject import KEY_BYTES, is_pseudonym
from eskin.wire.messages.cbor_map import items, load_any
from eskin_cloud.ingest.errors import MalformedBatchError
from eskin_cloud.store.schema.node_key import of_node
from eskin_cloud.store.schema.sealed_tables import erased_subjects, subject_nodes
from eskin_cloud.store.write.audit_log import Action, AuditEntry, record

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

    from sqlalchemy import Connection

MOST: Final = 10_000


@dataclass(frozen=True, slots=True)
class Worn:
    """A subject that wears a node; ``key`` is ``None`` where the cloud is given none."""

    subject: str
    node: str
    key: bytes | None


@dataclass(frozen=True, slots=True)
class SubjectNotice:
    """What a gateway says of subjects; it may say it as often as it likes."""

    worn: list[Worn]
    erased: list[str]

    @classmethod
    def read(cls, body: bytes) -> SubjectNotice:
        """Read a notice; what it refuses is not repeated, as it may hold a key.

        Raises:
            MalformedBatchError: It is none.
        """
        try:
            fields = load_any(body, "body")
            if not isinstance(fields, dict) or set(fields) != {"worn", "erased"}:
                raise MalformedBatchError("the body is no CBOR map of worn and erased")
            worn = [_worn(item) for item in items(fields["worn"], "worn", MOST)]
            return cls(worn, [_pseudonym(item) for item in items(fields["erased"], "erased", MOST)])
        except (MessageError, IdentityError) as error:
            raise MalformedBatchError("the body is no notice of subjects") from error


def note(
    connection: Connection,
    notice: SubjectNotice,
    *,
    site: str,
    gateway: str,
    now: int,
    conflicts: Collection[str] = (),
) -> None:
    """Store the erasures of a notice, and log what is new in it, within a transaction.

    `store_assignments` follows: rows of nodes have transactions of their own.

    Args:
        connection: That of central rows.
        notice: Of nodes of the site.
        site: The gateway's.
        gateway: The sender.
        now: UTC ns.
        conflicts: Subjects whose key is another one than the one that is kept.
    """
    for worn in notice.worn:
        if not _is_assigned(connection, worn):
            audit_entry = AuditEntry(gateway, "", Action.SUBJECT_ASSIGNED, worn.node, worn.subject)
            record(connection, audit_entry, now=now)
    for subject in sorted(set(conflicts)):
        audit_entry = AuditEntry(gateway, "", Action.KEY_CONFLICT, subject, site)
        record(connection, audit_entry, now=now)
    e = erased_subjects.c
    for subject in notice.erased:
        known = select(e.subject).where(e.site == site, e.subject == subject)
        if connection.execute(known).first() is None:
            row = {"site": site, "subject": subject, "erased": now}
            connection.execute(insert(erased_subjects), row)
            record(
                connection, AuditEntry(gateway, "", Action.SUBJECT_ERASED, subject, site), now=now
            )


def store_assignments(connection: Connection, worn: Iterable[Worn], *, now: int) -> None:
    """Store which nodes subjects wear, within a transaction that locks the nodes' slots."""
    for each in worn:
        if not _is_assigned(connection, each):
            row = {"node": each.node, "subject": each.subject, "reported": now}
            connection.execute(insert(subject_nodes), row)


def _is_assigned(connection: Connection, worn: Worn) -> bool:
    here = of_node(subject_nodes, worn.node) & (subject_nodes.c.subject == worn.subject)
    return connection.execute(select(subject_nodes.c.reported).where(here)).first() is not None


def _worn(item: object) -> Worn:
    parts = items(item, "entry", 3)
    if len(parts) != 3 or not isinstance(parts[1], str):
        raise MalformedBatchError("an entry is no array of pseudonym, node and key")
    key = parts[2]
    if key is not None and (not isinstance(key, bytes) or len(key) != KEY_BYTES):
        raise MalformedBatchError(f"a key is no byte string of {KEY_BYTES}")
    return Worn(_pseudonym(parts[0]), IdentityKind.NODE.require_name(parts[1]), key)


def _pseudonym(value: object) -> str:
    if not isinstance(value, str) or not is_pseudonym(value):
        raise MalformedBatchError("a subject is no pseudonym of 32 hexadecimal digits")
    return value
