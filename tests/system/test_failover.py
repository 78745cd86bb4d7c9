"""Two clouds on one PostgreSQL server: each is killed, and data and pictures go on at the other."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

from eskin_cloud.store import Store

from tests.support.live_viewers import LiveViewer, count_stored, require_each_once
from tests.support.processes import wait_until
from tests.support.stacks import RealStack

if TYPE_CHECKING:
    from pathlib import Path

    from tests.support.postgresql import Cluster

LIMIT_S: Final = 10.0


def test_kill_of_any_cloud_loses_and_doubles_nothing(tmp_path: Path, cluster: Cluster) -> None:
    place = cluster.fresh(empty=True)
    with RealStack(tmp_path, clouds=2, place=place) as stack, Store(place) as store:
        viewer = LiveViewer(stack, stack.token())
        viewer.start()
        with stack.sensor_node() as node:
            wait_until(lambda: viewer.samples > 0, "the viewer sees frames")
            for killed in (0, 1, 0):
                before, begun = count_stored(store), time.monotonic()
                shown = viewer.samples
                stack.clouds[killed].kill()
                wait_until(
                    lambda: count_stored(store) > before + 20,  # noqa: B023
                    "messages are stored again",
                )
                assert time.monotonic() - begun < LIMIT_S
                wait_until(lambda: viewer.samples > shown, "the viewer goes on")  # noqa: B023
                stack.start_cloud(killed)
            node.stop()
        require_each_once(store, viewer)
        assert viewer.breaks >= 2
