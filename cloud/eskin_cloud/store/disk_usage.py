"""How much of the disk a store takes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

from sqlalchemy import func, select, text

from eskin.errors import StoreError
from eskin_cloud.store.schema.tables import channels

if TYPE_CHECKING:
    from eskin_cloud.store.store import Store


_COARSE: Final = 2**24


class DiskUse(NamedTuple):
    """What a store takes; all NaN while it cannot be read.

    Attributes:
        taken: Bytes of its file, or its database; without what waits in a log.
        free: Bytes of these in which nothing lies, and where what comes next is written.
        samples: How many samples are in it.
    """

    taken: float
    free: float
    samples: float

    @property
    def each(self) -> float | None:
        """Bytes a sample, of what is taken and not free; ``None`` where there is no sample."""
        return (self.taken - self.free) / self.samples if self.samples else None

    def coarse(self) -> DiskUse:
        """The same in steps of 16 MiB, so that no single message shows."""
        if math.isnan(self.taken):
            return self
        taken, free = math.ceil(self.taken / _COARSE), math.floor(self.free / _COARSE)
        return DiskUse(taken * _COARSE, free * _COARSE, self.samples)


def measure_disk(store: Store) -> DiskUse:
    """Look how much a store takes now; PostgreSQL does not tell what is free, so it is 0 there."""
    try:
        with store.read() as connection:
            samples = connection.execute(select(func.sum(channels.c.samples))).scalar_one() or 0
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
