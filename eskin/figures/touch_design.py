"""The example of set inversion in docs/theory.md, as a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from eskin.design import All, Narrower, Paving, Within, invert
from eskin.interval import Interval
from eskin.models import formulas

if TYPE_CHECKING:
    from pathlib import Path

TOUCHES: Final = {"area": Interval(1e-5, 1e-4)}
LEAST_F: Final = 1.5e-13
WIDEST_F: Final = 3e-13
TOLERANCE: Final = {"distance": 0.05}
SPACE: Final = {"distance": Interval(5e-4, 5e-3), "permittivity": Interval(1.0, 5.0)}
RESOLUTION: Final = 1 / 512
TITLE: Final = "At least 0.15 pF at every touch, and no wider than 0.3 pF under ±5 % of distance"


def touch_design() -> Paving:
    """Which plate distances and permittivities meet both requirements."""
    wanted = All(
        (
            Within(_capacitance, lo=LEAST_F, for_every=TOUCHES),
            Narrower(
                _capacitance,
                width=WIDEST_F,
                tolerance=TOLERANCE,
                for_every=TOUCHES,
                pieces=8,
                expression=True,
            ),
        )
    )
    return invert(wanted, SPACE, resolution=RESOLUTION)


def write_design(path: Path) -> Path:
    """Draw it as PNG.

    Raises:
        ImportError: matplotlib is not installed.
        OSError: The file cannot be written.
    """
    from eskin.figures.plot import write_paving  # noqa: PLC0415 - matplotlib is an extra

    write_paving(
        path,
        touch_design(),
        title=TITLE,
        x=("distance", "plate distance", "m"),
        y=("permittivity", "relative permittivity", ""),
    )
    return path


def _capacitance(*, distance: Any, permittivity: Any, area: Any) -> Any:
    return formulas.capacitance(relative_permittivity=permittivity, area=area, distance=distance)
