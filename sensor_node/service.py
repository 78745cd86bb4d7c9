"""A node as a process: samples in the main thread, publishes in another."""

from __future__ import annotations

import logging
import signal
import threading
import time
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.identity import Identity
from eskin.privacy import open_key
from sensor_node.callbacks import Callbacks
from sensor_node.commands import Commander
from sensor_node.controls import NodeControls
from sensor_node.firmware.outbox import Outbox
from sensor_node.flash import Flash
from sensor_node.machine.budget import require_fit
from sensor_node.machine.clock import Clock
from sensor_node.machine.crystal import BILLION, Crystal
from sensor_node.machine.program import require_flash
from sensor_node.machine.radio import Radio
from sensor_node.machine.sampling import require_depth
from sensor_node.node import Node
from sensor_node.publisher import Publisher
from sensor_node.truth import Truth

if TYPE_CHECKING:
    from types import FrameType

    from sensor_node.settings import BrokerSection, NodeSettings

log = logging.getLogger(__name__)

REBOOT: Final = BILLION
"""Emulated ns between the last sample of one boot and the first of the next, at least."""
_OF_RADIO: Final = 0x7AD10
"""Tells the radio's random numbers from all others of a seed."""
_SHORTEST_TICK_S: Final = 0.005
_SHORTEST_FAST_TICK_S: Final = 0.05
"""A fast emulation takes several frames in one commit."""


def run(settings: NodeSettings) -> None:
    """Run until SIGTERM or SIGINT.

    Raises:
        FlashError: Flash or truth cannot be opened.
        IdentityError: A key or certificate cannot be used.
        PrivacyError: The key of the flash cannot be had.
    """
    stop = threading.Event()

    def end(number: int, _frame: FrameType | None) -> None:
        log.info("ending: signal=%s", signal.Signals(number).name)
        stop.set()

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, end)
    truth = Truth(settings.truth.path, limit=settings.truth.limit_bytes)
    flash = open_flash(settings)
    try:
        outbox = build_outbox(flash, capacity=settings.flash.capacity_bytes, broker=settings.broker)
        _serve(settings, outbox, truth, stop)
    finally:
        flash.close()
        truth.close()


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


def build_outbox(flash: Flash, *, capacity: int, broker: BrokerSection) -> Outbox:
    """Put an outbox on a flash, for several threads; its moments are ns."""
    return Outbox(
        flash,
        capacity=capacity,
        window=broker.window,
        resend_after=round(broker.resend_s * BILLION),
        status_every=round(broker.status_s * BILLION),
        lock=threading.RLock(),
    )


def build_node(
    settings: NodeSettings, *, outbox: Outbox, truth: Truth, start: int | None = None
) -> tuple[Node, Clock]:
    """Put a node together.

    Args:
        settings: Its settings.
        outbox: What it says waits here.
        truth: What the emulator keeps.
        start: True UTC in ns at which emulated time begins; ``None``: now. A node that ran faster
            than real time, or whose machine's clock was set back, starts after its latest sample,
            so that no moment is lived twice.

    Raises:
        SettingsError: The machine has too little RAM or flash for it, or is too slow.
    """
    require_fit(settings)
    require_flash(settings)
    require_depth(settings)
    seed = truth.seed(settings.node.seed)
    random = np.random.default_rng((seed, outbox.boot))
    drift = round(settings.clock.drift_ppm * 1e3)
    clock = Clock(
        start=_begin(truth, time.time_ns() if start is None else start),
        monotonic=time.monotonic_ns,
        speed=settings.node.speed,
        rtc_error=round(settings.clock.rtc_error_ms * 1e6),
        drift=drift,
        crystal=Crystal(drift, random),
        random=random,
    )
    return Node(settings, clock=clock, outbox=outbox, truth=truth, seed=seed), clock


def _begin(truth: Truth, start: int) -> int:
    end = truth.end()
    if end is None or end + REBOOT <= start:
        return start
    log.warning(
        "emulated time goes on after the latest sample: ahead_of_clock_s=%.3f",
        (end + REBOOT - start) / BILLION,
    )
    return end + REBOOT


def _serve(settings: NodeSettings, outbox: Outbox, truth: Truth, stop: threading.Event) -> None:
    own = settings.node
    node, clock = build_node(settings, outbox=outbox, truth=truth)
    commander = Commander(
        outbox,
        own=Identity.load(settings.identity.directory),
        cloud=settings.identity.cloud,
        controls=NodeControls(node),
        enclosure=lambda: clock.known.enclosure(clock.ticks()),
    )
    commander.start()
    node.at_start = commander.start

    def take_command(signed: bytes) -> None:
        with node.still():
            commander.take(signed)

    publisher = Publisher(
        outbox,
        node=Callbacks(
            node.record_status, take_command, node.attend, is_running=lambda: node.machine.running
        ),
        radio=Radio(
            settings.radio,
            now=clock.now,
            random=np.random.default_rng((truth.seed(own.seed), outbox.boot, _OF_RADIO)),
            meter=node.machine.ledger,
        ),
        speed=own.speed,
        broker=settings.broker,
        identity=settings.identity,
    )
    publisher.start()
    log.info("running: node=%s boot=%d speed=%g", own.name, outbox.boot, own.speed)
    shortest = _SHORTEST_TICK_S if own.speed <= 1.0 else _SHORTEST_FAST_TICK_S
    while not stop.is_set():
        wait = max(clock.seconds_until(node.next_due), shortest)
        if stop.wait(wait):
            break
        node.advance(clock.now())
        publisher.notify()
    node.finish()
    publisher.notify()
    publisher.stop()
    log.info("ended: node=%s waiting=%d", own.name, outbox.messages)
