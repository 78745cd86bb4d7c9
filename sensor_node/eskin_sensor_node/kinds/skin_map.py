"""Where a node's taxels sit on a flat map of its skin."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin_sensor_node.world.scenario import read_scenario
from eskin_sensor_node.world.scenario.fit import Staged

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_sensor_node.kinds.settings import TaxelSection
    from eskin_sensor_node.world.skin import Skin

_NANO: Final = 1e9


def skin_map(taxels: Sequence[TaxelSection]) -> list[tuple[str, float, float]]:
    """Id, x and y in m of each taxel that sits somewhere: by its settings, or by its scenario."""
    found = []
    for taxel in taxels:
        if taxel.position is not None:
            found.append((taxel.id, *taxel.position))
        elif isinstance(taxel, Staged):
            skin = read_scenario(taxel.scenario).skin.build()
            x, y = skin.unrolled[skin.numbers[taxel.place]].tolist()
            # To a nanometre, so that a pitch of 20 mm reads as one.
            found.append((taxel.id, round(x * _NANO) / _NANO, round(y * _NANO) / _NANO))
    return found


def staged_skins(taxels: Sequence[TaxelSection]) -> list[Skin]:
    """The skins on which a node's taxels have a place, each once."""
    scenarios = {t.scenario for t in taxels if isinstance(t, Staged) and t.position is None}
    return [read_scenario(scenario).skin.build() for scenario in sorted(scenarios)]
