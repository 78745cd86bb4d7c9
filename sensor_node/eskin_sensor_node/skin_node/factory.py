"""Builds the node of a large skin from its settings."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from eskin_sensor_node.columns.factory import plan
from eskin_sensor_node.columns.pad_columns import PadColumns
from eskin_sensor_node.firmware.message_writer import MessageWriter
from eskin_sensor_node.machine.budget import require_flash, require_ram
from eskin_sensor_node.machine.clock import Clock
from eskin_sensor_node.machine.node_layout import describe
from eskin_sensor_node.machine.processor import require_speed
from eskin_sensor_node.node.factory import build_clock, build_outbox, first_instant
from eskin_sensor_node.skin_node.frames import FrameWriter
from eskin_sensor_node.skin_node.node import SkinNode

if TYPE_CHECKING:
    from eskin_sensor_node.firmware.outbox import Outbox
    from eskin_sensor_node.machine.flash.flash import Partition
    from eskin_sensor_node.node.ground_truth import GroundTruth
    from eskin_sensor_node.settings import NodeSettings


def build_skin_node(
    settings: NodeSettings, *, flash: Partition, truth: GroundTruth
) -> tuple[SkinNode, Clock, Outbox]:
    """Put a node with a skin together; its time begins now, or after the latest sample.

    Args:
        settings: Its settings.
        flash: Holds its messages.
        truth: The ground truth.

    Raises:
        FlashError: The flash cannot be written.
        SettingsError: The machine has too little RAM or flash for it, or is too slow; or the skin
            cannot be described.
    """
    require_ram(settings)
    require_flash(settings)
    require_speed(settings, {})
    skin = plan(settings)
    outbox = build_outbox(
        flash,
        capacity=settings.flash.capacity_bytes,
        broker=settings.broker,
        described=describe(skin.layout, skin.patches),
    )
    seed = truth.seed(settings.node.seed)
    start = first_instant(truth, time.time_ns())
    clock = build_clock(settings, seed=seed, boot=outbox.boot, start=start)

    def build(boot: int) -> PadColumns:
        return PadColumns(settings.skin, skin, seed=seed, boot=boot, clock=clock)

    node = SkinNode(settings, clock=clock, outbox=outbox, truth=truth, seed=seed, build=build)
    return node, clock, outbox


class _Numbers:
    """Gives every message one number."""

    def next_sequence(self) -> int:
        """The number."""
        return 0


def warm_up(settings: NodeSettings) -> None:
    """Write the first frames of a skin, so that all kernels are compiled."""
    clock = Clock(
        start=0,
        monotonic=lambda: 0,
        speed=1.0,
        rtc_error=0,
        drift=0,
        seed=0,
        boot=0,
    )
    skin = plan(settings)
    columns = PadColumns(settings.skin, skin, seed=0, boot=0, clock=clock)
    frame_writer = FrameWriter(skin.layout, skin.patches)
    message_writer = MessageWriter(0, _Numbers(), skin.layout.content_hash)
    for stretch in columns.advance(columns.next_due):
        for _ in frame_writer.write(stretch, clock.known, message_writer):
            pass
    columns.examine()
