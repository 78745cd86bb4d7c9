"""Peaks of a tube: *certain* where every signal inside has one, *possible* where some signal has.

For a prominence p and samples ``[lo_k, hi_k]``:

- A certain peak is a < b < c with ``lo_b - hi_a >= p`` and ``lo_b - hi_c >= p``: every signal
  inside the tube has a local maximum of prominence p or more between a and c. One pass with
  hysteresis (track the lowest hi, then the highest lo, and so on) finds the greatest number of
  them that overlap at most in their ends.
- The same pass on the optimistic side (``hi_b - lo_a``, ``hi_b - lo_c``) counts the peaks that some
  signal has. What it finds beyond the certain ones is possible, region by region.

For any signal x inside the tube: N_certain <= len(find_peaks(x, prominence=p)) <= N_certain +
N_possible. A gap ends a signal, and another begins behind it.

Memory is constant, so the search runs over a stream in pieces: `PeakStream`. A node's firmware
searches in plain Python and gives the same events.
"""

from __future__ import annotations

from eskin.peaks.event import PeakEvent, Verdict
from eskin.peaks.stream import PeakStream, find_peaks
from eskin.peaks.table import Peaks

__all__ = ["PeakEvent", "PeakStream", "Peaks", "Verdict", "find_peaks"]
