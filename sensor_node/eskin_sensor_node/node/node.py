"""The node without its network: machine, taxels, clock, flash and truth."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from eskin.wire.messages import Position
from eskin_sensor_node.columns.sensing import SensingColumns
from eskin_sensor_node.firmware import inversion, states
from eskin_sensor_node.firmware.assembler import Assembler, encode
from eskin_sensor_node.kinds.neighbours import patches
from eskin_sensor_node.machine.compiled_samples import compiled_encode
from eskin_sensor_node.machine.data_sheet import taxel_coverages
from eskin_sensor_node.machine.node_layout import NodeLayout, plan_layout
from eskin_sensor_node.machine.prices import message
from eskin_sensor_node.machine.sampling import SamplingInterrupts, most_repeats
from eskin_sensor_node.node.base import BaseNode
from eskin_sensor_node.node.ground_truth import TrueFrame
from eskin_sensor_node.node.reflexes import NodeReflexes
from eskin_sensor_node.node.self_test import NodeSelfTest
from eskin_sensor_node.node.taxel import EmulatedTaxel, TaxelGroup, TruePart
from eskin_sensor_node.world.scenario.fit import Staged

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import ModuleType

    from eskin.interval import Floats
    from eskin_sensor_node.firmware.assembler import Matrix
    from eskin_sensor_node.firmware.message_writer import Record
    from eskin_sensor_node.firmware.outbox import Batch, Outbox
    from eskin_sensor_node.firmware.schedule import Frame
    from eskin_sensor_node.kinds.settings import TaxelSection
    from eskin_sensor_node.machine.clock import Clock
    from eskin_sensor_node.node.ground_truth import GroundTruth
    from eskin_sensor_node.settings import NodeSettings


def build_taxels(
    settings: NodeSettings,
    layout: NodeLayout,
    *,
    seed: int,
    clock: Clock,
    functions: ModuleType,
) -> list[EmulatedTaxel]:
    """The taxels of a node, in the order of its settings; arguments as of `node.node`."""
    coverages, places = taxel_coverages(settings), group_taxels(settings, seed=seed, clock=clock)
    return [
        EmulatedTaxel(
            taxel,
            group=group,
            column=column,
            clock=clock,
            sampling=settings.sampling,
            columns=layout.columns[number],
            most=layout.most[number],
            functions=functions,
            companions=settings.companions(taxel),
            coverage=coverages[number],
            repeats=most_repeats(settings, taxel),
        )
        for number, (taxel, (group, column)) in enumerate(zip(settings.taxel, places, strict=True))
    ]


def group_taxels(
    settings: NodeSettings, *, seed: int, clock: Clock
) -> list[tuple[TaxelGroup, int]]:
    """Group the taxels of a node that differ only in name and place; gives each one's column."""
    alike: dict[str, list[int]] = {}
    for number, taxel in enumerate(settings.taxel):
        sheet = taxel.model_dump_json(exclude={"id", "place", "position"})
        alike.setdefault(sheet, []).append(number)
    found: dict[int, tuple[TaxelGroup, int]] = {}
    for numbers in alike.values():
        taxels = [settings.taxel[number] for number in numbers]
        sensing = SensingColumns(
            taxels[0],
            seeds=seed,
            numbers=numbers,
            companions=settings.companions(taxels[0]),
            places=[taxel.place for taxel in taxels if isinstance(taxel, Staged)],
        )
        group = TaxelGroup(sensing, clock)
        found |= {number: (group, column) for column, number in enumerate(numbers)}
    return [found[number] for number in range(len(settings.taxel))]


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

    def take(self, number: int) -> list[tuple[int, Frame, list[Record], list[TruePart]]]:
        """Take a taxel's next frame, and with a pad's those of all pads at the same instants.

        Returns:
            Of each: number, frame, gaps, and the truth behind the samples that are sent.

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
        return [(k, self._taxels[k].next, [], self._taxels[k].report()) for k in together]


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
        reflexes: Its monitors.
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
        self.layout = plan_layout(settings)
        self._layout = self.layout.described.layout
        self.taxels = build_taxels(
            settings, self.layout, seed=seed, clock=clock, functions=functions
        )
        self._sampling_group = SamplingGroup(settings.taxel, self.taxels)
        self._encode = compiled_encode if functions is not inversion else encode
        self._boot()

    def _boot_sampling(self) -> None:
        writer = self._outbox.message_writer
        self._parts: list[TruePart] = []
        self._assembler = Assembler(self._clock.known, writer, self._encode)
        for taxel in self.taxels:
            taxel.boot(self._outbox.boot, writer, self._assembler)
        actions = [partial(self._sample, number) for number in range(len(self.taxels))]
        self.sampling = SamplingInterrupts(
            self.machine, actions, self._settings.machine.dma_samples
        )
        self._sampling_group.boot()
        self.reflexes = NodeReflexes(
            self._settings,
            {taxel.name: taxel for taxel in self.taxels},
            machine=self.machine,
            sampling=self.sampling,
            clock=self._clock.known,
            assembler=self._assembler,
            gesture_key=self.gesture_key,
        )
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
        self.reflexes.arm()

    def _stop_sampling(self) -> None:
        self.sampling.stop()
        self.reflexes.stop()

    def _next_start(self) -> tuple[int, int]:
        starts = [taxel.next.start for taxel in self.taxels]
        waiting = self._assembler.begin
        return min(starts if waiting is None else [waiting, *starts]), max(starts)

    def _missing(self, ticks: int) -> int:
        return sum(taxel.missing(ticks) for taxel in self.taxels) + self._assembler.samples

    def _skip(self, batch: Batch, ticks: int) -> int:
        lost = sum(taxel.skip(ticks) for taxel in self.taxels)
        batch.take(self._flush())
        return lost

    def _undecided(self) -> Sequence[Record]:
        for taxel in self.taxels:
            taxel.finish()
        return self._flush()

    def _set_shedding(self, stage: int) -> None:
        for taxel in self.taxels:
            taxel.control_unit.shed = stage

    def _faults(self) -> Sequence[tuple[str, int, int]] | None:
        return self._self_test.faults

    def _sample(self, number: int) -> None:
        """Handle the interrupt of a complete frame."""
        self.states.take(states.DUE, self._ticks)
        self.sampling.complete(number)
        taken = self._work_off(partial(self._sampling_group.take, number))
        for frame in taken or ():
            self._finish(*frame)
        self.reflexes.arm()
        if taken and self.sampling.due > self.machine.booted + taken[0][1].due:
            self._batch.take(self._flush())

    def _finish(self, number: int, frame: Frame, gaps: list[Record], truth: list[TruePart]) -> None:
        """Charge and schedule after a frame."""
        taxel = self.taxels[number]
        ledger, cycles = self.machine.ledger, taxel.cycles(frame.n)
        ledger.charge_frame(frame, cycles=cycles, inputs=taxel.inputs)
        ledger.charge_repeats(*taxel.reader.repeats)
        records = [*gaps, *self._self_test.watch(number, frame.due)]
        self._charge(records)
        self._batch.take(records)
        self._parts += truth
        self.sampling.arm(number, taxel.next)

    def _flush(self) -> Sequence[Record]:
        """Write the stretch that is complete; keeps the truth behind its frames."""
        parts, self._parts = self._parts, []
        records = self._assembler.flush()
        self._charge(records)
        for record, matrices in zip(records, self._assembler.written, strict=False):
            self._true.append(self._true_frame(record, matrices, parts))
        return records

    def _charge(self, records: Sequence[Record]) -> None:
        for record in records:
            size = len(record.body)
            self.machine.ledger.charge_message(message(size, record.samples), size)

    def _true_frame(
        self, record: Record, matrices: Sequence[Matrix], parts: Sequence[TruePart]
    ) -> TrueFrame:
        first, last = min(each.start for each in matrices), max(each.last for each in matrices)
        values = [
            true_matrix(matrix, [part for part in parts if part.patch == matrix.patch.number])
            for matrix in matrices
        ]
        clock, lasting = self._clock, last + max(each.dt for each in matrices) - first
        sizes = [(each.patch.number, each.rows * each.patch.columns) for each in matrices]
        return TrueFrame(
            Position(self._outbox.boot, record.sequence),
            self._layout,
            first,
            lasting,
            clock.true_time(first),
            clock.true_time(first + lasting),
            np.array(sizes, np.uint32),
            np.concatenate([each.ravel() for each in values]),
        )


def true_matrix(matrix: Matrix, parts: Sequence[TruePart]) -> Floats:
    """The truth behind a matrix, shape ``(rows, columns)``; NaN where nothing was sent."""
    values = np.full((matrix.rows, matrix.patch.columns), np.nan)
    for part in parts:
        first, step = (part.start - matrix.start) // matrix.dt, part.dt // matrix.dt
        values[first : first + step * len(part.values) : step, part.column] = part.values
    return values
