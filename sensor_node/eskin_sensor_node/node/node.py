"""The node without its network: machine, taxels, clock, flash and truth."""

from __future__ import annotations

import logging
import threading
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.errors import FirmwareError
from eskin.wire.messages import Position
from eskin_sensor_node.firmware import inversion, states
from eskin_sensor_node.firmware.attention import Attention
from eskin_sensor_node.firmware.gap_reasons import ASLEEP, OVERRUN, RESET, TEXTS
from eskin_sensor_node.firmware.states import StateMachine
from eskin_sensor_node.kinds.skin_map import skin_map
from eskin_sensor_node.machine.crystal import BILLION
from eskin_sensor_node.machine.machine import Machine
from eskin_sensor_node.machine.prices import message
from eskin_sensor_node.machine.sampling import Sampling
from eskin_sensor_node.node.flash_retry import FlashRetry
from eskin_sensor_node.node.power_manager import keep_energy
from eskin_sensor_node.node.sampling_group import SamplingGroup, build_taxels
from eskin_sensor_node.node.self_test import NodeSelfTest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import ModuleType

    from eskin_sensor_node.firmware.batch import Batch
    from eskin_sensor_node.firmware.message_writer import Record
    from eskin_sensor_node.firmware.outbox import Outbox
    from eskin_sensor_node.machine.clock import Clock
    from eskin_sensor_node.node.ground_truth import GroundTruth, TrueBlock
    from eskin_sensor_node.node.sampling_group import Taken
    from eskin_sensor_node.settings import NodeSettings

log = logging.getLogger(__name__)

_MOST_FRAMES: Final = 64
"""Events of one commit, at most."""


class Node:
    """Samples all taxels into flash.

    Args:
        settings: The node's settings.
        clock: Its clock.
        outbox: Keeps what it says; its boot number is this run's.
        truth: What the emulator keeps for the audit.
        seed: Draws true parts and noise.
        functions: The firmware's arithmetic, or its compiled copy.

    Attributes:
        machine: What the firmware runs on.
        taxels: The sensing elements, in the order of the settings.
        states: What the firmware is about.
        sampling: Its sampling interrupts.
        energy: What it lives on; ``None``: a supply that never ends.
        at_start: Called after each start of the firmware but the first.
    """

    def __init__(
        self,
        settings: NodeSettings,
        *,
        clock: Clock,
        outbox: Outbox,
        truth: GroundTruth,
        seed: int,
        functions: ModuleType = inversion,
    ) -> None:
        self._settings, self._clock, self._seed = settings, clock, seed
        self._outbox, self._truth = outbox, truth
        self._overrun = int(settings.sampling.overrun_s * settings.node.speed * BILLION)
        self._tolerance = FlashRetry()
        self._batch: Batch
        self._true_blocks: list[TrueBlock] = []
        self._working = threading.RLock()
        self.machine = Machine(
            timeout=round(settings.machine.watchdog_s * BILLION),
            clock_hz=settings.machine.clock_hz,
        )
        self.at_start: Callable[[], None] | None = None
        self.taxels = build_taxels(settings, seed=seed, clock=clock, functions=functions)
        self._scan = SamplingGroup(settings.taxel, self.taxels)
        self._map = skin_map(settings.taxel)
        self.energy = keep_energy(
            self, settings, clock=clock, outbox=outbox, truth=truth, seed=seed
        )
        self._boot()

    @property
    def next_due(self) -> int:
        """Machine time in ns at which something happens next."""
        return self.machine.events.next_due

    def advance(self, time: int) -> None:
        """Catch up with a machine time in ns; say so where samples were missed for being late."""
        with self._working:
            if time - self.next_due > self._overrun:
                self._pass_over(time)
            self.run_until(time)

    def run_until(self, time: int) -> None:
        """Do all that happens up to a machine time in ns, as fast as it can."""
        with self._working:
            while self.machine.starting or self.next_due <= time:
                if self.machine.starting:
                    self._start_again()
                with self._tolerance.commit(), self._outbox.batch() as batch:
                    self._batch, self._true_blocks = batch, []
                    self.machine.run(time, _MOST_FRAMES)
                    # Before the flash's commit: every stored block has its truth.
                    if self._true_blocks:
                        name = self._settings.node.name
                        settled = {name: self._outbox.settled}
                        self._truth.store({name: self._true_blocks}, settled)
                    if self.energy is not None:
                        self.energy.keep()
            self.machine.events.pass_to(time)

    @contextmanager
    def still(self) -> Iterator[None]:
        """Hold the machine: nothing happens meanwhile, no sample and no reset."""
        with self._working:
            yield

    def shed(self, cause: str) -> None:
        """Give up sampling and stay in deep sleep until `resume`.

        Args:
            cause: Why: ``states.SCARCE`` or ``states.ORDERED``.
        """
        with self._working:
            if self.machine.running and self.states.state == states.SLEEP:
                self.states.take(cause, self.machine.now - self.machine.booted)
                self.sampling.stop()

    def resume(self) -> None:
        """Sample again, from the next event on; a gap tells of the time between."""
        with self._working:
            self.machine.arm(self.machine.interrupt(self._resume), self.machine.now)

    @contextmanager
    def between_frames(self) -> Iterator[list[Record]]:
        """Hold sampling while taxels are set; takes what they say of it."""
        with self._working:
            said: list[Record] = []
            with self._tolerance.commit(), self._outbox.batch() as batch:
                yield said
                batch.take(said)
            self._line_up()

    def attend(self, seconds: float) -> None:
        """Cut blocks short, from the next ones on: somebody looks on for so many real seconds."""
        span = round(seconds * self._settings.node.speed * BILLION)
        self._attention.hold(self._clock.ticks(), span)

    def record_status(self) -> Position:
        """Put a status into flash.

        Raises:
            FlashError: It could not be written.
        """
        with self._working:
            return self._record_status()

    def finish(self) -> None:
        """Say what stays undecided at the end."""
        with self._tolerance.commit(), self._outbox.batch() as batch:
            for taxel in self.taxels:
                batch.take(taxel.finish())
        if self.energy is not None:
            with self._tolerance.commit():
                self.energy.rest()

    def _record_status(self) -> Position:
        ticks = self._clock.ticks()
        own = self._settings.node
        with self._outbox.batch() as batch:
            status = self._outbox.message_writer.status(
                self._clock.known.enclosure(ticks),
                own.profile,
                own.description or own.profile,
                ticks,
                self._outbox.usage(),
                [channel for taxel in self.taxels for channel in taxel.channels],
                int(self.machine.cause),
                energy=None if self.energy is None else self.energy.manager.told,
                faults=self._examiner.faults,
                places=self._map,
                held=self._outbox.held(),
                ended=self._outbox.ended(),
            )
            batch.take([status])
        size = len(status.body)
        self.machine.ledger.charge_message(message(size), size)
        return Position(self._outbox.boot, status.sequence)

    def _boot(self) -> None:
        """Start the firmware: nothing is left of what its RAM held."""
        self.machine.boot()
        if self.energy is not None:
            self.energy.boot()
        self.states = StateMachine()
        sampling = self._settings.sampling
        self._attention = Attention(round(sampling.watched_block_ms * 1e6))
        for taxel in self.taxels:
            taxel.boot(self._outbox.boot, self._outbox.message_writer, self._attention)
        actions = [partial(self._sample, number) for number in range(len(self.taxels))]
        self.sampling = Sampling(self.machine, actions, self._settings.machine.dma_samples)
        self._scan.boot()
        self._examiner = NodeSelfTest(
            self._settings.taxel, self.taxels, self._clock.known, self._outbox.message_writer
        )
        self._line_up()
        self.states.take(states.STARTED, 0)

    def _start_again(self) -> None:
        """Start after a reset, and tell what was missed."""
        machine, clock = self.machine, self._clock
        stopped, again = (time - machine.booted for time in (machine.stopped, machine.now))
        begin = min(stopped, *(taxel.next.start for taxel in self.taxels))
        earliest = clock.known.enclosure(begin)[0]
        lost = sum(taxel.missed(again) for taxel in self.taxels)
        with self._tolerance.commit():
            self._outbox.restart()
        clock.restart(machine.now, np.random.default_rng((self._seed, self._outbox.boot)))
        self._boot()
        with self._tolerance.commit(), self._outbox.batch() as batch:
            time = earliest, clock.known.enclosure(0)[1]
            batch.take([self._outbox.message_writer.gap(RESET + machine.cause, time, lost)])
        log.warning("machine starts: boot=%d samples_lost=%d", self._outbox.boot, lost)
        if self.at_start is not None:
            self.at_start()

    def _sample(self, number: int) -> None:
        """A frame of a taxel is complete: its interrupt."""
        machine, ticks = self.machine, self.machine.now - self.machine.booted
        self.states.take(states.DUE, ticks)
        self.sampling.complete(number)
        try:
            taken = self._scan.take(number)
        except FirmwareError as error:
            log.error("firmware hangs, the watchdog will reset it: %s", error)  # noqa: TRY400 - says all
            self.states.take(states.FAILED, ticks)
            machine.halt()
            return
        machine.kick()
        self.states.take(states.IDLE, ticks)
        for each in taken:
            self._finish(each)

    def _finish(self, taken: Taken) -> None:
        """A frame is worked off."""
        taxel = self.taxels[taken.number]
        ledger, cycles = self.machine.ledger, taxel.cycles(taken.frame.n)
        ledger.charge_frame(taken.frame, cycles=cycles, inputs=taxel.inputs)
        for record in taken.records:
            ledger.charge_message(taxel.writing(record), len(record.body))
        ledger.charge_repeats(*taxel.reader.repeats)
        self._batch.take([*taken.records, *self._examiner.watch(taken.number, taken.frame.end)])
        self._true_blocks += taken.truth
        self.sampling.arm(taken.number, taxel.next)

    def _resume(self) -> None:
        if self.states.state == states.SHED:
            reason = ASLEEP[self.states.cause]
            ticks = self.machine.now - self.machine.booted
            self.states.take(states.RESUMED, ticks)
            self._leave_out(self._batch, ticks, reason)

    def _pass_over(self, time: int) -> None:
        if time - self.sampling.due <= self._overrun:
            return
        with self._tolerance.commit(), self._outbox.batch() as batch:
            self._leave_out(batch, time - self.machine.booted, OVERRUN)

    def _leave_out(self, batch: Batch, ticks: int, reason: int) -> None:
        """Take no frame that begins before a moment, and say so."""
        known = self._clock.known
        begin = min(taxel.next.start for taxel in self.taxels)
        lost = 0
        for taxel in self.taxels:
            peaks, samples = taxel.skip(ticks)
            batch.take(peaks)
            lost += samples
        self._line_up()
        again = max(taxel.next.start for taxel in self.taxels)
        time = known.enclosure(begin)[0], known.enclosure(again)[1]
        batch.take([self._outbox.message_writer.gap(reason, time, lost)])
        behind = (ticks - begin) / BILLION
        told = TEXTS[reason], lost, behind
        log.warning("samples lost: reason=%s samples=%d span_s=%.3f", *told)

    def _line_up(self) -> None:
        if self.states.state == states.SHED:
            return
        for number, taxel in enumerate(self.taxels):
            self.sampling.arm(number, taxel.next)
