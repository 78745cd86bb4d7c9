"""A node without radio and identity, on a temporary chip, in the caller's time."""

from __future__ import annotations

import logging
import os
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

from eskin.errors import FlashError
from eskin.privacy.subject import KEY_BYTES
from eskin_sensor_node.machine.clock import Clock
from eskin_sensor_node.machine.compilation import compiled_inversion
from eskin_sensor_node.machine.flash.flash import Flash
from eskin_sensor_node.machine.node_layout import plan_layout
from eskin_sensor_node.node.factory import build_outbox
from eskin_sensor_node.node.ground_truth import GroundTruth
from eskin_sensor_node.node.node import Node
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin_sensor_node.firmware.outbox import Outbox
    from eskin_sensor_node.settings import NodeSettings

log = logging.getLogger(__name__)

_START: Final = 1_790_000_000 * BILLION
"""Any time: nothing depends on it."""


class OfflineNode:
    """A node whose time the caller sets.

    Attributes:
        node: The node.
        flash: Stores its messages.
        outbox: The firmware's outbox on that flash.
    """

    def __init__(self, settings: NodeSettings, flash: Flash, truth: GroundTruth) -> None:
        self._now = 0
        self.flash = flash
        self.layout = plan_layout(settings)
        self.outbox: Outbox = build_outbox(
            flash,
            capacity=2**30,
            broker=settings.broker,
            described=self.layout.described,
        )
        seed = truth.seed(settings.node.seed)
        clock = Clock(
            start=_START,
            monotonic=lambda: self._now,
            speed=1.0,
            rtc_error=0,
            drift=0,
            seed=seed,
            boot=self.outbox.boot,
        )
        self.node = Node(
            settings,
            clock=clock,
            outbox=self.outbox,
            truth=truth,
            seed=seed,
            functions=compiled_inversion(),
        )

    def run_until(self, time: int) -> None:
        """Run up to a machine time in ns, as fast as possible."""
        self._now = time
        self.node.run_until(time)


@contextmanager
def offline_node(settings: NodeSettings) -> Iterator[OfflineNode]:
    """A node with unlimited energy, in a temporary folder.

    Args:
        settings: The node's.
    """
    unlimited = settings.model_copy(
        update={"energy": settings.energy.model_copy(update={"on": False})}
    )
    with tempfile.TemporaryDirectory() as folder:
        truth = GroundTruth(Path(folder) / "truth.sqlite", limit=2**24)
        name, key = settings.node.name, os.urandom(KEY_BYTES)
        flash = Flash(Path(folder) / "flash.sqlite", node=name, key=key)
        try:
            yield OfflineNode(unlimited, flash, truth)
        finally:
            flash.close()
            truth.close()


def warm_up(settings: NodeSettings) -> None:
    """Process the first frame of each taxel, so that all kernels are compiled.

    If the disk is full the node starts without, and its first frames may be late.
    """
    try:
        with offline_node(settings) as offline:
            offline.run_until(max(taxel.next.due for taxel in offline.node.taxels))
    except (FlashError, OSError) as error:
        log.warning("warm-up skipped: error=%s", error)
