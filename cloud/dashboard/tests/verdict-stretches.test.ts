import { describe, expect, test } from "vitest";
import type { VerdictItem } from "../src/api/contract";
import { type PlotMap } from "../src/chart/plot-map";
import {
  columnCodes, columnRuns, describeStretches, LOOKS, lookOf, readStretches, summarise, touching, type VerdictStretch,
} from "../src/chart/verdict-stretches";
import { parseInstant, printInstant } from "../src/time/instant";
import { Timeline } from "../src/time/timeline";

const ORIGIN = parseInstant("2026-01-31T12:00:00Z");
const TIMELINE = new Timeline(ORIGIN);
const MAP: PlotMap = { width: 100, height: 14, xMin: 0, xMax: 1000, yMin: 0, yMax: 1 };
const KINDS = [
  { verdict: "certain", missing: false }, { verdict: "possible", missing: false },
  { verdict: "impossible", missing: false }, { verdict: "possible", missing: true },
] as const;

function item(from: number, to: number, more: Partial<VerdictItem> = {}): VerdictItem {
  const [start, end] = [printInstant(ORIGIN + BigInt(from)), printInstant(ORIGIN + BigInt(to))];
  return { start, end, includes_start: true, includes_end: false, verdict: "certain", because: [], missing: false, coverage: 1, ...more };
}

/** Stretches one after another, each with the next kind of verdict. */
function tiled(edges: readonly number[], kinds: readonly number[] = edges.map((_, i) => i)): VerdictStretch[] {
  const items = edges.slice(1).map((end, i) => item(edges[i]!, end, KINDS[kinds[i]! % KINDS.length]!));
  return readStretches(items, TIMELINE);
}

/** Numbers in [0, 1) that are the same in each run. */
function dice(seed: number): () => number {
  let state = seed;
  return () => {
    state = (state * 1_103_515_245 + 12_345) % 2 ** 31;
    return state / 2 ** 31;
  };
}

describe("verdicts in the columns of a strip", () => {
  test("a column that several verdicts touch is possible, and others are what they are all over", () => {
    const roll = dice(7);
    for (let round = 0; round < 300; round += 1) {
      const inner = Array.from({ length: Math.floor(roll() * 40) }, () => Math.floor(roll() * 1001));
      const edges = [...new Set([0, ...inner, 1000])].toSorted((one, other) => one - other);
      const stretches = tiled(edges, edges.map(() => Math.floor(roll() * 4)));
      const codes = columnCodes(MAP, stretches);
      for (const [column, code] of codes.entries()) {
        const [from, to] = [10 * column, 10 * column + 10];
        // As the definition has it: all looks within the column, which is closed as edges may lie on it.
        const inside = new Set(stretches.filter(({ x0, x1 }) => x0 < to && x1 > from).map(lookOf));
        const around = new Set(stretches.filter(({ x0, x1 }) => x0 <= to && x1 >= from).map(lookOf));
        const look = LOOKS[code]!;
        if (inside.size > 1) expect(look).toBe("possible");
        else if (look !== "possible") expect([...inside]).toEqual([look]);
        if (around.size === 1) expect([...around]).toEqual([look]);
      }
    }
  });

  test("a verdict that is thinner than a pixel makes its column possible", () => {
    const codes = columnCodes(MAP, tiled([0, 505, 506, 1000], [0, 2, 0]));
    expect(LOOKS[codes[50]!]).toBe("possible");
    expect([LOOKS[codes[49]!], LOOKS[codes[51]!]]).toEqual(["certain", "certain"]);
  });

  test("an instant counts as much as a stretch", () => {
    expect(LOOKS[columnCodes(MAP, tiled([0, 505, 505, 1000], [2, 0, 2]))[50]!]).toBe("possible");
  });

});

describe("the edges of a strip, and its runs", () => {
  test("what was not asked is left out, also in part of a column", () => {
    const looks = [...columnCodes(MAP, tiled([103, 897], [0]))].map((code) => LOOKS[code]);
    expect(looks.indexOf("certain")).toBe(11);
    expect(looks.lastIndexOf("certain")).toBe(88);
    expect(new Set(columnCodes(MAP, []))).toEqual(new Set([0]));
  });

  test("ends that are rounded are possible as far as they may be wrong", () => {
    const [one, other] = tiled([0, 500, 1000], [0, 2]);
    const codes = columnCodes(MAP, [{ ...one!, error: 25 }, { ...other!, error: 25 }]);
    expect([47, 48, 51, 52].map((column) => LOOKS[codes[column]!])).toEqual(["possible", "possible", "possible", "possible"]);
    expect([LOOKS[codes[46]!], LOOKS[codes[53]!]]).toEqual(["certain", "impossible"]);
  });

  test("runs of columns put together are all columns", () => {
    const codes = Uint8Array.from([0, 1, 1, 3, 3, 3, 2]);
    const runs = columnRuns(codes);
    expect(runs.map(({ left, right }) => right - left)).toEqual([1, 2, 3, 1]);
    expect(runs.flatMap(({ left, right, code }) => Array.from({ length: right - left }, () => code))).toEqual([...codes]);
  });

  test("a column is read as the stretches that colour it", () => {
    const stretches = tiled([0, 500, 505, 1000]);
    expect(touching(MAP, stretches, 10)).toEqual([stretches[0]]);
    expect(touching(MAP, stretches, 50)).toEqual(stretches);
    expect(touching(MAP, stretches, 70)).toEqual([stretches[2]]);
  });
});

describe("what a strip says", () => {
  const ALL = { x0: 0, x1: 9e9 };
  const values = (found: VerdictStretch[]): Record<string, string> =>
    Object.fromEntries(describeStretches(found, ALL)!.lines.map(({ name, value }) => [name, value]));

  test("a possible stretch has its causes in words, and its coverage", () => {
    const [one] = readStretches([item(1e9, 3e9, { verdict: "possible", because: ["width", "pending"], coverage: 0.999 })], TIMELINE);
    expect(describeStretches([one!], ALL)!.title).toBe("possible");
    expect(values([one!])).toMatchObject({ because: "width of the interval, not known yet", coverage: "≥ 99.9 %" });
  });

  test("a certain stretch is rounded inward, and a possible one outward", () => {
    const within = { x: 1_000_400_000, y: 2_999_600_000 };
    const [certain] = readStretches([item(within.x, within.y)], TIMELINE);
    const [possible] = readStretches([item(within.x, within.y, { verdict: "possible" })], TIMELINE);
    expect(values([certain!])["since"]).toMatch(/:01\.001$/);
    expect(values([certain!])["until"]).toMatch(/:02\.999$/);
    expect(values([possible!])["since"]).toMatch(/:01\.000$/);
    expect(values([possible!])["until"]).toMatch(/:03\.000$/);
  });

  test("a stretch at an edge of the answer may be longer", () => {
    const [one] = readStretches([item(0, 9e9)], TIMELINE);
    expect(values([one!])["since"]).toMatch(/ or before$/);
    expect(values([one!])["until"]).toMatch(/ or later$/);
  });

  test("several stretches in one place are counted, and missing samples are named", () => {
    const found = tiled([10, 20, 30, 40], [0, 2, 3]);
    const text = describeStretches(found, ALL)!;
    expect(text.title).toBe("certain, impossible, samples missing");
    expect(text.kind).toContain("3 stretches");
    expect(describeStretches([found[2]!], ALL)!.title).toBe("samples missing");
    expect(describeStretches([], ALL)).toBeNull();
  });

  test("the summary has all verdicts, with certain time rounded down and possible time up", () => {
    const stretches = tiled([0, 1_000_400_000, 2_000_900_000, 2_000_900_001], [0, 1, 0]);
    expect(summarise(stretches)).toBe(
      "Verdicts of the formula: certain for 1 s in 2 stretches; possible for 1.001 s in 1 stretch; nowhere impossible; nowhere samples missing.",
    );
  });
});
