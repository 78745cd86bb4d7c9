"""Faults that a scenario injects: its ``[[fault]]`` tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Protocol, TypeVar

import numpy as np
from pydantic import ConfigDict, Field

from eskin.runtime.settings import Section

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from eskin.interval import Floats


class _OfTaxel(Protocol):
    """A table that names a taxel."""

    @property
    def taxel(self) -> str:
        """Its name."""


Table = TypeVar("Table", bound=_OfTaxel)


class FaultSection(Section):
    """A taxel that breaks permanently.

    A ``stuck`` one keeps the capacitance or inductance that it has at that instant; a ``dead`` one
    has an open line, so that its converter saturates.
    """

    model_config = ConfigDict(strict=True)

    taxel: str = Field(pattern=r"^t[0-9]{2,6}$", description="the one that breaks, such as t05")
    kind: Literal["stuck", "dead"] = Field(description="stuck or dead")
    at_s: float = Field(default=0.0, ge=0, description="when")


def placed(tables: Sequence[Table], places: Sequence[str]) -> list[tuple[int, Table]]:
    """The tables that name taxels at some places, each with its taxel's row."""
    return [
        (row, each) for each in tables for row, place in enumerate(places) if place == each.taxel
    ]


def break_off(
    values: Floats,
    seconds: Floats,
    faults: Sequence[tuple[int, FaultSection]],
    *,
    intact: Callable[[Floats], Floats],
    dead: float,
) -> None:
    """Put faults into the signals of some taxels.

    Args:
        values: Taxels × times; changed in place.
        seconds: The times, or taxels × times.
        faults: Each with its taxel's row.
        intact: Gives the values without faults at other times.
        dead: The value of a taxel whose line is open.
    """
    times = np.broadcast_to(seconds, values.shape)
    for row, fault in faults:
        after = times[row] >= fault.at_s
        if np.any(after):
            stays = dead if fault.kind == "dead" else intact(np.array([fault.at_s]))[row, 0]
            values[row, after] = stays
