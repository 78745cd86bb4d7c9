"""The data sheet that the firmware is given: numbers by name, and nothing true."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from eskin.union_bound import union_coverage
from eskin_sensor_node.kinds.neighbours import patches

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eskin_sensor_node.kinds.settings import Companion, TaxelSection
    from eskin_sensor_node.settings import NodeSettings

_UNIT: Final = re.compile(r"_(per_m|ohm|m2|m|Pa)$")
"""Of names in which the unit is a part of the Python name, too."""


def data_sheet(
    taxel: TaxelSection, companions: Mapping[str, Companion] | None = None
) -> dict[str, float]:
    """All numbers of a taxel's settings, in SI units; ``reach``: how far its noise may reach.

    The data sheets of what it reads along stand in it, too, under their names and a dot.
    """
    sheet = {
        _UNIT.sub("", name): float(value) for name, value in taxel if isinstance(value, int | float)
    }
    sheet |= {"adc_min": taxel.adc_min, "reach": taxel.noise.reach}
    for role, companion in (companions or {}).items():
        of_companion = data_sheet(companion.taxel).items()
        sheet |= {f"{role}.{name}": value for name, value in of_companion}
    return sheet


def coverage(
    taxel: TaxelSection,
    companions: Mapping[str, Companion],
    around: Sequence[tuple[TaxelSection, Mapping[str, Companion]]] = (),
) -> float:
    """Probability that a sample's interval holds the truth.

    Args:
        taxel: What is measured.
        companions: What it reads along.
        around: Its neighbours whose readings are taken into account, and what they read along.
    """
    return union_coverage(
        *(
            each.coverage
            for one, along in ((taxel, companions), *around)
            for each in (one, *(companion.taxel for companion in along.values()))
        )
    )


def taxel_coverages(settings: NodeSettings) -> list[float]:
    """Least probability, for each taxel, that a sample's interval encloses the truth."""
    each = [(taxel, settings.companions(taxel)) for taxel in settings.taxel]
    found = patches(settings.taxel)
    return [
        coverage(*own, [each[k] for k in found[number].around] if number in found else ())
        for number, own in enumerate(each)
    ]
