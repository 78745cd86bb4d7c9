"""Gestures on a skin: which are certain, which possible, and which impossible.

A taxel is pressed where its true pressure exceeds a threshold, and only the sampled instants count.
A *touch* is a connected component of the pressed taxels over time: two of them are connected if
they are neighbours at one instant, or one taxel at two consecutive ones. Templates are predicates
of touches (`Templates` has the constants):

- A touch lasts from its first instant to its last one. Its place at an instant is the centroid of
  its taxels, weighted by area; what does not move farther than ``still_m`` along any coordinate is
  *still*. It is a **tap** if it is still for ``tap_ns`` or less, a **hold** if for ``hold_ns`` or
  more, else a **press**. It is a **swipe** if its last place is ``slide_m`` or more from its first
  one, at a mean speed of ``swipe_m_per_s`` or more, and a **slide** if slower.
- Two taps are a **double tap** if the second begins after the end of the first, ``pause_ns`` later
  or less, and their first places are ``apart_m`` or less apart.
- Two touches that both last for ``together_ns`` or more make a **pinch** if their distance at the
  last instant that both have is less by a factor of ``scale`` or more than at the first one, a
  **spread** if it is greater by that, else a **rotation** if the line from the one to the other
  turns by 30° or more. Both distances are ``span_m`` at most.

Of intervals it is known which taxels are certainly, and which are possibly pressed. A component
over time of the former lies in one touch, and each touch lies in a component of the latter, which
is its *bundle*. So instants, places, distances and angles of a touch are enclosed by what lies
between, and templates are evaluated with three values.

`find_gestures` answers for a record, and `GestureStream` for samples that arrive in pieces.
"""

from __future__ import annotations

from eskin.gestures.gestures import Gesture, Gestures, TouchPlaces
from eskin.gestures.stream import GestureStream, find_gestures
from eskin.gestures.templates import Kind, Templates

__all__ = [
    "Gesture",
    "GestureStream",
    "Gestures",
    "Kind",
    "Templates",
    "TouchPlaces",
    "find_gestures",
]
