"""Puts the columns of a skin together."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin_sensor_node.columns.inversion import least_width
from eskin_sensor_node.columns.pad_columns import PadColumns
from eskin_sensor_node.columns.plan import PatchQuantity, SkinPlan, plan_skin

if TYPE_CHECKING:
    from eskin_sensor_node.machine.clock import Clock
    from eskin_sensor_node.settings import NodeSettings

_PRESSURE: Final = "pressure"


def plan(settings: NodeSettings) -> SkinPlan:
    """How a node's skin is described.

    Raises:
        SettingsError: It cannot be shared by so many nodes, or a stretch fits no frame.
    """
    section = settings.skin
    taxel = section.taxel
    quantity = PatchQuantity(
        _PRESSURE, taxel.units[_PRESSURE], least_width(taxel), section.threshold_pa
    )
    return plan_skin(
        section.skin,
        quantity,
        rows=section.rows,
        controllers=section.controllers,
        node=settings.node.name,
    )


def build(settings: NodeSettings, seed: int, *, boot: int, clock: Clock) -> PadColumns:
    """Build the columns of a node's skin.

    The same seed and boot give the same samples at the same instants, however stretches are cut.

    Args:
        settings: The node's, with a skin.
        seed: Draws its true parts, the same at each boot, and with the boot its noise. Nodes that
            share a skin may have one seed: what is drawn depends on the taxel's number in the skin.
        boot: Number of this start; the first stretch begins at tick 0 of it.
        clock: The node's: true instants of its ticks.

    Raises:
        SettingsError: As `plan`.
    """
    return PadColumns(settings.skin, plan(settings), seed=seed, boot=boot, clock=clock)
