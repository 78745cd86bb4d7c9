"""All kinds of taxel. What a kind brings with it is found here, and named nowhere else."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Final, TypeAlias, Union

import numpy as np
from pydantic import Field

from eskin_sensor_node.kinds.bioelectric import BIOELECTRIC
from eskin_sensor_node.kinds.capacitive import CAPACITIVE, RECORDED_CAPACITANCE
from eskin_sensor_node.kinds.coil import COIL
from eskin_sensor_node.kinds.frontend import CompaniedFrontend
from eskin_sensor_node.kinds.hybrid import HYBRID
from eskin_sensor_node.kinds.hygrometer import HYGROMETER
from eskin_sensor_node.kinds.inductive import INDUCTIVE, RECORDED_INDUCTANCE
from eskin_sensor_node.kinds.pad import PAD
from eskin_sensor_node.kinds.thermometer import THERMOMETER
from eskin_sensor_node.kinds.touch import TOUCH

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eskin_sensor_node.kinds.frontend import Frontend
    from eskin_sensor_node.kinds.kind import Kind
    from eskin_sensor_node.kinds.settings import Companion, TaxelSection
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


def build_world(taxel: TaxelSection, random: np.random.Generator) -> World:
    """Draw the true parts of a taxel's world."""
    return KINDS[taxel.kind].world(taxel, random)


def build_skin_world(
    taxel: TaxelSection, random: np.random.Generator, places: Sequence[str]
) -> World:
    """Draw the true parts of the worlds of many taxels with one data sheet, a column each.

    Args:
        taxel: The data sheet, of a kind that can be sampled in columns.
        random: Draws columns.
        places: Where they are in their skin.

    Raises:
        TypeError: The kind cannot.
    """
    world = KINDS[taxel.kind].skin_world
    if world is None:
        raise TypeError(f"taxels of kind {taxel.kind} are not sampled in columns")
    return world(taxel, random, places)


def build_frontend(
    taxel: TaxelSection,
    random: np.random.Generator,
    companions: Mapping[str, Companion] | None = None,
) -> Frontend:
    """Draw the true parts of a taxel's analogue chain.

    Args:
        taxel: Its data sheet.
        random: Draws them.
        companions: What it reads along, by the names of its inputs.
    """
    own = KINDS[taxel.kind].frontend(taxel, random)
    if not companions:
        return own
    return CompaniedFrontend(
        own,
        {
            name: build_frontend(each.taxel, np.random.default_rng(each.seed))
            for name, each in companions.items()
        },
    )
