import { describe, expect, test } from "vitest";
import { readFrame, readFrames } from "../src/frames/frame";
import { columnOf, runOf } from "../src/skin/column-series";
import { quantitiesIn, skinOf, taxelsOf } from "../src/skin/layout";
import { emptyPicture, stretchOf, Stretches } from "../src/skin/stretches";
import { Timeline } from "../src/time/timeline";
import { leastSpacing } from "../src/tube/entries";
import vectors from "./skin.json";

const timeline = new Timeline(BigInt(vectors.start));
const layout = vectors.layout as unknown as Parameters<typeof skinOf>[0];
const { period } = vectors;
const ROWS = 4;

function bytes(hex: string): Uint8Array {
  return Uint8Array.from(hex.match(/../g) ?? [], (pair) => parseInt(pair, 16));
}

const all = vectors.frames.map((frame) => stretchOf(readFrame(bytes(frame)), timeline));

function held(stretches: typeof all): Stretches {
  const kept = new Stretches(100);
  for (const one of stretches) kept.put(one);
  return kept;
}

function expected({ lo, hi }: { lo: (number | null)[]; hi: (number | null)[] }): { lo: number[]; hi: number[] } {
  return { lo: lo.map((one) => one ?? -Infinity), hi: hi.map((one) => one ?? Infinity) };
}

function pictureAt(stretches: Stretches, quantity: string, x: number): { lo: number[]; hi: number[]; newest: number } {
  const skin = skinOf(layout, quantity);
  const picture = emptyPicture(skin);
  stretches.read(skin, x, picture);
  return { lo: [...picture.lo], hi: [...picture.hi], newest: picture.newest };
}

describe("pictures of frames that Python wrote", () => {
  test.each(["pressure", "temperature"] as const)("%s: at each instant, all taxels have the bounds of their latest sample", (quantity) => {
    const stretches = held(all);
    vectors.pictures[quantity].forEach((picture, row) => {
      for (const x of [row * period, (row + 1) * period - 1]) {
        const { lo, hi, newest } = pictureAt(stretches, quantity, x);
        expect({ lo, hi }).toEqual(expected(picture));
        expect(newest).toBe(row * period);
      }
    });
  });

  test("the order in which frames come makes no difference, nor does a frame that comes twice", () => {
    const mixed = held([...all.toReversed(), ...all]);
    vectors.pictures.pressure.forEach((picture, row) => {
      const { lo, hi } = pictureAt(mixed, "pressure", row * period);
      expect({ lo, hi }).toEqual(expected(picture));
    });
  });

  test("taxels of a missing page are unknown, never as they were before", () => {
    const without = held(all.filter(({ page, begin }) => !(page === 1 && begin === ROWS * period)));
    const picture = emptyPicture(skinOf(layout, "pressure"));
    for (const row of [ROWS - 1, ROWS + 1]) without.read(skinOf(layout, "pressure"), row * period, picture);
    const [lo, hi] = [[...picture.lo], [...picture.hi]];
    const known = expected(vectors.pictures.pressure[ROWS + 1]!);
    expect(lo.slice(0, 3)).toEqual(known.lo.slice(0, 3));
    expect(hi.slice(0, 3)).toEqual(known.hi.slice(0, 3));
    expect(lo.slice(3)).toEqual([-Infinity, -Infinity]);
    expect(hi.slice(3)).toEqual([Infinity, Infinity]);
  });

  test("before the first and after the last stretch nothing is known", () => {
    for (const x of [-1, 3 * ROWS * period]) {
      const { lo, newest } = pictureAt(held(all), "pressure", x);
      expect(lo.every((one) => one === -Infinity)).toBe(true);
      expect(newest).toBeNaN();
    }
  });

  test("a name stands for one picture", () => {
    const stretches = held(all);
    const names = vectors.pictures.pressure.map((_, row) => stretches.nameAt(row * period));
    expect(new Set(names).size).toBe(names.length);
    expect(stretches.nameAt(period + 1)).toBe(stretches.nameAt(2 * period - 1));
  });

  test("a sequence of frames is read as one after the other", () => {
    const sequence = Uint8Array.from(vectors.frames.flatMap((frame) => [...bytes(frame)]));
    expect(readFrames(sequence)).toEqual(vectors.frames.map((frame) => readFrame(bytes(frame))));
  });
});

describe("what can be shown", () => {
  test("the newest values are those of the last instant that is complete", () => {
    const picture = emptyPicture(taxelsOf(layout, "temperature"));
    held(all).readNewest(taxelsOf(layout, "temperature"), picture);
    expect({ lo: [...picture.lo], hi: [...picture.hi] }).toEqual(expected(vectors.pictures.temperature.at(-1)!));
    new Stretches(1).readNewest(taxelsOf(layout, "temperature"), picture);
    expect(picture.lo.every((one) => one === -Infinity)).toBe(true);
  });

  test("a page that is one stretch behind is waited for, and one that is two behind is not", () => {
    const behind = all.filter(({ page, begin }) => page === 0 || begin < ROWS * period);
    const [first, second, third] = [ROWS, 2 * ROWS, 3 * ROWS].map((rows) => rows * period);
    expect(held(behind.filter(({ begin }) => begin < second!)).complete).toBe(first);
    expect(held(behind).complete).toBe(third);
    expect(held(all).complete).toBe(third);
    expect(new Stretches(3).complete).toBeNull();
  });

  test("only so many stretches are kept", () => {
    const few = new Stretches(1);
    for (const one of all) few.put(one);
    expect(few.begin).toBe(2 * ROWS * period);
    expect(few.end).toBe(3 * ROWS * period);
  });

  test("quantities come with pressure first, and a skin has the taxels of one of them", () => {
    expect(quantitiesIn(layout)).toEqual(["pressure", "temperature"]);
    expect(skinOf(layout, "pressure").taxels).toEqual(["t00", "t01", "t02", "t10", "t11"]);
    expect(skinOf(layout, "temperature").threshold).toBeNull();
  });
});

describe("a channel's column", () => {
  test("has the samples of a strided column alone", () => {
    const column = columnOf(layout, "hand", "t22.temperature")!;
    const run = runOf(all[1]!, column, timeline)!;
    const picture = vectors.pictures.temperature[0]!;
    expect([...run.t]).toEqual([0]);
    expect([run.lo[0], run.hi[0]]).toEqual([picture.lo[2], picture.hi[2]]);
    expect(leastSpacing(run)).toBe(8 * period);
  });

  test("is found by the channel's name, and only by that", () => {
    expect(columnOf(layout, "hand", "t11.pressure")).toMatchObject({ patch: 1, column: 1 });
    expect(columnOf(layout, "hand", "t11.temperature")).toBeNull();
    expect(columnOf(layout, "hand", "t99.pressure")).toBeNull();
    expect(columnOf(layout, "palm", "t11.pressure")).toBeNull();
  });

  test("is missing in the frames of other pages", () => {
    expect(runOf(all[0]!, columnOf(layout, "hand", "t11.pressure")!, timeline)).toBeNull();
  });
});
