"""A process that hangs during COPY is ended, so that others can write."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from typing import TYPE_CHECKING

import pytest
from eskin_cloud.store import Store
from eskin_cloud.store.frame_row import FrameRow, fit_frame
from eskin_cloud.store.schema.frame_tables import frames
from eskin_cloud.store.stuck_writer import end_stuck_writer
from eskin_cloud.store.write.bulk_insert import bulk_insert
from sqlalchemy import func, select

from eskin.errors import StoreError
from eskin.runtime.digest import digest
from eskin.wire.frames import DescribedLayout, EncodedFrame
from eskin.wire.slot import slot_of
from tests.support.processes import wait_until
from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import NODE, START, skin_of, stretch

if TYPE_CHECKING:
    from eskin_cloud.store.write.write_cache import WriteCache
    from sqlalchemy import URL, Connection

    from tests.support.postgresql import Cluster


def test_stuck_writer_is_ended_and_retries(cluster: Cluster, shared_database: URL) -> None:
    cluster.clear(shared_database)
    begun: Future[None] = Future()
    held: Future[None] = Future()

    def hang(connection: Connection, _: WriteCache) -> None:
        into = bulk_insert(connection, frames)
        data = stretch(0).encode()
        said = EncodedFrame.decode(data)
        layout, patch = skin_of()
        fitting = fit_frame(said, DescribedLayout.of(layout, (patch,)))
        into.add(FrameRow.of(NODE, said, fitting, digest(data), cursor=1, now=START))
        begun.set_result(None)
        held.result(120)

    with Store(shared_database) as hung, Store(shared_database) as other:
        assert not end_stuck_writer(other, after_s=0.0)
        broken = hung.write_slots([slot_of(NODE)], hang, shared=True)
        begun.result(120)
        assert not end_stuck_writer(other, after_s=3600.0)
        assert not end_stuck_writer(other, after_s=0.0), "no other writer waits"
        with ThreadPoolExecutor(1) as pool:
            waiting = pool.submit(put, other, stretch(1))
            wait_until(lambda: end_stuck_writer(other, after_s=0.05), "the one that hangs is ended")
            assert waiting.result(120).results[0].result == "stored"
        held.set_result(None)
        with pytest.raises(StoreError, match="then retry"):
            broken.result(120)
        assert [each.result for each in put(hung, stretch(1), stretch(2)).results] == [
            "duplicate",
            "stored",
        ]
        with other.read() as connection:
            assert connection.execute(select(func.count()).select_from(frames)).scalar_one() == 2


@pytest.mark.nightly
def test_idle_transaction_of_a_process_that_hangs_is_ended(
    cluster: Cluster, shared_database: URL
) -> None:
    cluster.clear(shared_database)
    begun: Future[None] = Future()
    held: Future[None] = Future()

    def hang(_: Connection, __: WriteCache) -> None:
        begun.set_result(None)
        held.result(120)

    with Store(shared_database) as hung, Store(shared_database) as other:
        broken = hung.write_node(NODE, hang)
        begun.result(120)

        def is_stored() -> bool:
            with suppress(StoreError):  # it waited for the lock for too long
                return put(other, stretch(1)).results[0].result in {"stored", "duplicate"}
            return False

        wait_until(is_stored, "the other writer goes on")
        held.set_result(None)
        with pytest.raises(StoreError):
            broken.result(120)
        assert put(hung, stretch(1)).results[0].result == "duplicate"
