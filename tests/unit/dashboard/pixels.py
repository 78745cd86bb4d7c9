"""Which pixels of a chart are painted in some colours, and which ones must be."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from eskin.wire.timestamp import parse_timestamp

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from tests.unit.dashboard.browsing import Visit

FINE = {"device_scale_factor": 1.5}
"""A screen of which a CSS pixel has no whole number of pixels."""
BAND = "blue - red > 30"
PREDICTED = "red - blue > 20"
CERTAIN = "red - blue > 150 && green < 90"
POSSIBLE = "blue - red > 50 && green < 60"
MISSING = "blue - red > 10 && blue - red < 30 && green < 170"
COVERED = "blue > 40 && red < 200"
"""Band, also where the box of a peak lies behind it; a gap's hatching, too."""
_MASKS = """
(wanted) => {
  const root = document.querySelector("[data-testid=chart]");
  const { plotLeft, plotTop, plotWidth, plotHeight, pixelRatio } = root.dataset;
  const box = [plotLeft, plotTop, plotWidth, plotHeight];
  const [left, top, width, height] = box.map((side) => Math.round(side * pixelRatio));
  const pen = root.querySelector("canvas").getContext("2d");
  const { data } = pen.getImageData(left, top, width, height);
  const masks = wanted.map((colours) => {
    const within = new Function("red", "green", "blue", `return ${colours}`);
    const columns = [];
    for (let x = 0; x < width; x += 1) {
      let column = "";
      for (let y = 0; y < height; y += 1) {
        const at = 4 * (y * width + x);
        column += data[at + 3] > 40 && within(data[at], data[at + 1], data[at + 2]) ? "1" : "0";
      }
      columns.push(column);
    }
    return columns;
  });
  return [{ ...root.dataset }, masks];
}
"""
_SLACK = 1e-6


@dataclass(frozen=True)
class Plot:
    """The plot area of a chart: a picture with what it says that its pixels stand for.

    Attributes:
        columns: For each pixel column from the left, ``1`` for a row in the colours looked for.
        start: The instant at the left edge, ns.
        end: The instant at the right edge, ns.
        lo: The value at the lower edge.
        hi: The value at the upper edge.
        newest: Where what is painted ends, ns; None where nothing is.
    """

    columns: list[str]
    start: int
    end: int
    lo: float
    hi: float
    newest: int | None

    @property
    def painted(self) -> list[bool]:
        """Which columns show the band."""
        return ["1" in column for column in self.columns]

    def column(self, instant: int) -> int:
        """The pixel column of an instant; before 0 and from the width on it is not shown."""
        return (instant - self.start) * len(self.columns) // (self.end - self.start)

    def rows(self, lo: float, hi: float) -> range:
        """All pixel rows that an interval touches."""
        height = len(self.columns[0])
        scale = height / (self.hi - self.lo)
        top = math.floor((self.hi - hi) * scale + _SLACK)
        bottom = math.ceil((self.hi - lo) * scale - _SLACK)
        return range(max(0, top), min(height, max(bottom, top + 1)))

    def encloses(self, instant: int, lo: float, hi: float) -> bool:
        """Whether the band is painted over all of an interval at an instant."""
        column = self.columns[self.column(instant)]
        return all(column[row] == "1" for row in self.rows(lo, hi))


def read_plots(visit: Visit, *colours: str) -> list[Plot]:
    """The pixels of the first chart that have each of these colours, all of the same picture."""
    facts, masks = visit.evaluate(_MASKS, colours)
    return [
        Plot(
            columns=columns,
            start=int(facts["xMin"]),
            end=int(facts["xMax"]),
            lo=float(facts["yMin"]),
            hi=float(facts["yMax"]),
            newest=int(facts["newest"]) if facts["newest"] else None,
        )
        for columns in masks
    ]


def read_plot(visit: Visit, colours: str = BAND) -> Plot:
    """The pixels of the first chart that have such colours."""
    (plot,) = read_plots(visit, colours)
    return plot


def samples_of(series: Mapping[str, Any]) -> Iterator[tuple[int, float, float]]:
    """Each bounded sample of an answer of ``/series``: its instant and bounds."""
    assert series["resolution"] == "sample"
    start = parse_timestamp(series["t0"])
    for offset, lo, hi in zip(series["t"], series["lo"], series["hi"], strict=True):
        if lo is not None and hi is not None:
            yield start + offset, lo, hi
