import { describe, expect, test } from "vitest";
import type { SeriesAnswer } from "../src/api/contract";
import { Timeline } from "../src/time/timeline";
import { readSeries } from "../src/tube/decode";
import { clipEnd, endOf, hullWithin } from "../src/tube/entries";
import { Tube } from "../src/tube/tube";
import { GAP, run } from "./runs";

describe("reading series", () => {
  const answer: SeriesAnswer = {
    node: "n", channel: "c", unit: "F", coverage: 1, resolution: "sample", t0: "2026-01-31T12:00:00.000000005Z",
    t: [0, 10, 20, 30], lo: [1, null, null, 2], hi: [2, 3, null, null], dt: 10, time_error: 0,
  };
  const timeline = new Timeline(BigInt(Date.parse("2026-01-31T12:00:00Z")) * 1_000_000n);

  test("one null side is unbounded, two are missing", () => {
    const entries = readSeries(answer, timeline);
    expect([...entries.t]).toEqual([5, 15, 25, 35]);
    expect([...entries.lo]).toEqual([1, -Infinity, Number.NaN, 2]);
    expect([...entries.hi]).toEqual([2, 3, Number.NaN, Infinity]);
  });

  test("far from the timeline's origin, an error of time covers what numbers leave out", () => {
    const start = BigInt(Date.parse(answer.t0));
    for (const days of [0n, 100n, 105n, 400n, 40_000n]) {
      const far = new Timeline(start * 1_000_000n - days * 86_400_000_000_000n);
      const { t, error } = readSeries(answer, far);
      answer.t.forEach((offset, i) => {
        const exact = start * 1_000_000n + 5n + BigInt(offset) - far.origin;
        const off = exact - BigInt(t[i]!);
        expect(Number(off < 0n ? -off : off)).toBeLessThanOrEqual(error[i]!);
        expect(error[i]! > 0).toBe(days > 104n);
      });
    }
  });

  test("a sample has no width, a hull that of its bucket", () => {
    expect(readSeries(answer, timeline).width[0]).toBe(0);
    expect(readSeries({ ...answer, resolution: "hull" }, timeline).width[0]).toBe(10);
  });
});

describe("the rolling tube", () => {
  test("late blocks take their place in time", () => {
    const tube = new Tube(100);
    tube.merge(run(0, [[1, 2], [1, 2]]));
    tube.merge(run(40, [[5, 6]]));
    tube.merge(run(20, [[3, 4], [3, 4]]));
    expect([...tube.view().t]).toEqual([0, 10, 20, 30, 40]);
    expect([...tube.view().lo]).toEqual([1, 1, 3, 3, 5]);
  });

  test("the same block twice is held once", () => {
    const tube = new Tube(100);
    const block = run(0, [[1, 2], [3, 4], [5, 6]]);
    tube.merge(block);
    tube.merge(block);
    expect(tube.size).toBe(3);
  });

  test("a bucket that ends where the next block begins leaves its first value", () => {
    const tube = new Tube(100);
    tube.merge(run(100, [[5, 6], [7, 8]], 10));
    tube.merge(run(80, [[1, 2], [3, 4]], 10));
    expect([...tube.view().lo]).toEqual([1, 3, 5, 7]);
  });

  test("a run cut at an instant holds nothing beyond it", () => {
    const cut = clipEnd(run(0, [[1, 2], [3, 4], [5, 6]], 10), 15);
    expect([...cut.t]).toEqual([0, 10]);
    expect([...cut.width]).toEqual([10, 5]);
  });

  test("what has left the window is forgotten", () => {
    const tube = new Tube(100);
    tube.merge(run(0, [[1, 2], [1, 2], [1, 2]]));
    tube.evictBefore(15);
    expect([...tube.view().t]).toEqual([20]);
  });
});

describe("a full tube", () => {
  test("it joins neighbours and still encloses everything", () => {
    const tube = new Tube(64);
    const all: [number, number][] = [];
    for (let block = 0; block < 40; block += 1) {
      const values = Array.from({ length: 10 }, (_, i): [number, number] => [Math.sin(block + i), Math.sin(block + i) + 1]);
      all.push(...values);
      tube.merge(run(block * 100, values));
    }
    expect(tube.size).toBeLessThanOrEqual(64);
    for (const [index, [lo, hi]] of all.entries()) {
      const hull = hullWithin(tube.view(), index * 10, index * 10);
      expect(hull.count).toBeGreaterThan(0);
      expect(hull.lo).toBeLessThanOrEqual(lo);
      expect(hull.hi).toBeGreaterThanOrEqual(hi);
    }
  });

  test("it never joins across a gap", () => {
    const tube = new Tube(16);
    for (let block = 0; block < 8; block += 1) {
      tube.merge(run(block * 100, [[1, 2], [1, 2], [1, 2], GAP]));
    }
    const view = tube.view();
    for (let i = 0; i < view.t.length; i += 1) {
      if (Number.isNaN(view.lo[i]!)) continue;
      expect(Math.floor(view.t[i]! / 100)).toBe(Math.floor((view.t[i]! + view.width[i]!) / 100));
    }
    expect(tube.size).toBeLessThanOrEqual(16);
  });

  test.each([3, 4, 5, 6])("a break after %i quick samples stays one beside slow ones", (count) => {
    const tube = new Tube(16);
    tube.merge(run(0, [[1, 2], [1, 2]], 0, 1000));
    tube.merge(run(2000, Array.from({ length: count }, () => [3, 4] as const)));
    for (const start of [2200, 2300, 2400]) tube.merge(run(start, Array.from({ length: count }, () => [5, 6] as const)));
    const { t, width, lo, hi } = tube.view();
    expect(t.length).toBeLessThanOrEqual(16);
    expect([...t].some((begin, i) => begin < 2200 && begin + (width[i] ?? 0) > 2100)).toBe(false);
    expect([...lo].some((low, i) => low < 5 && (hi[i] ?? 0) > 4)).toBe(false);
  });

  test("it forgets its oldest part when nothing can be joined", () => {
    const tube = new Tube(8);
    for (let i = 0; i < 30; i += 1) tube.merge(run(i * 1000, [[i, i + 1]]));
    expect(tube.size).toBeLessThanOrEqual(8);
    expect(endOf(tube.view())).toBe(29_000);
  });
});
