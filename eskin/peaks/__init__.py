"""Peaks of a tube: *certain* where every signal inside has one, *possible* where some signal has.

A signal x has n peaks of prominence p if n is the greatest number of samples b that have an a
before and a c after them with ``x_b - x_a >= p`` and ``x_b - x_c >= p``, where the c of one peak
may be the a of the next. So

- a plateau is one summit;
- equal summits count one by one only if the signal falls by p or more between them: ``0 3 2 3 0``
  has one peak for p = 3, and two for p = 1;
- the first and the last sample are no summits.

Where all heights differ this is what `scipy.signal.find_peaks` counts. Of equal summits scipy gives
each the prominence that it had if the others were lower, so that it counts two in ``0 3 2 3 0`` for
p = 3, but one as soon as either is lifted by any amount. Codes of a converter tie always.

For samples ``[lo_k, hi_k]``:

- A certain peak is a < b < c with ``lo_b - hi_a >= p`` and ``lo_b - hi_c >= p``: every signal
  inside the tube has a peak between a and c. One pass with hysteresis (track the lowest hi, then
  the highest lo, and so on) finds the greatest number of them that overlap at most in their ends.
- The same pass on the optimistic side (``hi_b - lo_a``, ``hi_b - lo_c``) counts the peaks that some
  signal has. What it finds beyond the certain ones is possible, region by region.

N_certain is the fewest, and N_certain + N_possible the most peaks of any signal inside the tube. A
gap ends a signal, and another begins behind it.

Memory is constant, so the search runs over a stream in pieces: `PeakStream`. A node's firmware
searches in plain Python and gives the same events.
"""

from __future__ import annotations

from eskin.peaks.event import PeakEvent
from eskin.peaks.stream import PeakStream, find_peaks
from eskin.peaks.table import Peaks

__all__ = ["PeakEvent", "PeakStream", "Peaks", "find_peaks"]
