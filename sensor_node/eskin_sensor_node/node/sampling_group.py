"""Taxels that are sampled at the same instants: pads of a skin, which have crosstalk."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from eskin_sensor_node.kinds.neighbours import patches
from eskin_sensor_node.machine.data_sheet import taxel_coverages
from eskin_sensor_node.machine.sampling import most_repeats
from eskin_sensor_node.node.taxel import EmulatedTaxel

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import ModuleType

    from eskin_sensor_node.firmware.message_writer import Record
    from eskin_sensor_node.firmware.schedule import Frame
    from eskin_sensor_node.kinds.settings import TaxelSection
    from eskin_sensor_node.machine.clock import Clock
    from eskin_sensor_node.node.ground_truth import TrueBlock
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


class Taken(NamedTuple):
    """One taxel's frame.

    Attributes:
        number: The taxel's.
        frame: Which one.
        records: Its messages.
        truth: Behind its blocks.
    """

    number: int
    frame: Frame
    records: list[Record]
    truth: list[TrueBlock]


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

    def take(self, number: int) -> list[Taken]:
        """Take a taxel's next frame, and with a pad's those of all pads at the same instants.

        Raises:
            FirmwareError: The firmware failed.
        """
        if number not in self._patches:
            frame = self._taxels[number].next
            return [Taken(number, frame, *self._taxels[number].sample())]
        frame = self._taxels[number].next
        together = [k for k in self._patches if self._taxels[k].next.meets(frame)]
        for k in together:
            self._taxels[k].measure()
        for k in together:
            self._taxels[k].separate()
        return [Taken(k, self._taxels[k].next, *self._taxels[k].report()) for k in together]
