"""What is known of gestures: the answers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, overload

from eskin.interval.markup import html_table

if TYPE_CHECKING:
    from collections.abc import Iterable

    from eskin.gestures.templates import Kind
    from eskin.interval import Verdict

Bounds = tuple[float, float]


class TouchPlaces(NamedTuple):
    """Where a touch is, in m.

    Attributes:
        begin: Enclosure of each coordinate of its first centroid, infinite where nothing is known.
        end: The same of its last one.
    """

    begin: tuple[Bounds, ...]
    end: tuple[Bounds, ...]


@dataclass(frozen=True, slots=True)
class Gesture:
    """A gesture that is certain or possible.

    Attributes:
        kind: Which template.
        verdict: Certain: whatever the truth is, the touches of these contacts make it. Possible:
            some truth that the intervals allow does.
        contacts: Lowest label (see `ContactStream`) of the contacts of each of its touches; empty
            for a touch that is possible itself, and for pairs of touches that may be one.
        begin: Enclosure of its first sampled instant, UTC ns; a side is ``None`` if the record
            does not show it.
        end: Enclosure of its last sampled instant.
        direction: Of a slide or a swipe: enclosure of the angle from the x axis of what is between
            the first and the last centroid, in rad; the first bound is in (-π, π], the second at
            most 2π more. ``None`` where nothing is known of it.
        angle: Of two touches at once: enclosure of the angle by which their connecting line turns
            from the begin to the end, counter-clockwise, in rad, up to whole turns. ``None`` where
            nothing is known of it.
        scale: Of two touches at once: enclosure of their distance at the end over that at the
            begin.
        places: Where each of its touches begins and ends; empty where that is not known of each.
    """

    kind: Kind
    verdict: Verdict
    contacts: tuple[int, ...]
    begin: tuple[int | None, int | None]
    end: tuple[int | None, int | None]
    direction: Bounds | None = None
    angle: Bounds | None = None
    scale: Bounds | None = None
    places: tuple[TouchPlaces, ...] = ()


class Gestures(Sequence[Gesture]):
    """Gestures that are certain or possible, in order of the end of what decides them.

    For a touch with a core, all kinds that are not listed with it are impossible; and for two of
    them, if their bundles are two. Touches of one bundle may be one touch: what pairs of them may
    make is listed once for the bundle, without contacts. A touch without a core is listed alone,
    with the kinds that it may be, without contacts, too; pairs with it are not sought.
    """

    __slots__ = ("_gestures",)

    def __init__(self, gestures: Iterable[Gesture]) -> None:
        self._gestures = tuple(gestures)

    def __repr__(self) -> str:
        return f"Gestures({len(self.certain)} certain, {len(self) - len(self.certain)} possible)"

    def _repr_html_(self) -> str:
        def row(k: int) -> list[str]:
            each = self[k]
            return [
                each.kind, each.verdict.name.lower(), ", ".join(map(str, each.contacts)),
                *("" if bound is None else str(bound) for bound in (*each.begin, *each.end)),
            ]  # fmt: skip

        heads = ["gesture", "verdict", "contacts", "begins from", "to", "ends from", "to"]
        return html_table(repr(self), heads, len(self), row)

    @property
    def certain(self) -> Gestures:
        """Those that are certain."""
        return Gestures(each for each in self if each.verdict == 2)

    def of(self, *kinds: Kind) -> Gestures:
        """Those of some kinds."""
        return Gestures(each for each in self if each.kind in kinds)

    def __len__(self) -> int:
        return len(self._gestures)

    @overload
    def __getitem__(self, index: int) -> Gesture: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Gesture, ...]: ...
    def __getitem__(self, index: int | slice) -> Gesture | tuple[Gesture, ...]:
        return self._gestures[index]
