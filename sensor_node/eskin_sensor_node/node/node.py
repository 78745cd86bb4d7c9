"""The node without its network: machine, taxels, clock, flash and truth."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from eskin_sensor_node.firmware import inversion, states
from eskin_sensor_node.firmware.schedule import Attention
from eskin_sensor_node.kinds.neighbours import patches
from eskin_sensor_node.kinds.skin_map import skin_map
from eskin_sensor_node.machine.data_sheet import taxel_coverages
from eskin_sensor_node.machine.sampling import Sampling, most_repeats
from eskin_sensor_node.node.base import BaseNode
from eskin_sensor_node.node.self_test import NodeSelfTest
from eskin_sensor_node.node.taxel import EmulatedTaxel
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import ModuleType

    from eskin_sensor_node.firmware.message_writer import Channel, Record
    from eskin_sensor_node.firmware.outbox import Batch, Outbox
    from eskin_sensor_node.firmware.schedule import Frame
    from eskin_sensor_node.kinds.settings import TaxelSection
    from eskin_sensor_node.machine.clock import Clock
    from eskin_sensor_node.node.ground_truth import GroundTruth, TrueBlock
    from eskin_sensor_node.settings import NodeSettings


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


class Node(BaseNode):
    """Samples all taxels into flash, each at its own rate.

    Args:
        settings: The node's settings.
        clock: Its clock.
        outbox: Takes its messages; its boot number is this run's.
        truth: The ground truth, for the audit.
        seed: Draws true parts and noise.
        functions: The firmware's arithmetic, or its compiled copy.

    Attributes:
        taxels: The sensing elements, in the order of the settings.
        sampling: Its sampling interrupts.
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
        super().__init__(settings, clock=clock, outbox=outbox, truth=truth, seed=seed)
        self.taxels = build_taxels(settings, seed=seed, clock=clock, functions=functions)
        self._sampling_group = SamplingGroup(settings.taxel, self.taxels)
        self._skin_map = skin_map(settings.taxel)
        self._boot()

    def attend(self, seconds: float) -> None:
        """Shorten blocks for so many real seconds: a viewer watches."""
        span = round(seconds * self._settings.node.speed * BILLION)
        self._attention.hold(self._clock.ticks(), span)

    def _boot_sampling(self) -> None:
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
        self._arm()

    @property
    def _sampling_due(self) -> int:
        return self.sampling.due

    def _arm_sampling(self) -> None:
        for number, taxel in enumerate(self.taxels):
            self.sampling.arm(number, taxel.next)

    def _stop_sampling(self) -> None:
        self.sampling.stop()

    def _next_start(self) -> tuple[int, int]:
        starts = [taxel.next.start for taxel in self.taxels]
        return min(starts), max(starts)

    def _missing(self, ticks: int) -> int:
        return sum(taxel.missing(ticks) for taxel in self.taxels)

    def _skip(self, batch: Batch, ticks: int) -> int:
        lost = 0
        for taxel in self.taxels:
            peaks, samples = taxel.skip(ticks)
            batch.take(peaks)
            lost += samples
        return lost

    def _undecided(self) -> Sequence[Record]:
        return [record for taxel in self.taxels for record in taxel.finish()]

    def _set_shedding(self, stage: int) -> None:
        for taxel in self.taxels:
            taxel.control_unit.shed = stage

    def _described(self) -> tuple[Sequence[Channel], Sequence[tuple[str, float, float]]]:
        return [channel for taxel in self.taxels for channel in taxel.channels], self._skin_map

    def _faults(self) -> Sequence[tuple[str, int, int]] | None:
        return self._self_test.faults

    def _sample(self, number: int) -> None:
        """Handle the interrupt of a complete frame."""
        self.states.take(states.DUE, self._ticks)
        self.sampling.complete(number)
        taken = self._work_off(partial(self._sampling_group.take, number))
        for frame in taken or ():
            self._finish(*frame)

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
        self._true += truth
        self.sampling.arm(number, taxel.next)
