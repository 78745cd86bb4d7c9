import { describe, expect, test } from "vitest";
import { missingStretches } from "../src/chart/segments";
import { type Entries, hullWithin } from "../src/tube/entries";
import { thin } from "../src/tube/join";
import { Tube } from "../src/tube/tube";
import { GAP, random, run } from "./runs";

function doubtful(entries: Entries, doubt: number, error: number): Entries {
  return { ...entries, doubt: entries.t.map(() => doubt), error: entries.t.map(() => error) };
}

describe("blocks that overlap", () => {
  test("a hull that reaches into a run holds there, too: its samples may lie anywhere in it", () => {
    const tube = new Tube(100);
    tube.merge(run(0, [[1, 9]], 100));
    tube.merge(run(40, [[3, 4], [5, 16]], 10));
    const { t, width, lo, hi } = tube.view();
    expect([...t]).toEqual([0, 40, 50, 60]);
    expect([...width]).toEqual([40, 10, 10, 40]);
    expect([...lo]).toEqual([1, 1, 1, 1]);
    expect([...hi]).toEqual([9, 9, 16, 9]);
  });

  test("a late block takes nothing from the samples that its last bucket claims time of", () => {
    const tube = new Tube(1000);
    // 250 samples each, 10 apart, in buckets of 3; the late one has one sample in its last bucket.
    const spike = Array.from({ length: 84 }, (_, i): [number, number] => (i === 0 ? [50, 51] : [1, 2]));
    tube.merge(run(2500, spike, 30, 30));
    tube.merge(run(0, Array.from({ length: 84 }, () => [1, 2] as const), 30, 30));
    expect(hullWithin(tube.view(), 2490, 2600).hi).toBe(51);
    expect(hullWithin(tube.view(), 2500, 2500).hi).toBe(51);
    expect(tube.size).toBeLessThanOrEqual(2 * 84 + 2);
    expect(hullWithin(tube.view(), 2531, 5000).hi).toBe(2);
  });

  test("two boots that overlap keep all samples of both", () => {
    const tube = new Tube(1000);
    tube.merge(run(0, Array.from({ length: 100 }, () => [1, 2] as const)));
    tube.merge(run(5, Array.from({ length: 100 }, () => [3, 4] as const)));
    tube.merge(run(10, [[7, 8]]));
    const { t, width, lo } = tube.view();
    expect(t.length).toBe(201);
    expect([...lo].filter((one) => one === 1).length).toBe(100);
    expect([...lo].filter((one) => one === 3).length).toBe(100);
    expect([...t]).toEqual([...t].toSorted((one, other) => one - other));
    expect(width.every((one) => one === 0)).toBe(true);
  });
});

describe("blocks of any kind", () => {
  test("take no more room than there is, however often they overlap", () => {
    const tube = new Tube(64);
    for (let from = 0; from < 10; from += 1) {
      tube.merge(run(from, Array.from({ length: 40 }, (_, i): [number, number] => [i, i + from])));
      expect(tube.size).toBeLessThanOrEqual(64);
    }
    for (let i = 0; i < 40; i += 1) expect(hullWithin(tube.view(), 10 * i + 9, 10 * i + 9).hi).toBeGreaterThanOrEqual(i + 9);
  });

  test("whatever comes over whatever, each sample of each block stays enclosed", () => {
    for (let seed = 1; seed < 200; seed += 1) {
      const draw = random(seed);
      const tube = new Tube(4096);
      const samples: [x: number, value: number][] = [];
      for (let block = 0; block < 8; block += 1) {
        const stride = 1 + Math.floor(draw() * 4);
        const values = Array.from({ length: 3 + Math.floor(draw() * 20) }, () => Math.floor(1000 * draw()));
        const from = Math.floor(300 * draw());
        for (const [i, value] of values.entries()) samples.push([from + 10 * i, value]);
        const buckets = values.flatMap((_, i): [number, number][] => {
          const bucket = values.slice(i, i + stride);
          return i % stride === 0 ? [[Math.min(...bucket), Math.max(...bucket)]] : [];
        });
        const whole = run(from, buckets, stride === 1 ? 0 : 10 * stride, 10 * stride);
        tube.merge(thin(whole, draw() < 0.5 ? 0 : 35));
      }
      const { t, width, lo, hi } = tube.view();
      const lost = samples.filter(([x, value]) => !t.some((begin, i) => (x === begin || (x > begin && x < begin + width[i]!)) && lo[i]! <= value && value <= hi[i]!));
      expect(lost).toEqual([]);
      expect(t.slice(1).every((next, i) => t[i]! + width[i]! <= next)).toBe(true);
    }
  });
});

describe("what is put where something is held", () => {
  test("a late block fills its part of a hole, without slivers between its samples", () => {
    const tube = new Tube(100);
    tube.merge(run(0, [[1, 2]]));
    tube.merge(run(10, [GAP], 190));
    tube.merge(run(200, [[1, 2]]));
    tube.merge(run(100, [[3, 4], [3, 4], [3, 4]]));
    expect(missingStretches(tube.view(), 0, 300)).toEqual([{ x0: 10, x1: 100 }, { x0: 120, x1: 200 }]);
  });

  test("data behind all that is known is put there and touches nothing", () => {
    const tube = new Tube(100);
    tube.merge(run(0, [[1, 2], [3, 4]], 10));
    const before = tube.view();
    tube.merge(run(20, [[5, 6]], 10));
    expect(tube.view().t.buffer).toBe(before.t.buffer);
    expect([...tube.view().width]).toEqual([10, 10, 10]);
  });

  test("hulls that lie over each other are as doubtful as both, and their times as wrong as the worst", () => {
    const tube = new Tube(100);
    tube.merge(doubtful(run(0, [[1, 2], [1, 2]], 10), 0.25, 7));
    tube.merge(doubtful(run(15, [[3, 4]], 10), 0.5, 3));
    expect([...tube.view().t]).toEqual([0, 10, 15, 20]);
    expect([...tube.view().doubt]).toEqual([0.25, 0.25, 0.75, 0.5]);
    expect([...tube.view().error]).toEqual([7, 7, 7, 3]);
  });

  test("the store's answer takes the place of all that is held of its stretch, and of nothing else", () => {
    const tube = new Tube(100);
    tube.merge(run(0, [[1, 9]], 100));
    tube.merge(run(100, [[5, 6]]));
    tube.replace({ x0: 20, x1: 60 }, run(20, [[3, 4], [3, 4], [3, 4], [3, 4]]));
    const { t, width, hi } = tube.view();
    expect([...t]).toEqual([0, 20, 30, 40, 50, 60, 100]);
    expect([...width]).toEqual([20, 0, 0, 0, 0, 40, 0]);
    expect([...hi]).toEqual([9, 4, 4, 4, 4, 9, 6]);
  });
});
