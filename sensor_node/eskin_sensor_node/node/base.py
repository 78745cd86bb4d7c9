"""What all nodes have: firmware that runs on a machine, commits, resets, sleep, status."""

from __future__ import annotations

import logging
import threading
from abc import ABC, abstractmethod
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final, TypeVar

from eskin.errors import FirmwareError, FlashError
from eskin.wire.messages import Position
from eskin_sensor_node.firmware import states
from eskin_sensor_node.firmware.energy import SLEEP
from eskin_sensor_node.firmware.gap_reasons import ASLEEP, OVERRUN, RESET, TEXTS
from eskin_sensor_node.firmware.states import StateMachine
from eskin_sensor_node.machine.machine import Machine
from eskin_sensor_node.machine.prices import message
from eskin_sensor_node.node.gesture_key import GestureKey
from eskin_sensor_node.node.power_manager import PowerManager
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from eskin_sensor_node.firmware.message_writer import Record
    from eskin_sensor_node.firmware.outbox import Batch, Outbox
    from eskin_sensor_node.machine.clock import Clock
    from eskin_sensor_node.node.ground_truth import GroundTruth, TrueFrame
    from eskin_sensor_node.settings import NodeSettings

log = logging.getLogger(__name__)

_MOST_EVENTS: Final = 64
"""Of one commit."""
T = TypeVar("T")


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


class BaseNode(ABC):
    """Runs the firmware's events on a machine, and commits its messages to flash.

    Args:
        settings: The node's settings.
        clock: Its clock.
        outbox: Takes its messages; its boot number is this run's.
        truth: The ground truth, for the audit.
        seed: Draws true parts and noise.

    Attributes:
        machine: What the firmware runs on.
        states: The firmware's state machine.
        gesture_key: What signs challenges.
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
    ) -> None:
        self._settings, self._clock, self._seed = settings, clock, seed
        self._outbox, self._truth = outbox, truth
        self._overrun = int(settings.sampling.overrun_s * settings.node.speed * BILLION)
        self._flash_retry = FlashRetry()
        self._batch: Batch
        self._true: list[TrueFrame] = []
        self._working = threading.RLock()
        self.machine = Machine(
            timeout=round(settings.machine.watchdog_s * BILLION),
            clock_hz=settings.machine.clock_hz,
        )
        self.gesture_key = GestureKey(
            settings.gesture_key,
            settings.node.name,
            lambda: clock.known.enclosure(self._ticks),
        )
        self.at_start: Callable[[], None] | None = None
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
                    self._batch, self._true = batch, []
                    self.machine.run(time, _MOST_EVENTS)
                    # Before the flash's commit: what is stored has its truth.
                    if self._true:
                        name = self._settings.node.name
                        self._truth.store({name: self._true}, {name: self._outbox.settled})
                    if self.energy is not None:
                        self.energy.keep()
                self.gesture_key.settle(self._ticks)
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
                self.states.take(cause, self._ticks)
                self._stop_sampling()

    def resume(self) -> None:
        """Sample again, from the next event on; a gap reports the time between."""
        with self._working:
            self.machine.arm(self.machine.interrupt(self._resume), self.machine.now)

    @contextmanager
    def between_frames(self) -> Iterator[list[Record]]:
        """Hold sampling while the node is set; takes the messages that this causes."""
        with self._working:
            records: list[Record] = []
            with self._flash_retry.commit(), self._outbox.batch() as batch:
                yield records
                batch.take(records)
            self._arm()

    def challenge(self, nonce: str) -> None:
        """Await the gestures of the node's key, to sign a nonce.

        Raises:
            CommandError: It has no key, or is locked.
        """
        with self._working:
            self.gesture_key.challenge(nonce, self._ticks)

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
            batch.take(self._undecided())
        if self.energy is not None:
            with self._flash_retry.commit():
                self.energy.rest()

    # What a kind of node does in its own way.

    @abstractmethod
    def _boot_sampling(self) -> None:
        """Prepare sampling with an empty RAM, and arm it."""

    @property
    @abstractmethod
    def _sampling_due(self) -> int:
        """Machine time in ns at which samples are complete next; `NEVER` while sampling rests."""

    @abstractmethod
    def _arm_sampling(self) -> None:
        """Let the interrupts of all samples come that are due next."""

    @abstractmethod
    def _stop_sampling(self) -> None:
        """Let no interrupt of samples come."""

    @abstractmethod
    def _next_start(self) -> tuple[int, int]:
        """Ticks of the next sample: of the first channel and of the last one that has any."""

    @abstractmethod
    def _missing(self, ticks: int) -> int:
        """How many samples were due before an instant, and were not taken."""

    @abstractmethod
    def _skip(self, batch: Batch, ticks: int) -> int:
        """Skip all samples before an instant; gives how many."""

    def _undecided(self) -> Sequence[Record]:
        """What stays undecided at the end."""
        return ()

    @abstractmethod
    def _set_shedding(self, stage: int) -> None:
        """Shed load in a stage of `eskin_sensor_node.firmware.energy`."""

    def _faults(self) -> Sequence[tuple[str, int, int]] | None:
        """Taxels that may be broken; ``None``: none is looked for, or none known yet."""
        return None

    # What all have in common.

    @property
    def _ticks(self) -> int:
        return self.machine.now - self.machine.booted

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
                int(self.machine.cause),
                energy=None if self.energy is None else self.energy.manager.status,
                faults=self._faults(),
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
        self.gesture_key.boot()
        self._boot_sampling()
        self.states.take(states.STARTED, 0)

    def _set_stage(self, stage: int, before: int) -> None:
        self._set_shedding(stage)
        if stage == SLEEP:
            self.shed(states.SCARCE)
        elif before == SLEEP:
            self.resume()

    def _restart(self) -> None:
        """Start after a reset, and report what was missed."""
        machine, clock = self.machine, self._clock
        stopped, again = (time - machine.booted for time in (machine.stopped, machine.now))
        begin = min(stopped, self._next_start()[0])
        earliest = clock.known.enclosure(begin)[0]
        lost = self._missing(again)
        with self._flash_retry.commit():
            self._outbox.restart()
        clock.restart(machine.now, self._outbox.boot)
        self._boot()
        with self._flash_retry.commit(), self._outbox.batch() as batch:
            time = earliest, clock.known.enclosure(0)[1]
            batch.take([self._outbox.message_writer.gap(RESET + machine.cause, time, lost)])
        log.warning("machine starts: boot=%d samples_lost=%d", self._outbox.boot, lost)
        if self.at_start is not None:
            self.at_start()

    def _work_off(self, take: Callable[[], T]) -> T | None:
        """Let the firmware work off samples that are complete; ``None`` if it failed, and hangs."""
        machine, ticks = self.machine, self._ticks
        try:
            taken = take()
        except FirmwareError as error:
            log.error("firmware hangs: error=%s", error)  # noqa: TRY400 - one line
            self.states.take(states.FAILED, ticks)
            machine.halt()
            return None
        machine.kick()
        self.states.take(states.IDLE, ticks)
        return taken

    def _resume(self) -> None:
        if self.states.state == states.SHED:
            reason = ASLEEP[self.states.cause]
            self.states.take(states.RESUMED, self._ticks)
            self._skip_samples(self._batch, self._ticks, reason)

    def _skip_overrun(self, time: int) -> None:
        if time - self._sampling_due <= self._overrun:
            return
        with self._flash_retry.commit(), self._outbox.batch() as batch:
            self._skip_samples(batch, time - self.machine.booted, OVERRUN)

    def _skip_samples(self, batch: Batch, ticks: int, reason: int) -> None:
        """Skip all samples that begin before an instant, and record a gap."""
        known = self._clock.known
        begin = self._next_start()[0]
        lost = self._skip(batch, ticks)
        self._arm()
        time = known.enclosure(begin)[0], known.enclosure(self._next_start()[1])[1]
        batch.take([self._outbox.message_writer.gap(reason, time, lost)])
        behind = (ticks - begin) / BILLION
        log.warning("samples lost: reason=%s samples=%d span_s=%.3f", TEXTS[reason], lost, behind)

    def _arm(self) -> None:
        if self.states.state != states.SHED:
            self._arm_sampling()
