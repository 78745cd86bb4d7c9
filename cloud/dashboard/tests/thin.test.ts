import { describe, expect, test } from "vitest";
import { type Entries, hullWithin, stopOf } from "../src/tube/entries";
import { thin } from "../src/tube/join";
import { random } from "./runs";

const STEP = 10;

function run(lo: readonly number[], t = lo.map((_, i) => 1000 + i * STEP), width = 0): Entries {
  return {
    t: Float64Array.from(t),
    width: new Float64Array(t.length).fill(width),
    lo: Float64Array.from(lo),
    hi: Float64Array.from(lo, (low) => low + 1),
    doubt: new Float64Array(t.length).fill(0.25),
    error: Float64Array.from(t, (_, i) => i % 7),
    reach: new Float64Array(t.length).fill(1.5 * STEP),
  };
}

describe("thinning a run", () => {
  test("each hull is exactly that of what it joins, and nothing is left out", () => {
    for (let seed = 1; seed < 60; seed += 1) {
      const draw = random(seed);
      const values = Array.from({ length: 200 }, () => (draw() < 0.1 ? Number.NaN : draw() < 0.1 ? -Infinity : draw()));
      let at = 0;
      const times = values.map(() => (at += draw() < 0.05 ? 100 * STEP : STEP));
      const whole = run(values, times, seed % 2 === 0 ? STEP : 0);
      const grain = STEP * (1 + 20 * draw());
      const few = thin(whole, grain);
      expect(few.t.length).toBeLessThan(whole.t.length);
      for (let i = 0, from = 0; i < few.t.length; i += 1) {
        const stop = few.t[i]! + few.width[i]!;
        let count = 0;
        while (from + count < times.length && whole.t[from + count]! + whole.width[from + count]! <= stop) count += 1;
        expect(whole.t[from]).toBe(few.t[i]);
        const last = from + count - 1;
        expect(count > 1 ? stopOf(whole, last) : whole.t[last]! + whole.width[last]!).toBe(stop);
        expect(few.doubt[i]).toBe(0.25 * count);
        expect(few.error[i]).toBe(Math.max(...whole.error.subarray(from, from + count)));
        const lows = [...whole.lo.subarray(from, from + count)];
        const highs = [...whole.hi.subarray(from, from + count)];
        expect(few.lo[i]).toBe(Math.min(...lows));
        expect(few.hi[i]).toBe(Math.max(...highs));
        expect(lows.every((low) => Number.isNaN(low)) || !lows.some((low) => Number.isNaN(low))).toBe(true);
        expect(few.width[i]).toBeLessThan(grain + STEP);
        from += count;
        if (i === few.t.length - 1) expect(from).toBe(times.length);
      }
    }
  });

  test("it never joins across a break", () => {
    const broken = run([1, 2, 8, 9], [0, STEP, 5 * STEP, 6 * STEP]);
    const few = thin(broken, 1000 * STEP);
    expect([...few.t]).toEqual([0, 5 * STEP]);
    expect(hullWithin(few, 2 * STEP, 4 * STEP).count).toBe(0);
  });

  test("what is coarse enough stays as it is", () => {
    const whole = run([1, 2, 3]);
    expect(thin(whole, STEP / 2)).toEqual(whole);
    expect(thin(whole, 0)).toBe(whole);
  });
});
