"""A node as a process: samples in the main thread, publishes in another."""

from __future__ import annotations

import logging
import threading
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from eskin.identity import Identity
from eskin.runtime.memory import freeze_gc
from eskin.runtime.stop_signals import stop_on_signals
from eskin.wire.envelope import sign
from eskin.wire.topics import Stream, node_topic
from eskin_sensor_node.link.publisher import Publisher
from eskin_sensor_node.machine.compilation import compiled_inversion
from eskin_sensor_node.machine.node_layout import plan_layout
from eskin_sensor_node.machine.radio import Radio
from eskin_sensor_node.node.commands import CommandReceiver, NodeControls
from eskin_sensor_node.node.factory import build_node, build_outbox, open_flash
from eskin_sensor_node.node.ground_truth import GroundTruth
from eskin_sensor_node.node.offline import warm_up
from eskin_sensor_node.skin_node.controls import SkinControls
from eskin_sensor_node.skin_node.factory import build_skin_node
from eskin_sensor_node.skin_node.factory import warm_up as warm_up_skin

if TYPE_CHECKING:
    from eskin_sensor_node.firmware.outbox import Outbox
    from eskin_sensor_node.machine.clock import Clock
    from eskin_sensor_node.machine.flash.flash import Flash
    from eskin_sensor_node.node.base import BaseNode
    from eskin_sensor_node.node.commands import TypedControls
    from eskin_sensor_node.settings import NodeSettings

log = logging.getLogger(__name__)

_RADIO_STREAM: Final = 0x7AD10
"""Separates the radio's random numbers from all others of a seed."""
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
    stop_on_signals(stop)
    truth = GroundTruth(settings.truth.path, limit=settings.truth.limit_bytes)
    flash = open_flash(settings)
    try:
        serve(settings, flash, truth, stop)
    finally:
        flash.close()
        truth.close()


class _Parts(NamedTuple):
    """A node without its network."""

    node: BaseNode
    clock: Clock
    outbox: Outbox
    controls: TypedControls


def _assemble(settings: NodeSettings, flash: Flash, truth: GroundTruth) -> _Parts:
    if settings.skin.present:
        warm_up_skin(settings)
        skin_node, clock, outbox = build_skin_node(settings, flash=flash, truth=truth)
        return _Parts(skin_node, clock, outbox, SkinControls(skin_node))
    outbox = build_outbox(
        flash,
        capacity=settings.flash.capacity_bytes,
        broker=settings.broker,
        described=plan_layout(settings).described,
    )
    warm_up(settings)
    node, clock = build_node(settings, outbox=outbox, truth=truth, functions=compiled_inversion())
    return _Parts(node, clock, outbox, NodeControls(node))


def serve(settings: NodeSettings, flash: Flash, truth: GroundTruth, stop: threading.Event) -> None:
    """Run a node on a flash until an event is set."""
    own = settings.node
    node, clock, outbox, controls = _assemble(settings, flash, truth)
    truth.store_departures(own.name, settings.departures)
    commander = CommandReceiver(
        outbox,
        own=Identity.load(settings.identity.directory),
        cloud=settings.identity.cloud,
        controls=controls,
        enclosure=lambda: clock.known.enclosure(clock.ticks()),
    )
    commander.start()
    node.at_start = commander.start
    node.gesture_key.report = commander.report
    topic = node_topic(own.name, Stream.COMMANDS)

    def sign_release(plaintext: bytes) -> bytes:
        # Read for each one, so that a renewed key signs.
        return sign(plaintext, own=Identity.load(settings.identity.directory), topic=topic)

    node.gesture_key.sign = sign_release

    def take_command(signed: bytes) -> None:
        with node.paused():
            commander.take(signed)

    publisher = Publisher(
        outbox,
        radio=Radio(
            settings.radio,
            now=clock.now,
            random=np.random.default_rng((truth.seed(own.seed), outbox.boot, _RADIO_STREAM)),
            meter=node.machine.ledger,
            speed=own.speed,
        ),
        broker=settings.broker,
        identity=settings.identity,
        record_status=node.record_status,
        take_command=take_command,
        is_running=lambda: node.machine.running,
    )
    publisher.start()
    freeze_gc()
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
    log.info("stopped: node=%s waiting=%d", own.name, outbox.messages)
