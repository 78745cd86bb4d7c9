"""A whole emulated node, as a process runs it, in a thread."""

from __future__ import annotations

from contextlib import contextmanager
from threading import Event, Thread
from typing import TYPE_CHECKING

from eskin_sensor_node.node.ground_truth import GroundTruth
from eskin_sensor_node.service import serve

from tests.unit.sensor_node.flashes import open_flash

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin_sensor_node.settings import NodeSettings


@contextmanager
def serving(node: NodeSettings, *, epoch: int | None = 1) -> Iterator[None]:
    """Run a node on its flash and truth; ``epoch`` as of `open_flash`."""
    stop = Event()
    truth = GroundTruth(node.truth.path, limit=node.truth.limit_bytes)
    flash = open_flash(node.flash.path, epoch=epoch, node=node.node.name)
    thread = Thread(target=serve, args=(node, flash, truth, stop))
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()
        flash.close()
        truth.close()
