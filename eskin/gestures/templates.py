"""What a gesture is: the constants of all templates."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import inf
from typing import Final, Literal, TypeAlias

from eskin.errors import GestureError

Kind: TypeAlias = Literal[
    "tap", "press", "hold", "slide", "swipe", "double tap", "pinch", "spread", "rotation"
]
"""The name of a template."""
TOUCH_KINDS: Final[tuple[Kind, ...]] = ("tap", "press", "hold", "slide", "swipe")
"""Kinds of one touch; each touch has at most one."""
PAIR_KINDS: Final[tuple[Kind, ...]] = ("double tap", "pinch", "spread", "rotation")
"""Kinds of two touches; each pair has at most one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Templates:
    """The constants of the templates, which `eskin.gestures` states.

    Attributes:
        tap_ns: Longest tap, in ns.
        hold_ns: Shortest hold, in ns; what is still for longer than a tap and shorter is a press.
        still_m: How far, along each coordinate, the centroid of a still touch moves at most.
        slide_m: Least distance from the first to the last centroid of a slide or a swipe, in m.
        swipe_m_per_s: Least mean speed of a swipe; what is slower is a slide.
        pause_ns: Longest time from the end of a double tap's first tap to the begin of its second.
        apart_m: Greatest distance of their first centroids.
        together_ns: Shortest time for which both touches of a pinch, spread or rotation last.
        span_m: Greatest distance of their centroids, at the begin and at the end of that time.
        scale: Least factor by which a pinch shrinks that distance, or a spread grows it.

    Raises:
        GestureError: A constant is not positive and finite, or they do not exclude each other.
    """

    tap_ns: int = 200_000_000
    hold_ns: int = 700_000_000
    still_m: float = 0.008
    slide_m: float = 0.016
    swipe_m_per_s: float = 0.17
    pause_ns: int = 300_000_000
    apart_m: float = 0.015
    together_ns: int = 100_000_000
    span_m: float = 0.12
    scale: float = 1.4

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if not 0 < value < inf:
                raise GestureError(f"{each.name} is {value}; it must be positive and finite")
        for less, more, why in (
            ("tap_ns", "hold_ns", "a tap is shorter than a hold"),
            ("still_m", "slide_m", "a touch that slides is not still"),
        ):
            if not getattr(self, less) < getattr(self, more):
                raise GestureError(
                    f"{less} = {getattr(self, less)} must be less than {more} = "
                    f"{getattr(self, more)}: {why}"
                )
        if not self.still_m * 1.75 < self.slide_m:
            raise GestureError(
                f"slide_m = {self.slide_m} must exceed 1.75 still_m = {self.still_m}: a slide goes "
                "farther than the diagonal of what is still, in three coordinates"
            )
        if not self.scale > 1.0:
            raise GestureError(f"scale is {self.scale}; it must exceed 1")
