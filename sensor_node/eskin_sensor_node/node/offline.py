"""A node without radio and identity, on a chip that is thrown away; its time is the caller's."""

from __future__ import annotations

import logging
import os
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.errors import FlashError
from eskin.privacy.subject import KEY_BYTES
from eskin_sensor_node.machine.clock import Clock
from eskin_sensor_node.machine.compilation import compiled_inversion
from eskin_sensor_node.machine.compiled_writer import CompiledWriter
from eskin_sensor_node.machine.crystal import BILLION, Crystal
from eskin_sensor_node.machine.flash.flash import Flash
from eskin_sensor_node.node.factory import build_outbox
from eskin_sensor_node.node.ground_truth import GroundTruth
from eskin_sensor_node.node.node import Node

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin_sensor_node.firmware.outbox import Outbox
    from eskin_sensor_node.settings import NodeSettings

log = logging.getLogger(__name__)

_START: Final = 1_790_000_000 * BILLION
"""Any moment: nothing depends on it."""


class OfflineNode:
    """A node that is asked to live for a while.

    Attributes:
        node: What samples.
        flash: Takes what it says.
        outbox: The same, as the firmware sees it.
    """

    def __init__(self, settings: NodeSettings, flash: Flash, truth: GroundTruth) -> None:
        self._now = 0
        self.flash = flash
        self.outbox: Outbox = build_outbox(
            flash, capacity=2**30, broker=settings.broker, message_writer=CompiledWriter
        )
        seed = truth.seed(settings.node.seed)
        random = np.random.default_rng(seed)
        clock = Clock(
            start=_START,
            monotonic=lambda: self._now,
            speed=1.0,
            rtc_error=0,
            drift=0,
            crystal=Crystal(0, random),
            random=random,
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
        """Live up to a machine time in ns, as fast as it can."""
        self._now = time
        self.node.run_until(time)


@contextmanager
def offline_node(settings: NodeSettings) -> Iterator[OfflineNode]:
    """A node that never tires, in a folder of its own.

    Args:
        settings: The node's; its supply never ends.
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
    """Measure and tell the first frame of each taxel: all is compiled before time begins.

    Where there is no room for it, the node begins without, and may be late with its first frames.
    """
    try:
        with offline_node(settings) as rehearsed:
            rehearsed.run_until(max(taxel.next.end for taxel in rehearsed.node.taxels))
    except (FlashError, OSError) as error:
        log.warning("begins without a rehearsal: error=%s", error)
