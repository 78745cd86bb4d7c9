"""All kinds of taxel. What a kind brings with it is found here, and named nowhere else."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Final, TypeAlias, Union

from pydantic import Field

from eskin_sensor_node.kinds.bioelectric import BIOELECTRIC
from eskin_sensor_node.kinds.capacitive import CAPACITIVE, RECORDED_CAPACITANCE
from eskin_sensor_node.kinds.coil import COIL
from eskin_sensor_node.kinds.hybrid import HYBRID
from eskin_sensor_node.kinds.hygrometer import HYGROMETER
from eskin_sensor_node.kinds.inductive import INDUCTIVE, RECORDED_INDUCTANCE
from eskin_sensor_node.kinds.pad import PAD
from eskin_sensor_node.kinds.thermometer import THERMOMETER
from eskin_sensor_node.kinds.touch import TOUCH
from eskin_sensor_node.world.scenario.fit import Staged

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eskin_sensor_node.kinds.frontend import Frontend
    from eskin_sensor_node.kinds.generator import ColumnGenerator
    from eskin_sensor_node.kinds.kind import Kind
    from eskin_sensor_node.kinds.settings import TaxelSection
    from eskin_sensor_node.kinds.signals import World

_ALL: Final[tuple[Kind[Any], ...]] = (
    CAPACITIVE,
    PAD,
    RECORDED_CAPACITANCE,
    TOUCH,
    INDUCTIVE,
    COIL,
    RECORDED_INDUCTANCE,
    HYBRID,
    THERMOMETER,
    HYGROMETER,
    BIOELECTRIC,
)
KINDS: Final[Mapping[str, Kind[Any]]] = {kind.name: kind for kind in _ALL}
"""Each kind by its name."""

if TYPE_CHECKING:
    Taxel: TypeAlias = TaxelSection
else:
    Taxel = Annotated[
        Union[tuple(kind.settings for kind in _ALL)],  # noqa: UP007 - of any number
        Field(discriminator="kind"),
    ]
"""A ``[[taxel]]`` table of any kind, which ``kind`` names."""


def build_world(
    taxel: TaxelSection, random: ColumnGenerator, places: Sequence[str] | None = None
) -> World:
    """Draw the true parts of the worlds of taxels with one data sheet, a column each.

    Args:
        taxel: The data sheet.
        random: Draws columns.
        places: Where they are in their skin, if it has one; ``None``: all where the taxel is.
    """
    draw = KINDS[taxel.kind].world
    if not isinstance(taxel, Staged):
        return draw(taxel, random)
    return draw(taxel, random, [taxel.place] * len(random) if places is None else places)


def build_frontend(taxel: TaxelSection, random: ColumnGenerator) -> Frontend:
    """Draw the true parts of the analogue chains of taxels with one data sheet, a column each."""
    return KINDS[taxel.kind].frontend(taxel, random)
