"""The node without its network: machine, taxels, clock, flash and truth."""

from __future__ import annotations

import logging
import threading
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.errors import FirmwareError, FlashError
from eskin.wire.messages import Position
from eskin_sensor_node.firmware import inversion, states
from eskin_sensor_node.firmware.energy import SLEEP
from eskin_sensor_node.firmware.gap_reasons import ASLEEP, OVERRUN, RESET, TEXTS
from eskin_sensor_node.firmware.schedule import Attention
from eskin_sensor_node.firmware.states import StateMachine
from eskin_sensor_node.kinds.neighbours import patches
from eskin_sensor_node.kinds.skin_map import skin_map
from eskin_sensor_node.machine.data_sheet import taxel_coverages
from eskin_sensor_node.machine.machine import Machine
from eskin_sensor_node.machine.prices import message
from eskin_sensor_node.machine.sampling import Sampling, most_repeats
from eskin_sensor_node.node.power_manager import PowerManager
from eskin_sensor_node.node.self_test import NodeSelfTest
from eskin_sensor_node.node.taxel import EmulatedTaxel
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from types import ModuleType

    from eskin_sensor_node.firmware.message_writer import Record
    from eskin_sensor_node.firmware.outbox import Batch, Outbox
    from eskin_sensor_node.firmware.schedule import Frame
    from eskin_sensor_node.kinds.settings import TaxelSection
    from eskin_sensor_node.machine.clock import Clock
    from eskin_sensor_node.node.ground_truth import GroundTruth, TrueBlock
    from eskin_sensor_node.settings import NodeSettings


log = logging.getLogger(__name__)

_MOST_FRAMES: Final = 64
"""Events of one commit, at most."""


class FlashRetry:
    """Lets a node continue when a commit fails; the next gap reports what was lost.

    It logs the first failure, and the first success after it.
    """

    def __init__(self) -> None:
        self._failures = 0

    @contextmanager
    def commit(self) -> Iterator[None]:
        """Catch the error of a commit."""
        try:
            yield
        except FlashError as error:
            if self._failures == 0:
                log.error("flash commit failed, sampling continues: error=%s", error)  # noqa: TRY400 - one line
            self._failures += 1
            return
        if self._failures:
            log.warning("flash commit succeeded again: failed_commits=%d", self._failures)
            self._failures = 0


def build_taxels(
    settings: NodeSettings, *, seed: int, clock: Clock, functions: ModuleType
) -> list[EmulatedTaxel]:
    """The taxels of a node, in the order of its settings; arguments as of `node.node`."""
    coverages = taxel_coverages(settings)
    return [
        EmulatedTaxel(
            taxel,
            seed=(seed, number),
            clock=clock,
            sampling=settings.sampling,
            functions=functions,
            companions=settings.companions(taxel, seed),
            coverage=coverages[number],
            repeats=most_repeats(settings, taxel),
        )
        for number, taxel in enumerate(settings.taxel)
    ]


class SamplingGroup:
    """Takes the frames of a node; pads whose frames have the same instants are taken together.

    Args:
        designs: The settings of its taxels.
        taxels: The same, emulated.
    """

    def __init__(self, designs: Sequence[TaxelSection], taxels: Sequence[EmulatedTaxel]) -> None:
        self._taxels = taxels
        self._patches = patches(designs)

    def boot(self) -> None:
        """Give each pad its neighbours, after a boot."""
        units = [taxel.control_unit for taxel in self._taxels]
        for number, patch in self._patches.items():
            units[number].surround([units[k] for k in patch.around], patch.neighbours)

    def take(self, number: int) -> list[tuple[int, Frame, list[Record], list[TrueBlock]]]:
        """Take a taxel's next frame, and with a pad's those of all pads at the same instants.

        Returns:
            Of each: number, frame, messages, and the truth behind its blocks.

        Raises:
            FirmwareError: The firmware failed.
        """
        if number not in self._patches:
            frame = self._taxels[number].next
            return [(number, frame, *self._taxels[number].sample())]
        frame = self._taxels[number].next
        together = [k for k in self._patches if self._taxels[k].next.meets(frame)]
        for k in together:
            self._taxels[k].measure()
        for k in together:
            self._taxels[k].separate()
        return [(k, self._taxels[k].next, *self._taxels[k].report()) for k in together]


class Node:
    """Samples all taxels into flash.

    Args:
        settings: The node's settings.
        clock: Its clock.
        outbox: Takes its messages; its boot number is this run's.
        truth: The ground truth, for the audit.
        seed: Draws true parts and noise.
        functions: The firmware's arithmetic, or its compiled copy.

    Attributes:
        machine: What the firmware runs on.
        taxels: The sensing elements, in the order of the settings.
        states: The firmware's state machine.
        sampling: Its sampling interrupts.
        energy: Its power manager; ``None``: the supply never ends.
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
        self._flash_retry = FlashRetry()
        self._batch: Batch
        self._true_blocks: list[TrueBlock] = []
        self._working = threading.RLock()
        self.machine = Machine(
            timeout=round(settings.machine.watchdog_s * BILLION),
            clock_hz=settings.machine.clock_hz,
        )
        self.at_start: Callable[[], None] | None = None
        self.taxels = build_taxels(settings, seed=seed, clock=clock, functions=functions)
        self._sampling_group = SamplingGroup(settings.taxel, self.taxels)
        self._skin_map = skin_map(settings.taxel)
        self.energy = (
            PowerManager(
                self.machine,
                settings,
                clock=clock,
                outbox=outbox,
                truth=truth,
                seed=seed,
                on_stage=self._set_stage,
            )
            if settings.energy.on
            else None
        )
        self._boot()

    @property
    def next_due(self) -> int:
        """Machine time in ns at which something happens next."""
        return self.machine.events.next_due

    def advance(self, time: int) -> None:
        """Catch up with a machine time in ns; a gap reports samples that were missed."""
        with self._working:
            if time - self.next_due > self._overrun:
                self._skip_overrun(time)
            self.run_until(time)

    def run_until(self, time: int) -> None:
        """Run all events up to a machine time in ns, as fast as possible."""
        with self._working:
            while self.machine.starting or self.next_due <= time:
                if self.machine.starting:
                    self._restart()
                with self._flash_retry.commit(), self._outbox.batch() as batch:
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
    def paused(self) -> Iterator[None]:
        """Hold the machine: no sample and no reset happens meanwhile."""
        with self._working:
            yield

    def shed(self, cause: str) -> None:
        """Stop sampling and stay in deep sleep until `resume`.

        Args:
            cause: Why: ``states.SCARCE`` or ``states.ORDERED``.
        """
        with self._working:
            if self.machine.running and self.states.state == states.SLEEP:
                self.states.take(cause, self.machine.now - self.machine.booted)
                self.sampling.stop()

    def resume(self) -> None:
        """Sample again, from the next event on; a gap reports the time between."""
        with self._working:
            self.machine.arm(self.machine.interrupt(self._resume), self.machine.now)

    @contextmanager
    def between_frames(self) -> Iterator[list[Record]]:
        """Hold sampling while taxels are set; takes the messages that this causes."""
        with self._working:
            records: list[Record] = []
            with self._flash_retry.commit(), self._outbox.batch() as batch:
                yield records
                batch.take(records)
            self._arm_all()

    def attend(self, seconds: float) -> None:
        """Shorten blocks for so many real seconds: a viewer watches."""
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
        """Store what stays undecided at the end."""
        with self._flash_retry.commit(), self._outbox.batch() as batch:
            for taxel in self.taxels:
                batch.take(taxel.finish())
        if self.energy is not None:
            with self._flash_retry.commit():
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
                energy=None if self.energy is None else self.energy.manager.status,
                faults=self._self_test.faults,
                places=self._skin_map,
                held=self._outbox.held(),
                ended=self._outbox.ended(),
            )
            batch.take([status])
        size = len(status.body)
        self.machine.ledger.charge_message(message(size), size)
        return Position(self._outbox.boot, status.sequence)

    def _boot(self) -> None:
        """Start the firmware with an empty RAM."""
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
        self._sampling_group.boot()
        self._self_test = NodeSelfTest(
            self._settings.taxel, self.taxels, self._clock.known, self._outbox.message_writer
        )
        self._arm_all()
        self.states.take(states.STARTED, 0)

    def _set_stage(self, stage: int, before: int) -> None:
        for taxel in self.taxels:
            taxel.control_unit.shed = stage
        if stage == SLEEP:
            self.shed(states.SCARCE)
        elif before == SLEEP:
            self.resume()

    def _restart(self) -> None:
        """Start after a reset, and report what was missed."""
        machine, clock = self.machine, self._clock
        stopped, again = (time - machine.booted for time in (machine.stopped, machine.now))
        begin = min(stopped, *(taxel.next.start for taxel in self.taxels))
        earliest = clock.known.enclosure(begin)[0]
        lost = sum(taxel.missing(again) for taxel in self.taxels)
        with self._flash_retry.commit():
            self._outbox.restart()
        clock.restart(machine.now, np.random.default_rng((self._seed, self._outbox.boot)))
        self._boot()
        with self._flash_retry.commit(), self._outbox.batch() as batch:
            time = earliest, clock.known.enclosure(0)[1]
            batch.take([self._outbox.message_writer.gap(RESET + machine.cause, time, lost)])
        log.warning("machine starts: boot=%d samples_lost=%d", self._outbox.boot, lost)
        if self.at_start is not None:
            self.at_start()

    def _sample(self, number: int) -> None:
        """Handle the interrupt of a complete frame."""
        machine, ticks = self.machine, self.machine.now - self.machine.booted
        self.states.take(states.DUE, ticks)
        self.sampling.complete(number)
        try:
            frames = self._sampling_group.take(number)
        except FirmwareError as error:
            log.error("firmware hangs: error=%s", error)  # noqa: TRY400 - one line
            self.states.take(states.FAILED, ticks)
            machine.halt()
            return
        machine.kick()
        self.states.take(states.IDLE, ticks)
        for taken in frames:
            self._finish(*taken)

    def _finish(
        self, number: int, frame: Frame, records: list[Record], truth: list[TrueBlock]
    ) -> None:
        """Charge, store and schedule after a frame."""
        taxel = self.taxels[number]
        ledger, cycles = self.machine.ledger, taxel.cycles(frame.n)
        ledger.charge_frame(frame, cycles=cycles, inputs=taxel.inputs)
        for record in records:
            ledger.charge_message(taxel.message_cycles(record), len(record.body))
        ledger.charge_repeats(*taxel.reader.repeats)
        self._batch.take([*records, *self._self_test.watch(number, frame.end)])
        self._true_blocks += truth
        self.sampling.arm(number, taxel.next)

    def _resume(self) -> None:
        if self.states.state == states.SHED:
            reason = ASLEEP[self.states.cause]
            ticks = self.machine.now - self.machine.booted
            self.states.take(states.RESUMED, ticks)
            self._skip_frames(self._batch, ticks, reason)

    def _skip_overrun(self, time: int) -> None:
        if time - self.sampling.due <= self._overrun:
            return
        with self._flash_retry.commit(), self._outbox.batch() as batch:
            self._skip_frames(batch, time - self.machine.booted, OVERRUN)

    def _skip_frames(self, batch: Batch, ticks: int, reason: int) -> None:
        """Skip all frames that begin before a moment, and record a gap."""
        known = self._clock.known
        begin = min(taxel.next.start for taxel in self.taxels)
        lost = 0
        for taxel in self.taxels:
            peaks, samples = taxel.skip(ticks)
            batch.take(peaks)
            lost += samples
        self._arm_all()
        again = max(taxel.next.start for taxel in self.taxels)
        time = known.enclosure(begin)[0], known.enclosure(again)[1]
        batch.take([self._outbox.message_writer.gap(reason, time, lost)])
        behind = (ticks - begin) / BILLION
        log.warning("samples lost: reason=%s samples=%d span_s=%.3f", TEXTS[reason], lost, behind)

    def _arm_all(self) -> None:
        if self.states.state == states.SHED:
            return
        for number, taxel in enumerate(self.taxels):
            self.sampling.arm(number, taxel.next)
