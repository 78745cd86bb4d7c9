"""Pads that wear, get wet, and remember what pressed them: slow departures from the data sheet."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from pydantic import ConfigDict, Field

from eskin.runtime.settings import Section

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin.interval import Floats

_MOST_WORN: Final = 3.0
"""Greatest logarithm of what wear changes: beyond a factor of 20 there is no pad any more."""


class WearSection(Section):
    """A pad that wears: its layer gets thinner or thicker for good, softer or stiffer.

    Both drift exponentially, at constant relative rates.
    """

    model_config = ConfigDict(strict=True)

    taxel: str = Field(pattern=r"^t[0-9]{2,6}$", description="the one that wears, such as t05")
    at_s: float = Field(default=0.0, ge=0, description="from when on")
    distance_per_s: float = Field(
        default=0.0, ge=-1, le=1, description="relative rate of the plates' distance at rest, 1/s"
    )
    elasticity_per_s: float = Field(
        default=0.0, ge=-1, le=1, description="relative rate of the layer's elasticity, 1/s"
    )


class FilmSection(Section):
    """Water that lies on a pad for a while, and adds to its capacitance."""

    model_config = ConfigDict(strict=True)

    taxel: str = Field(pattern=r"^t[0-9]{2,6}$", description="the wet one, such as t05")
    at_s: float = Field(ge=0, description="when it gets wet")
    duration_s: float = Field(gt=0, description="how long until it is dry")
    share: float = Field(gt=0, le=10, description="of its capacitance at rest, that is added")


class HysteresisSection(Section):
    """What remains of a pad's compression when a contact has gone; of all pads."""

    model_config = ConfigDict(strict=True)

    share: float = Field(
        default=0.0, ge=0, lt=1, description="of the contact's greatest pressure, at its end"
    )
    decay_s: float = Field(default=10.0, gt=0, description="time in which it falls to 1/e")


def drifted(rate: float, since: Floats) -> Floats:
    """Factor by which a part has drifted some time in s after its wear began; 1 before."""
    return np.exp(np.clip(rate * np.maximum(since, 0.0), -_MOST_WORN, _MOST_WORN))


def worn(
    wear: Sequence[tuple[int, WearSection]], key: str, shape: tuple[int, int], seconds: Floats
) -> Floats:
    """Factors of a part of some taxels, taxels × times, or 1 where none wears.

    Args:
        wear: Each with its taxel's row.
        key: Its rate, such as ``distance_per_s``.
        shape: Taxels and times.
        seconds: The times, or taxels × times.
    """
    if not wear:
        return np.ones((1, 1))
    factors, times = np.ones(shape), np.broadcast_to(seconds, shape)
    for row, each in wear:
        factors[row] *= drifted(getattr(each, key), times[row] - each.at_s)
    return factors


def wet(
    films: Sequence[tuple[int, FilmSection]], shape: tuple[int, int], seconds: Floats
) -> Floats:
    """What water adds, over the capacitance at rest, taxels × times, or 0 where none is wet.

    Args:
        films: Each with its taxel's row.
        shape: Taxels and times.
        seconds: The times, or taxels × times.
    """
    if not films:
        return np.zeros((1, 1))
    shares, times = np.zeros(shape), np.broadcast_to(seconds, shape)
    for row, film in films:
        lies = (times[row] >= film.at_s) & (times[row] < film.at_s + film.duration_s)
        shares[row] += np.where(lies, film.share, 0.0)
    return shares
