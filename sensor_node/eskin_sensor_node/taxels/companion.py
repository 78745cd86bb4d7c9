"""A taxel that another one reads along."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eskin_sensor_node.taxels import AnyTaxel


@dataclass(frozen=True, slots=True)
class Companion:
    """A taxel of the same node, read at the instants of another one.

    Attributes:
        taxel: Its settings.
        seed: Draws its true parts: they are the same, whoever reads it.
    """

    taxel: AnyTaxel
    seed: tuple[int, ...]
