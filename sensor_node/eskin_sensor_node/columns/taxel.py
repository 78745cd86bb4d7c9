"""One taxel of a skin, sample by sample, as a node's monitors read it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.world.skin.skin import NO_NEIGHBOUR

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin_sensor_node.columns.pad_columns import PadColumns
    from eskin_sensor_node.firmware.schedule import Frame
    from eskin_sensor_node.firmware.taxel.taxel import Taxel
    from eskin_sensor_node.kinds.skin_section import SkinSection


class ColumnTaxel:
    """A column of a skin; see `eskin_sensor_node.node.reflexes.MonitoredTaxel`.

    Args:
        columns: All of the node's.
        number: Which one.
        section: The skin's settings.
    """

    adjustment = 1.0, 0, 0
    """A skin's pads have no gain, trimmer or plates that change."""
    reads_intervals = False

    def __init__(self, columns: PadColumns, number: int, section: SkinSection) -> None:
        self.name = columns.columns[number]
        self._columns = columns
        self._number = number
        self._section = section

    @property
    def units(self) -> Mapping[str, str]:
        """Of the quantities that its patch states."""
        return self._columns.units

    @property
    def around(self) -> list[str]:
        """Names of its neighbours that the node samples."""
        names = self._columns.columns
        beside = self._columns.neighbours[self._number].tolist()
        return [names[k] for k in beside if k not in (NO_NEIGHBOUR, len(names))]

    @property
    def calibrated(self) -> Taxel:
        """Its calibration, which it shares with the taxels that have as many neighbours."""
        beside = self._columns.neighbours[self._number]
        return self._columns.calibrated(int((beside != NO_NEIGHBOUR).sum()))

    @property
    def period(self) -> int:
        """From sample to sample, ns."""
        return self._columns.period

    @property
    def next(self) -> Frame:
        """The samples of the stretch that is not complete."""
        return self._columns.frame

    @property
    def inputs(self) -> int:
        """Its own, and the sensors that are read along."""
        return 1 + len(self._section.companions)

    @property
    def coverage(self) -> float:
        """Probability that its intervals hold the truth, at least."""
        return self._columns.coverage

    @property
    def chain(self) -> str:
        """Whose price its inversion has."""
        return self._section.taxel.chain

    @property
    def broken(self) -> bool:
        """Whether it is certainly broken."""
        return bool(self._columns.broken[self._number])

    @property
    def along(self) -> list[str]:
        """Chains of the sensors that are read along."""
        return [each.taxel.chain for each in self._section.companions.values()]

    def converted(self, frame: Frame, k: int) -> list[list[int]]:
        """Codes of its inputs at one sample of the stretch that is not complete."""
        del frame
        codes = self._columns.sensed.readings[0].codes
        return [[int(codes[name][self._number][k]) for name in self.calibrated.inputs]]
