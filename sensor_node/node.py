"""The node without its network: taxels, clock, flash and truth."""

from __future__ import annotations

import heapq
import logging
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from eskin.errors import FlashError
from eskin.messages import Position
from sensor_node.emulation import EmulatedTaxel
from sensor_node.firmware import inversion
from sensor_node.firmware.record import Record, Scribe
from sensor_node.firmware.selftest import CERTAIN, SelfTest
from sensor_node.machine.crystal import BILLION
from sensor_node.neighbours import neighbours

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import ModuleType

    from sensor_node.batch import Batch
    from sensor_node.flash import Flash
    from sensor_node.machine.clock import Clock
    from sensor_node.settings import NodeSettings
    from sensor_node.truth import Truth

log = logging.getLogger(__name__)

OVERRUN: Final = "sampling overrun"
SELF_TEST: Final = 20 * BILLION
"""Ticks of a window in which stuck and dead taxels are looked for."""
_MOST_FRAMES: Final = 64
"""Frames of one commit."""


class Node:
    """Samples all taxels into flash.

    Args:
        settings: The node's settings.
        clock: Its clock.
        flash: Its outbox; its boot number is this run's.
        truth: What the emulator keeps for the audit.
        seed: Draws true parts and noise.
        functions: The firmware's arithmetic, or its compiled copy.
    """

    def __init__(
        self,
        settings: NodeSettings,
        *,
        clock: Clock,
        flash: Flash,
        truth: Truth,
        seed: int,
        functions: ModuleType = inversion,
    ) -> None:
        self._settings = settings
        self._clock = clock
        self._flash = flash
        self._truth = truth
        self._overrun = int(settings.sampling.overrun_s * settings.node.speed * BILLION)
        self._failures = 0
        self._scribe = Scribe(flash.boot, flash)
        self.taxels = [
            EmulatedTaxel(
                taxel,
                seed=(seed, number),
                noise_seed=(seed, number, flash.boot),
                clock=clock,
                sampling=settings.sampling,
                scribe=self._scribe,
                boot=flash.boot,
                functions=functions,
            )
            for number, taxel in enumerate(settings.taxel)
        ]
        self._self_test = SelfTest(neighbours(settings.taxel))
        self._tested = 0
        self._broken: set[str] = set()
        self._working = threading.RLock()
        self._line_up()

    @property
    def next_due(self) -> int:
        """Ticks at which the next frame is complete."""
        return self._due[0][0]

    def advance(self, ticks: int) -> None:
        """Take all frames that are complete by now; say so where some were missed."""
        with self._working:
            if ticks - self.next_due > self._overrun:
                self._pass_over(ticks)
            while self.next_due <= ticks:
                with self._tolerant(), self._flash.batch() as batch:
                    self._take(batch, ticks)

    @contextmanager
    def between_frames(self) -> Iterator[list[Record]]:
        """Hold sampling while taxels are set; takes what they say of it."""
        with self._working:
            said: list[Record] = []
            with self._tolerant(), self._flash.batch() as batch:
                yield said
                batch.take(said)
            self._line_up()

    def record_status(self) -> Position:
        """Put a status into flash.

        Raises:
            FlashError: It could not be written.
        """
        ticks = self._clock.ticks()
        own, usage = self._settings.node, self._flash.usage()
        with self._flash.batch() as batch:
            status = self._scribe.status(
                self._clock.known.enclosure(ticks),
                own.profile,
                own.description or own.profile,
                ticks,
                (usage.messages, usage.used, usage.capacity, usage.gaps),
                [channel for taxel in self.taxels for channel in taxel.channels],
            )
            batch.take([status])
        return Position(self._flash.boot, status.sequence)

    def finish(self) -> None:
        """Say what stays undecided at the end."""
        with self._tolerant(), self._flash.batch() as batch:
            for taxel in self.taxels:
                batch.take(taxel.finish())

    def _take(self, batch: Batch, ticks: int) -> None:
        true_blocks = []
        for _ in range(_MOST_FRAMES):
            end, number = self._due[0]
            if end > ticks:
                break
            taxel = self.taxels[number]
            records, truth = taxel.sample()
            batch.take(records)
            true_blocks += truth
            taxel.show(number, self._self_test)
            if end - self._tested >= SELF_TEST:
                batch.take(self._examine(end))
            heapq.heapreplace(self._due, (taxel.next.end, number))
        # Before the flash's commit: every stored block has its truth.
        self._truth.store(true_blocks)

    def _examine(self, ticks: int) -> list[Record]:
        """Tell of taxels that are certainly broken, each once, at the end of a window."""
        known = self._clock.known
        time = known.enclosure(self._tested)[0], known.enclosure(ticks)[1]
        self._tested = ticks
        said = []
        for taxel, (dead, stuck) in zip(self.taxels, self._self_test.examine(), strict=True):
            if CERTAIN in (dead, stuck) and taxel.name not in self._broken:
                self._broken.add(taxel.name)
                kind = "dead" if dead == CERTAIN else "stuck"
                said.append(self._scribe.gap(f"{taxel.name} certainly {kind}", time, 0))
        return said

    def _pass_over(self, ticks: int) -> None:
        begin = min(taxel.next.start for taxel in self.taxels)
        with self._tolerant(), self._flash.batch() as batch:
            lost = 0
            for taxel in self.taxels:
                peaks, samples = taxel.skip(ticks)
                batch.take(peaks)
                lost += samples
            self._line_up()
            again = max(taxel.next.start for taxel in self.taxels)
            known = self._clock.known
            time = known.enclosure(begin)[0], known.enclosure(again)[1]
            batch.take([self._scribe.gap(OVERRUN, time, lost)])
            log.warning(
                "samples lost: reason=%s samples=%d behind_s=%.3f",
                OVERRUN,
                lost,
                (ticks - begin) / BILLION,
            )

    def _line_up(self) -> None:
        self._due = [(taxel.next.end, number) for number, taxel in enumerate(self.taxels)]
        heapq.heapify(self._due)

    @contextmanager
    def _tolerant(self) -> Iterator[None]:
        """Let sampling go on when a commit fails; the next gap tells what was lost."""
        try:
            yield
        except FlashError as error:
            if self._failures == 0:
                log.error("flash fails, sampling goes on: error=%s", error)  # noqa: TRY400 - says all
            self._failures += 1
            return
        if self._failures:
            log.warning("flash works again: failed_commits=%d", self._failures)
            self._failures = 0
