"""Builds a node from its settings."""

from __future__ import annotations

import logging
import threading
import time
from functools import partial
from typing import TYPE_CHECKING, Final

from eskin.privacy import open_key
from eskin_sensor_node.firmware import inversion
from eskin_sensor_node.firmware.message_writer import MessageWriter
from eskin_sensor_node.firmware.outbox import Outbox
from eskin_sensor_node.kinds.neighbours import measured_around
from eskin_sensor_node.machine.budget import require_flash, require_ram
from eskin_sensor_node.machine.clock import Clock
from eskin_sensor_node.machine.flash.flash import Flash
from eskin_sensor_node.machine.processor import require_speed
from eskin_sensor_node.machine.sampling import require_depth
from eskin_sensor_node.node.node import Node
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import ModuleType

    from eskin_sensor_node.machine.flash.flash import Partition
    from eskin_sensor_node.machine.node_layout import Described
    from eskin_sensor_node.node.ground_truth import GroundTruth
    from eskin_sensor_node.settings import BrokerSection, NodeSettings

log = logging.getLogger(__name__)

REBOOT: Final = BILLION
"""Emulated ns between the last sample of one boot and the first of the next, at least."""


def open_flash(settings: NodeSettings) -> Flash:
    """A node's flash, under the key of its key store.

    Raises:
        FlashError: It cannot be opened.
        PrivacyError: The key cannot be had.
    """
    return Flash(settings.flash.path, node=settings.node.name, key=chip_key(settings))


def chip_key(settings: NodeSettings) -> bytes:
    """The key of a node's flash, or of a fleet's; made at the first start.

    Raises:
        PrivacyError: It cannot be read or made.
        SettingsError: The hardware cannot be used.
    """
    return open_key(settings.keys, settings.chip_keys, f"{settings.node.name}.flash")


def build_outbox(
    flash: Partition, *, capacity: int, broker: BrokerSection, described: Described
) -> Outbox:
    """Put an outbox on a flash, for several threads; its instants are ns.

    Args:
        flash: Keeps messages, and what they are read by.
        capacity: Bytes of messages.
        broker: Where they are sent.
        described: What the node says of its frames.

    Raises:
        FlashError: The flash cannot be written.
    """
    outbox = Outbox(
        flash,
        capacity=capacity,
        window=broker.window,
        resend_after=round(broker.resend_s * BILLION),
        status_every=round(broker.status_s * BILLION),
        message_writer=partial(MessageWriter, layout=described.layout),
        lock=threading.RLock(),
    )
    outbox.describe(*described)
    return outbox


def build_node(
    settings: NodeSettings,
    *,
    outbox: Outbox,
    truth: GroundTruth,
    start: int | None = None,
    functions: ModuleType = inversion,
) -> tuple[Node, Clock]:
    """Put a node together.

    Args:
        settings: Its settings.
        outbox: Holds its messages.
        truth: The ground truth.
        start: True UTC in ns at which emulated time begins; ``None``: now. A node that ran faster
            than real time, or whose machine's clock was set back, starts after its latest sample,
            so that no instant is emulated twice.
        functions: The firmware's arithmetic, or its compiled copy.

    Raises:
        SettingsError: The machine has too little RAM or flash for it, or is too slow.
    """
    require_ram(settings)
    require_flash(settings)
    require_speed(settings, measured_around(settings.taxel))
    require_depth(settings)
    seed = truth.seed(settings.node.seed)
    begin = first_instant(truth, time.time_ns() if start is None else start)
    clock = build_clock(settings, seed=seed, boot=outbox.boot, start=begin)
    node = Node(settings, clock=clock, outbox=outbox, truth=truth, seed=seed, functions=functions)
    return node, clock


def build_clock(
    settings: NodeSettings,
    *,
    seed: int,
    boot: int,
    start: int,
    monotonic: Callable[[], int] = time.monotonic_ns,
    origin: int | None = None,
) -> Clock:
    """A node's clock and its crystal, as wrong as its seed and its boot draw them.

    Args:
        settings: Its settings, which bound how wrong.
        seed: Its own.
        boot: Number of this start.
        start: True UTC at the start, ns.
        monotonic: Real time in ns from any origin.
        origin: Real time at the start, ns; ``None``: now.
    """
    return Clock(
        start=start,
        monotonic=monotonic,
        speed=settings.node.speed,
        rtc_error=round(settings.clock.rtc_error_ms * 1e6),
        drift=round(settings.clock.drift_ppm * 1e3),
        seed=seed,
        boot=boot,
        origin=origin,
    )


def first_instant(truth: GroundTruth, start: int) -> int:
    """True UTC in ns at which emulated time begins: the wanted one, or after the latest sample."""
    end = truth.end()
    if end is None or end + REBOOT <= start:
        return start
    log.warning(
        "emulated time continues after the latest sample: ahead_of_clock_s=%.3f",
        (end + REBOOT - start) / BILLION,
    )
    return end + REBOOT
