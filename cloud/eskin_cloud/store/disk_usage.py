"""Measure the disk space of a store."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

from sqlalchemy import func, select, text

from eskin.errors import StoreError
from eskin_cloud.store.schema.frame_tables import pages, patches

if TYPE_CHECKING:
    from eskin_cloud.store.store import Store


_COARSE: Final = 2**24


class DiskUse(NamedTuple):
    """The disk space of a store; all NaN while the store cannot be read.

    Attributes:
        taken: Bytes of the file or database, without write-ahead logs.
        free: Bytes of these that are unused.
        samples: Number of stored samples.
    """

    taken: float
    free: float
    samples: float

    @property
    def each(self) -> float | None:
        """Used bytes a sample; ``None`` without samples."""
        return (self.taken - self.free) / self.samples if self.samples else None

    def coarse(self) -> DiskUse:
        """The same in steps of 16 MiB, so that no single message can be inferred."""
        if math.isnan(self.taken):
            return self
        taken, free = math.ceil(self.taken / _COARSE), math.floor(self.free / _COARSE)
        return DiskUse(taken * _COARSE, free * _COARSE, self.samples)


def measure_disk(store: Store) -> DiskUse:
    """Measure a store; ``free`` is 0 on PostgreSQL, which does not state it."""
    try:
        with store.read() as connection:
            samples = sum(
                connection.execute(select(func.sum(table.c.samples))).scalar_one() or 0
                for table in (pages, patches)
            )
            if connection.dialect.name == "postgresql":
                size = "SELECT pg_database_size(current_database())"
                return DiskUse(connection.execute(text(size)).scalar_one(), 0, int(samples))
            asked = ("page_size", "page_count", "freelist_count")
            page, count, free = (
                connection.exec_driver_sql(f"PRAGMA {name}").scalar_one() for name in asked
            )
            return DiskUse(page * count, page * free, int(samples))
    except StoreError:
        return DiskUse(math.nan, math.nan, math.nan)
