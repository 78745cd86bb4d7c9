"""The shapes that a skin may have: the ``[skin]`` table of a scenario."""

from __future__ import annotations

import math
from abc import abstractmethod
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Final, Literal, TypeAlias

import numpy as np
from pydantic import ConfigDict, Field, ValidationInfo, field_validator

from eskin.runtime.settings import Section
from eskin_sensor_node.world.skin.skin import Skin

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin.interval import Floats

MOST_TAXELS: Final = 100_000
_MILLIMETRE: Final = 1e-3
_PALM_MM: Final = (80, 60)
_FINGERS_MM: Final = 4 * ((20, 40),)
_THUMB_MM: Final = (20, 20)
_BETWEEN_FINGERS_MM: Final = 25
_HAND_MM: Final = (
    (-2.0, -12.0, 3.0),
    (-8.6, 60.0, 30.0),
    (-8.6, 109.0, 9.0),
    (15.55, 109.0, 9.0),
    (15.55, 63.0, 0.7),
    (16.95, 63.0, 0.7),
    (16.95, 109.0, 9.0),
    (40.55, 109.0, 9.0),
    (40.55, 63.0, 0.7),
    (41.95, 63.0, 0.7),
    (41.95, 109.0, 9.0),
    (65.55, 109.0, 9.0),
    (65.55, 63.0, 0.7),
    (66.95, 63.0, 0.7),
    (66.95, 109.0, 9.0),
    (91.1, 109.0, 9.0),
    (91.1, 50.0, 12.0),
    (86.5, 34.5, 6.0),
    (108.2, 34.5, 9.0),
    (108.2, 5.5, 9.0),
    (88.0, 5.5, 8.0),
    (82.0, -12.0, 3.0),
)
"""Corners of the hand's outline, x and y, and their radii.

Up from the wrist, along the fingers, and down around the thumb."""
_ARC_POINTS: Final = 8
"""Of half a circle."""
_KEPT: Final = 8
"""Skins that are kept: every taxel of a node asks for the one that it is part of."""
_BENT: Final = math.pi / 2
"""Angle over which a finger's skin bends around it."""


class _Shape(Section):
    """What all shapes have."""

    model_config = ConfigDict(strict=True)

    crosstalk: float = Field(
        default=0.0,
        ge=0,
        le=0.5,
        description="share of its neighbours' mean pressure that a taxel feels, besides its own",
    )

    def build(self) -> Skin:
        """Its taxels; equal shapes share one skin."""
        return _built(self)

    @abstractmethod
    def lay_out(self) -> Skin:
        """Its taxels, anew."""


class FlatShape(_Shape):
    """A flat grid in the plane z = 0, numbered row by row from the origin."""

    shape: Literal["flat"]
    rows: int = Field(ge=1, le=1000, description="taxels along y")
    columns: int = Field(ge=1, le=1000, description="taxels along x")
    pitch_m: float = Field(gt=0, le=1, description="distance of two neighbours")

    @field_validator("columns")
    @classmethod
    def _not_too_many(cls, value: int, info: ValidationInfo) -> int:
        return _limited(value, info)

    def lay_out(self) -> Skin:
        """Its taxels, anew."""
        return _grid(self.columns, self.rows, self.pitch_m)


class CylinderShape(_Shape):
    """A grid around a cylinder along y, numbered ring by ring; its normals point away from y."""

    shape: Literal["cylinder"]
    rows: int = Field(ge=1, le=1000, description="rings along y")
    columns: int = Field(ge=3, le=1000, description="taxels around a ring")
    pitch_m: float = Field(
        gt=0, le=1, description="distance of two neighbours, along the ring (its chord) and along y"
    )

    @field_validator("columns")
    @classmethod
    def _not_too_many(cls, value: int, info: ValidationInfo) -> int:
        return _limited(value, info)

    def lay_out(self) -> Skin:
        """Its taxels, anew."""
        radius = self.pitch_m / (2.0 * math.sin(math.pi / self.columns))
        rows, columns = np.divmod(np.arange(self.rows * self.columns), self.columns)
        angles = 2.0 * math.pi * columns / self.columns
        normals = np.stack([np.sin(angles), np.zeros(len(angles)), np.cos(angles)], axis=1)
        positions = radius * normals
        positions[:, 1] = rows * self.pitch_m
        unrolled = self.pitch_m * np.stack([columns, rows], axis=1)
        return Skin(positions, normals, self.pitch_m, unrolled, _around(unrolled, self.pitch_m))


class HandShape(_Shape):
    """The paper's hand: 84 cm², 8400 taxels at 1 mm.

    The palm lies flat (80 × 60 mm); four fingers (20 × 40 mm) and the thumb (20 × 20 mm) bend by
    90° over their width. A wider pitch gives fewer taxels, which cover the same 84 cm². Numbered
    palm first, then the fingers from left to right, then the thumb; each row by row.
    """

    shape: Literal["hand"]
    pitch_mm: Literal[1, 2, 4, 5, 10, 20] = Field(
        default=1, description="distance of two neighbours in mm"
    )

    def lay_out(self) -> Skin:
        """Its taxels, anew."""
        palm = self._patch(_PALM_MM, 0.0, 0.0, bent=False)
        parts = [palm]
        for number, finger in enumerate(_FINGERS_MM):
            left = number * _BETWEEN_FINGERS_MM - _BETWEEN_FINGERS_MM / 4
            parts.append(self._patch(finger, left, _PALM_MM[1] + 5.0, bent=True))
        parts.append(self._patch(_THUMB_MM, _PALM_MM[0] + 5.0, 10.0, bent=True))
        return Skin.join(parts, _rounded(_HAND_MM) * _MILLIMETRE)

    def _patch(self, size: tuple[int, int], left: float, low: float, *, bent: bool) -> Skin:
        """A patch of so many mm, whose lower left corner stands at so many mm."""
        pitch = self.pitch_mm * _MILLIMETRE
        flat = _grid(size[0] // self.pitch_mm, size[1] // self.pitch_mm, pitch)
        corner = np.array([left, low, 0.0]) * _MILLIMETRE
        inside = flat.positions + np.array([pitch / 2, pitch / 2, 0.0])
        unrolled = (corner + inside)[:, :2]
        if not bent:
            return Skin(corner + inside, flat.normals, pitch, unrolled, _around(unrolled, pitch))
        width = size[0] * _MILLIMETRE
        radius, angles = width / _BENT, (inside[:, 0] / width - 0.5) * _BENT
        normals = np.stack([np.sin(angles), np.zeros(len(flat)), np.cos(angles)], axis=1)
        axis = np.stack(
            [np.full(len(flat), width / 2), inside[:, 1], np.full(len(flat), -radius)], axis=1
        )
        outline = _around(unrolled, pitch)
        return Skin(corner + axis + radius * normals, normals, pitch, unrolled, outline)


Shape: TypeAlias = Annotated[FlatShape | CylinderShape | HandShape, Field(discriminator="shape")]
"""One of them, discriminated by ``shape``."""


@lru_cache(maxsize=_KEPT)
def _built(shape: _Shape) -> Skin:
    return shape.lay_out()


def _grid(columns: int, rows: int, pitch: float) -> Skin:
    y, x = np.divmod(np.arange(rows * columns), columns)
    positions = pitch * np.stack([x, y, np.zeros(len(x))], axis=1)
    normals = np.tile([0.0, 0.0, 1.0], (len(x), 1))
    unrolled = positions[:, :2]
    return Skin(positions, normals, pitch, unrolled, _around(unrolled, pitch))


def _around(unrolled: Floats, pitch: float) -> Floats:
    """The rectangle around the cells of a map."""
    (left, low), (right, high) = unrolled.min(axis=0) - pitch / 2, unrolled.max(axis=0) + pitch / 2
    return np.array([(left, low), (right, low), (right, high), (left, high)])


def _rounded(corners: Sequence[tuple[float, float, float]]) -> Floats:
    """A closed line with round corners.

    Args:
        corners: x, y and radius of each. The line turns at each, and no two arcs overlap.

    Returns:
        Its points, (n, 2).
    """
    places = np.array([corner[:2] for corner in corners])
    points = []
    for number, (_, _, radius) in enumerate(corners):
        corner = places[number]
        before, after = places[number - 1] - corner, places[(number + 1) % len(corners)] - corner
        before, after = before / np.linalg.norm(before), after / np.linalg.norm(after)
        half = math.acos(float(before @ after)) / 2.0
        middle = corner + (before + after) / np.linalg.norm(before + after) * radius / math.sin(
            half
        )
        # From where the arc touches one side, to where it touches the other.
        ends = [corner + side * radius / math.tan(half) - middle for side in (before, after)]
        turn = math.pi - 2.0 * half
        shares = np.linspace(0.0, 1.0, 2 + round(_ARC_POINTS * turn / math.pi))[:, np.newaxis]
        weights = np.sin([turn * (1.0 - shares), turn * shares]) / math.sin(turn)
        points.append(middle + weights[0] * ends[0] + weights[1] * ends[1])
    return np.concatenate(points)


def _limited(columns: int, info: ValidationInfo) -> int:
    """Refuse more taxels than fit into memory with ease."""
    rows = info.data.get("rows")
    if rows is not None and rows * columns > MOST_TAXELS:
        raise ValueError(f"rows × columns must be at most {MOST_TAXELS}")
    return columns
