import { describe, expect, test } from "vitest";
import { halfMarkFor, OPEN_BOTTOM, OPEN_TOP, reduceToColumns } from "../src/chart/band";
import { groupPeaks, type PeakMark } from "../src/chart/peaks";
import { enclosingBox, type PlotMap, xPixel, yPixel } from "../src/chart/plot-map";
import { lanesOf, missingStretches, readSegment, type Segment, withoutPauses } from "../src/chart/segments";
import { calmRange, finiteExtent } from "../src/chart/value-range";
import { Timeline } from "../src/time/timeline";
import type { Entries } from "../src/tube/entries";

const MAP: PlotMap = { width: 200, height: 100, xMin: 0, xMax: 1000, yMin: 0, yMax: 10 };
const STYLE = { halfMark: 1.5, thickness: 2 };

function entries(rows: readonly (readonly [t: number, width: number, lo: number, hi: number])[], timeError = 0): Entries {
  const column = (index: 0 | 1 | 2 | 3): Float64Array => Float64Array.from(rows, (row) => row[index]);
  const [doubt, error] = [new Float64Array(rows.length), new Float64Array(rows.length).fill(timeError)];
  return { t: column(0), width: column(1), lo: column(2), hi: column(3), doubt, error, reach: new Float64Array(rows.length).fill(10) };
}

describe("pixel columns", () => {
  test("the painted stretch encloses every value of its column", () => {
    const rows = Array.from({ length: 5000 }, (_, i): [number, number, number, number] => {
      const lo = 4 + 3 * Math.sin(i / 37) + 0.3 * Math.cos(i * i);
      return [i * 0.2, 0, lo, lo + 0.013 * (1 + Math.sin(i))];
    });
    const columns = reduceToColumns(entries(rows), MAP, STYLE);
    for (const [t, , lo, hi] of rows) {
      const column = Math.floor(xPixel(MAP, t));
      expect(columns.top[column]!).toBeLessThanOrEqual(yPixel(MAP, hi) + 1e-9);
      expect(columns.bottom[column]!).toBeGreaterThanOrEqual(yPixel(MAP, lo) - 1e-9);
    }
  });

  test("an interval without height is still visible", () => {
    const columns = reduceToColumns(entries([[500, 0, 5, 5]]), MAP, STYLE);
    expect(columns.bottom[100]! - columns.top[100]!).toBeGreaterThanOrEqual(2);
  });

  test("nothing is painted between samples that lie apart", () => {
    const columns = reduceToColumns(entries([[250, 0, 4, 5], [750, 0, 4, 5]]), MAP, STYLE);
    const painted = [...columns.bottom].filter((bottom) => bottom > 0).length;
    expect(columns.bottom[100]).toBe(-1);
    expect(painted).toBeLessThanOrEqual(8);
  });

  test("a hull fills its bucket and stops there", () => {
    const columns = reduceToColumns(entries([[100, 200, 4, 5]]), MAP, STYLE);
    expect([...columns.bottom].map((bottom) => bottom > 0).indexOf(true)).toBe(19);
    expect(columns.bottom[20]).toBeGreaterThan(0);
    expect(columns.bottom[59]).toBeGreaterThan(0);
    expect(columns.bottom[62]).toBe(-1);
  });

  test("an error of time widens a mark to both sides", () => {
    const columns = reduceToColumns(entries([[500, 0, 4, 5]], 50), MAP, STYLE);
    expect(columns.bottom[90]).toBeGreaterThan(0);
    expect(columns.bottom[109]).toBeGreaterThan(0);
  });

  test("a region's box encloses it in whole pixels", () => {
    const box = enclosingBox(MAP, { x0: 101, x1: 102, lo: 5.01, hi: 5.02 }, 4);
    expect(box.right - box.left).toBeGreaterThanOrEqual(4);
    expect(box.top).toBeLessThanOrEqual(yPixel(MAP, 5.02));
    expect(box.bottom).toBeGreaterThanOrEqual(yPixel(MAP, 5.01));
  });
});

describe("what the columns leave out", () => {
  test("an unbounded side runs to the edge and is marked", () => {
    const columns = reduceToColumns(entries([[250, 0, 4, Infinity], [750, 0, -Infinity, 4]]), MAP, STYLE);
    expect([columns.top[50], columns.open[50]]).toEqual([0, OPEN_TOP]);
    expect([columns.bottom[150], columns.open[150]]).toEqual([100, OPEN_BOTTOM]);
  });

  test("missing values leave a break", () => {
    const columns = reduceToColumns(entries([[0, 100, 1, 2], [100, 100, Number.NaN, Number.NaN], [200, 100, 1, 2]]), MAP, STYLE);
    expect(columns.bottom[30]).toBe(-1);
    expect(columns.bottom[10]).toBeGreaterThan(0);
    expect(columns.bottom[50]).toBeGreaterThan(0);
  });

  test("marks of samples never meet once there is room between them", () => {
    for (const spacing of [4, 8, 20, 100]) expect(2 * halfMarkFor(spacing, 1)).toBeLessThan(spacing);
  });
});

describe("scale and stretches", () => {
  test("the extent leaves out unbounded sides", () => {
    expect(finiteExtent(entries([[0, 0, 1, Infinity], [10, 0, -Infinity, 3]]), 0, 100)).toEqual({ min: 1, max: 3 });
  });

  test("the extent takes in what is painted in the window, as its time may be wrong", () => {
    expect(finiteExtent(entries([[0, 0, 1, 9], [50, 0, 2, 3]], 20), 15, 100)).toEqual({ min: 1, max: 9 });
    expect(finiteExtent(entries([[0, 0, 1, 9], [50, 0, 2, 3]], 10), 15, 100)).toEqual({ min: 2, max: 3 });
    expect(finiteExtent(entries([[50, 0, 2, 3], [120, 0, 1, 9]], 20), 15, 100)).toEqual({ min: 1, max: 9 });
  });

  test("numbers too large to subtract run to the edges, and are marked", () => {
    const huge = entries([[250, 0, -1.7e308, 1.7e308], [750, 0, 1, 2]]);
    const { min, max } = calmRange(null, finiteExtent(huge, 0, 1000));
    const columns = reduceToColumns(huge, { ...MAP, yMin: min, yMax: max }, STYLE);
    expect([columns.top[50], columns.bottom[50], columns.open[50]]).toEqual([0, 100, OPEN_TOP | OPEN_BOTTOM]);
    expect(columns.bottom[150]).toBeGreaterThan(0);
  });

  test("the scale grows at once and shrinks late", () => {
    const first = calmRange(null, { min: 0, max: 10 });
    expect(calmRange(first, { min: 1, max: 9 })).toBe(first);
    expect(calmRange(first, { min: -5, max: 10 }).min).toBeLessThanOrEqual(-5);
    expect(calmRange(first, { min: 4, max: 5 }).max).toBeLessThan(6);
  });

  test("a gap reaches from its missing entry to the next known one", () => {
    const gap = entries([[0, 0, 1, 2], [10, 0, Number.NaN, Number.NaN], [60, 0, 1, 2]]);
    expect(missingStretches(gap, 0, 100)).toEqual([{ x0: 10, x1: 60 }]);
  });

  test("pauses between bursts are no gaps, but an outage is", () => {
    const pauses = [0, 100, 200].map((x0) => ({ x0, x1: x0 + 96 }));
    const outage = { x0: 500, x1: 900 };
    expect(withoutPauses([...pauses, outage])).toEqual([outage]);
    expect(withoutPauses(pauses.slice(0, 2))).toEqual([]);
  });
});

function peak(x0: number, verdict: "certain" | "possible", count: readonly [number, number]): PeakMark {
  const event = { id: String(x0) } as PeakMark["event"];
  return { event, verdict, x0, x1: x0 + 2, lo: x0, hi: x0 + 1, count: { lo: count[0], hi: count[1] }, events: 1 };
}

describe("peaks that lie too close", () => {
  test("their counts add as intervals and one certain peak makes a group certain", () => {
    const groups = groupPeaks([peak(0, "possible", [0, 3]), peak(5, "certain", [1, 1]), peak(50, "possible", [0, 1])], 10);
    expect(groups.map(({ verdict, events, count }) => [verdict, events, count.lo, count.hi])).toEqual([
      ["certain", 2, 1, 4],
      ["possible", 1, 0, 1],
    ]);
    expect([groups[0]?.x0, groups[0]?.x1, groups[0]?.lo, groups[0]?.hi]).toEqual([0, 7, 0, 6]);
  });
});

function stated(x0: number, x1: number, verdict: Segment["verdict"], error: number): Segment {
  return { x0, x1, verdict, error };
}

function touched(lane: Uint8Array): number[] {
  return [...lane.keys()].filter((column) => lane[column] === 1);
}

describe("answers to a question", () => {
  test("are certain where they are so wherever their true instants lie, else possible", () => {
    const { certain, possible } = lanesOf(MAP, [stated(200, 400, "certain", 50), stated(700, 720, "possible", 30)]);
    const all = touched(certain);
    expect(all.length).toBeGreaterThanOrEqual(20);
    for (const begin of [150, 187, 250]) {
      for (const end of [350, 411, 450]) {
        for (const column of all) expect(5 * (column + 1) >= begin && 5 * column <= end).toBe(true);
        for (let x = begin; x <= end; x += 1) {
          const column = Math.floor(xPixel(MAP, x));
          expect(certain[column]! + possible[column]!).toBe(1);
        }
      }
    }
    for (let x = 670; x < 750; x += 1) expect(possible[Math.floor(xPixel(MAP, x))]).toBe(1);
    expect(possible[132]! + possible[151]!).toBe(0);
  });

  test("are possible within the error of their ends, and certain in a column that holds all of it", () => {
    const short = [stated(500, 502, "certain", 50)];
    const fine = lanesOf(MAP, short);
    expect([touched(fine.certain), touched(fine.possible).length]).toEqual([[], 22]);
    const coarse = lanesOf({ ...MAP, xMax: 200_000 }, short);
    expect([touched(coarse.certain), touched(coarse.possible)]).toEqual([[0], []]);
  });

  test("are painted to the last column where their times are right", () => {
    expect(touched(lanesOf(MAP, [stated(500, 500, "certain", 0)]).certain)).toEqual([99, 100]);
    expect(touched(lanesOf(MAP, [stated(-50, -20, "certain", 0), stated(1020, 1050, "possible", 0)]).certain)).toEqual([]);
  });

  test("begin and end where they are stated", () => {
    const timeline = new Timeline(BigInt(Date.parse("2026-01-31T12:00:00Z")) * 1_000_000n);
    const item = { start: "2026-01-31T12:00:00.000000005Z", end: "2026-01-31T12:00:00.000000025Z", verdict: "certain" } as const;
    expect(readSegment(item, timeline)).toEqual({ x0: 5, x1: 25, verdict: "certain", error: 0 });
  });
});
