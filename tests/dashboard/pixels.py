"""Which pixels of a chart are painted in some colours, and which ones must be."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from eskin.moment import parse_moment

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from tests.dashboard.browsing import Visit

BAND = "blue - red > 30"
PREDICTED = "red - blue > 20"
CERTAIN = "red - blue > 150 && green < 90"
_MASK = """
([left, top, width, height, colours]) => {
  const within = new Function("red", "green", "blue", `return ${colours}`);
  const canvas = document.querySelector("[data-testid=chart] canvas");
  const { data } = canvas.getContext("2d").getImageData(left, top, width, height);
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
}
"""
_SLACK = 1e-6


@dataclass(frozen=True)
class Plot:
    """The plot area of a chart that shows history, or a moment of a live one.

    Attributes:
        columns: For each pixel column from the left, ``1`` for a row in the colours looked for.
        start: The instant at the left edge, ns.
        end: The instant at the right edge, ns.
        lo: The value at the lower edge.
        hi: The value at the upper edge.
    """

    columns: list[str]
    start: int
    end: int
    lo: float
    hi: float

    @property
    def painted(self) -> list[bool]:
        """Which columns show the band."""
        return ["1" in column for column in self.columns]

    def column(self, moment: int) -> int:
        """The pixel column of an instant."""
        return (moment - self.start) * len(self.columns) // (self.end - self.start)

    def rows(self, lo: float, hi: float) -> range:
        """All pixel rows that an interval touches."""
        height = len(self.columns[0])
        scale = height / (self.hi - self.lo)
        top = math.floor((self.hi - hi) * scale + _SLACK)
        bottom = math.ceil((self.hi - lo) * scale - _SLACK)
        return range(max(0, top), min(height, max(bottom, top + 1)))

    def encloses(self, moment: int, lo: float, hi: float) -> bool:
        """Whether the band is painted over all of an interval at an instant."""
        column = self.columns[self.column(moment)]
        return all(column[row] == "1" for row in self.rows(lo, hi))


def read_plot(visit: Visit, colours: str = BAND) -> Plot:
    """The pixels of the first chart that have such colours."""
    facts = visit.chart()
    ratio = float(facts["pixelRatio"])
    names = ("plotLeft", "plotTop", "plotWidth", "plotHeight")
    box = [round(float(facts[name]) * ratio) for name in names]
    columns = visit.evaluate(_MASK, [*box, colours])
    return Plot(
        columns=columns,
        start=int(facts["xMin"]),
        end=int(facts["xMax"]),
        lo=float(facts["yMin"]),
        hi=float(facts["yMax"]),
    )


def samples_of(series: Mapping[str, Any]) -> Iterator[tuple[int, float, float]]:
    """Each bounded sample of an answer of ``/series``: its instant and bounds."""
    assert series["resolution"] == "sample"
    start = parse_moment(series["t0"])
    for offset, lo, hi in zip(series["t"], series["lo"], series["hi"], strict=True):
        if lo is not None and hi is not None:
            yield start + offset, lo, hi
