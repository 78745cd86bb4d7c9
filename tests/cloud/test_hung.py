"""A process that hangs in the middle of its rows does not keep others from writing for ever."""

from __future__ import annotations

from concurrent.futures import Future
from typing import TYPE_CHECKING

import pytest
from sqlalchemy import func, select

from cloud.store import Store
from cloud.store.block_row import BlockRow
from cloud.store.bulk import inserts
from cloud.store.hung import end_hung_writer
from cloud.store.schema import blocks
from eskin.digest import digest
from eskin.errors import StoreError
from eskin.messages import BlockSummary, decode_summary
from tests.cloud.clouds import put
from tests.cloud.messages import NODE, START, block
from tests.processes import wait_until

if TYPE_CHECKING:
    from sqlalchemy import URL, Connection

    from tests.postgresql import Cluster


def test_writer_that_hangs_between_rows_is_ended_and_tries_again(
    cluster: Cluster, shared_database: URL
) -> None:
    cluster.clear(shared_database)
    begun: Future[None] = Future()
    held: Future[None] = Future()

    def hang(connection: Connection) -> None:
        into = inserts(connection, blocks)
        data = block(0).encode()
        said = decode_summary(data)
        assert isinstance(said, BlockSummary)
        into.add(BlockRow.of(NODE, said, data, digest(data), 1, START))
        begun.set_result(None)
        held.result(120)

    with Store(shared_database) as hung, Store(shared_database) as other:
        assert not end_hung_writer(other, after_s=0.0)
        broken = hung.write(hang, together=True)
        begun.result(120)
        assert not end_hung_writer(other, after_s=3600.0)
        wait_until(lambda: end_hung_writer(other, after_s=0.05), "the one that hangs is ended")
        assert put(other, block(1)).results[0].result == "stored"
        held.set_result(None)
        with pytest.raises(StoreError, match="then send again"):
            broken.result(120)
        assert [each.result for each in put(hung, block(1), block(2)).results] == [
            "duplicate",
            "stored",
        ]
        with other.read() as connection:
            assert connection.execute(select(func.count()).select_from(blocks)).scalar_one() == 2
