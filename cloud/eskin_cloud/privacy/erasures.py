"""Erased subjects, as the store that all clouds share names them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sqlalchemy import func, select

from eskin_cloud.store.row_digests import intact_rows
from eskin_cloud.store.schema.sealed_tables import erased_subjects

if TYPE_CHECKING:
    from collections.abc import Set as AbstractSet

    from sqlalchemy import Connection


def unapplied_erasures(
    connection: Connection, known: AbstractSet[tuple[str, str]]
) -> set[tuple[str, str]]:
    """Erased subjects, each with its site, that are not known; the store forgets none."""
    counted = select(func.count()).select_from(erased_subjects)
    if connection.execute(counted).scalar_one() <= len(known):
        return set()
    rows = connection.execute(select(erased_subjects)).mappings()
    found = intact_rows(connection, erased_subjects, rows)
    return {(row["site"], row["subject"]) for row in found} - known
