"""Which taxels of a node sit around each other."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from eskin_sensor_node.world.scenario import read_scenario
from eskin_sensor_node.world.scenario.fit import Staged
from eskin_sensor_node.world.skin.skin import NO_NEIGHBOUR

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_sensor_node.kinds.settings import TaxelSection

_AROUND: Final = 4
"""So many surround a taxel: no contact moves all of them and leaves it out."""


class PadNeighbours(NamedTuple):
    """Where a pad sits in its skin.

    Attributes:
        neighbours: How many sit beside it, whether the node measures them or not.
        around: Numbers of the node's pads among them.
    """

    neighbours: int
    around: list[int]


def patches(taxels: Sequence[TaxelSection]) -> dict[int, PadNeighbours]:
    """Of each pad of a node, by its number, where it sits: what it feels crosstalk of."""
    found: dict[int, PadNeighbours] = {}
    skins: dict[str, dict[str, int]] = {}
    for number, taxel in enumerate(taxels):
        if isinstance(taxel, Staged) and taxel.pressed:
            skins.setdefault(taxel.scenario, {}).setdefault(taxel.place, number)
    for scenario, places in skins.items():
        skin = read_scenario(scenario).skin.build()
        for number, taxel in enumerate(taxels):
            if isinstance(taxel, Staged) and taxel.pressed and taxel.scenario == scenario:
                beside = skin.neighbours[skin.numbers[taxel.place]]
                names = [skin.names[k] for k in beside[beside != NO_NEIGHBOUR].tolist()]
                found[number] = PadNeighbours(
                    len(names), [places[name] for name in names if name in places]
                )
    return found


def touching(scenario: str, places: Sequence[str]) -> tuple[tuple[int, int], ...]:
    """Which of some places of a scenario's skin touch: pairs of their numbers, ascending."""
    skin = read_scenario(scenario).skin.build()
    number_of = {skin.numbers[place]: number for number, place in enumerate(places)}
    return tuple(
        sorted(
            (number, number_of[other])
            for place, number in number_of.items()
            for other in skin.neighbours[place].tolist()
            if other in number_of and number < number_of[other]
        )
    )


def measured_around(taxels: Sequence[TaxelSection]) -> dict[int, int]:
    """Of each pad of a node, by its number, how many of its neighbours the node measures."""
    return {number: len(patch.around) for number, patch in patches(taxels).items()}


def neighbours(taxels: Sequence[TaxelSection]) -> list[list[int]]:
    """Of each taxel, the numbers of the nearest four of its kind in its skin; or none."""
    found: list[list[int]] = [[] for _ in taxels]
    skins: dict[tuple[str, str], list[tuple[int, str]]] = {}
    for number, taxel in enumerate(taxels):
        if isinstance(taxel, Staged):
            skins.setdefault((taxel.kind, taxel.scenario), []).append((number, taxel.place))
    for (_, scenario), members in skins.items():
        if len(members) <= _AROUND:
            continue
        skin = read_scenario(scenario).skin.build()
        positions = skin.positions[[skin.numbers[place] for _, place in members]]
        for (number, _), position in zip(members, positions, strict=True):
            nearest = np.argsort(np.linalg.norm(positions - position, axis=1), kind="stable")
            around = [members[k][0] for k in nearest if members[k][0] != number]
            found[number] = around[:_AROUND]
    return found
