"""Gestures on a skin."""

from typing import Literal

from typing_extensions import TypedDict

from eskin.gestures import Gesture, Kind
from eskin_cloud.schemas.base import Instant, IntervalDocument, instant, interval
from eskin_cloud.schemas.contacts import Bounds


class SampledInstantDocument(TypedDict):
    """An enclosure of a sampled instant; a side that is null is not in the window."""

    lo: Instant | None
    hi: Instant | None


class TouchPlacesDocument(TypedDict):
    """Where a touch begins and ends: bounds of its centroid in m for each axis; null: not known."""

    begin: list[Bounds]
    end: list[Bounds]


class GestureDocument(TypedDict):
    """A gesture that is certain or possible.

    ``contacts`` are labels of the contacts of its touches, counted within this answer; none where
    the touch itself is possible, or where its touches may be one. ``begin`` and ``end`` enclose the
    times of its first and its last sampled instant. ``direction`` of a slide or a swipe, and
    ``angle`` by which two touches turn, are in rad; ``scale`` is the distance of two touches at the
    end over that at the begin. ``places`` are those of each touch; none where its touches may be
    one.
    """

    kind: Kind
    verdict: Literal["possible", "certain"]
    contacts: list[int]
    begin: SampledInstantDocument
    end: SampledInstantDocument
    direction: IntervalDocument | None
    angle: IntervalDocument | None
    scale: IntervalDocument | None
    places: list[TouchPlacesDocument]


def describe_gesture(gesture: Gesture) -> GestureDocument:
    """A gesture as an item of the list."""
    return {
        "kind": gesture.kind,
        "verdict": "certain" if gesture.verdict == 2 else "possible",
        "contacts": list(gesture.contacts),
        "begin": _enclosure(gesture.begin),
        "end": _enclosure(gesture.end),
        "direction": _bounds(gesture.direction),
        "angle": _bounds(gesture.angle),
        "scale": _bounds(gesture.scale),
        "places": [{"begin": list(each.begin), "end": list(each.end)} for each in gesture.places],
    }


def _enclosure(instants: tuple[int | None, int | None]) -> SampledInstantDocument:
    return {"lo": instant(instants[0]), "hi": instant(instants[1])}


def _bounds(bounds: tuple[float, float] | None) -> IntervalDocument | None:
    return None if bounds is None else interval(*bounds)
