"""The bounds within which the model is checked."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Mapping

INVARIANTS: Final = (
    *("AcknowledgedIsDurable", "AnsweredIsStored", "NothingIsLost", "NumberedIsStored"),
    *("Once", "CutOffIsTrue", "CacheIsTrue", "LocksExclude", "NoDeadlock", "ErasedIsGone"),
)
PROPERTIES: Final = ("StoredAtLast", "FreedAtLast", "ErasedAtLast")


@dataclass(frozen=True, slots=True)
class Bounds:
    """Constants of ``Delivery.tla``, which explains them.

    Attributes:
        live: Whether properties are checked instead of invariants.
    """

    nodes: int = 1
    gateways: int = 1
    clouds: int = 1
    slots: int = 1
    boots: int = 1
    sequences: int = 1
    worn: tuple[int, ...] = ()
    most_named: int = 0
    most_batch: int = 1
    loaded: bool = False
    whole: bool = False
    live: bool = False

    def configuration(self) -> list[str]:
        """Lines of TLC's configuration."""
        gateways = ", ".join(f"g{number}" for number in range(self.gateways))
        clouds = ", ".join(f"c{number}" for number in range(self.clouds))
        lines = [
            f"SPECIFICATION {'FairSpec' if self.live else 'Spec'}",
            "CONSTANTS",
            f"Nodes = {{{', '.join(map(str, range(self.nodes)))}}}",
            f"Gateways = {{{gateways}}}",
            f"Clouds = {{{clouds}}}",
            f"Slots = {self.slots}",
            f"Boots = {self.boots}",
            f"Sequences = {self.sequences}",
            f"Worn = {{{', '.join(map(str, self.worn))}}}",
            f"MostNamed = {self.most_named}",
            f"MostBatch = {self.most_batch}",
            f"Loaded = {str(self.loaded).upper()}",
            f"Whole = {str(self.whole).upper()}",
            "None = None",
        ]
        if self.live:  # symmetry is unsound for properties
            return [*lines, f"PROPERTIES {' '.join(PROPERTIES)}"]
        return [*lines, "SYMMETRY Symmetry", f"INVARIANTS {' '.join(INVARIANTS)}"]


_GATEWAYS: Final = Bounds(gateways=2, clouds=0, sequences=2)
_SLOTS: Final = Bounds(nodes=2, clouds=2, slots=2, worn=(1,), most_batch=2, loaded=True)
SMALL: Final[Mapping[str, Bounds]] = {
    "gateways": _GATEWAYS,
    "boots": Bounds(clouds=0, boots=2, sequences=1, most_named=1),
    "slots": _SLOTS,
    "writers": Bounds(clouds=2, sequences=2, most_batch=2, loaded=True),
    "stored at last": Bounds(whole=True, live=True),
    "erased at last": Bounds(worn=(0,), loaded=True, live=True),
}
LARGE: Final[Mapping[str, Bounds]] = {
    **SMALL,
    "gateways": replace(_GATEWAYS, most_named=1, most_batch=2),
    "boots": Bounds(gateways=2, clouds=0, boots=2, sequences=1, most_named=1),
    "gateways and cloud": replace(_GATEWAYS, clouds=1, whole=True),
    "stored at last": Bounds(gateways=2, whole=True, live=True),
    "erased at last": Bounds(clouds=2, worn=(0,), loaded=True, live=True),
    "two gateways' slots": replace(_SLOTS, gateways=2),
    "three clouds": replace(_SLOTS, clouds=3),
}
