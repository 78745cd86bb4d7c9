import { describe, expect, test } from "vitest";
import type { EventItem } from "../src/api/contract";
import { reduceToColumns } from "../src/chart/band";
import { readValue } from "../src/chart/reading";
import { missingStretches } from "../src/chart/segments";
import { ChannelData } from "../src/live/channel-data";
import { LiveEdge } from "../src/live/edge";
import { Timeline } from "../src/time/timeline";
import { hullWithin } from "../src/tube/entries";
import { channel, dataOf, iso, MS, ORIGIN, run, series, SIGNAL } from "./channels";

async function fill(data: ChannelData, hole: { x0: number; x1: number } | null): Promise<void> {
  if (hole) await data.backfill(hole, 1000, SIGNAL);
}

describe("the seam between store and stream", () => {
  test("what was stored after the first answer and before the first block is asked for", async () => {
    const data = dataOf(channel(1000), [[0, 5000]]);
    const first = fill(data, { x0: 0, x1: data.end! });
    const { hole } = data.take(run(1500, 1750), 0, 0);
    expect(hole).toEqual({ x0: 1000 * MS, x1: 1500 * MS });
    await first;
    await fill(data, hole);
    expect([...data.rolling.t]).toEqual(Array.from({ length: 1750 }, (_, i) => i * MS));
  });

  test("a block that follows at once needs nothing", () => {
    const data = dataOf(channel(1000), []);
    expect(data.take(run(1000, 1250), 0, 0).hole).toBeNull();
    expect(data.take(run(1250, 1500), 0, 0).hole).toBeNull();
  });

  test("what the store lists anew does not stand for what the stream has not stated", () => {
    const data = dataOf(channel(1000), []);
    data.take(run(1000, 1250), 0, 0);
    data.channel = channel(2000);
    expect(data.take(run(2000, 2250), 0, 0).hole).toEqual({ x0: 1250 * MS, x1: 2000 * MS });
  });

  test("blocks that arrive while the chart is hidden are loaded later", () => {
    const data = dataOf(channel(1000), []);
    data.take(run(1000, 1250), 0, null);
    expect(data.rolling.t.length).toBe(0);
    expect(data.end).toBe(1250 * MS);
  });
});

describe("live samples", () => {
  test("that come late take nothing from what came before them", () => {
    const data = dataOf(channel(1000), []);
    const spike = series(1250, 1500);
    data.take(run(1250, 1500, { hi: spike.hi.map((hi, i) => (i === 0 ? 51 : hi)) }), 0, 0);
    data.take(run(1000, 1250), 0, 0);
    expect(hullWithin(data.rolling, 1249 * MS, 1260 * MS).hi).toBe(51);
  });

  test("that were missed are asked for", () => {
    const data = dataOf(channel(1000), []);
    data.take(run(1000, 1250), 0, 0);
    expect(data.take(run(1250, 1500), 0, 0).hole).toBeNull();
    expect(data.take(run(1750, 2000), 0, 0).hole).toEqual({ x0: 1500 * MS, x1: 1750 * MS });
  });

  test("that come while the store is asked are not lost by its answer", async () => {
    const data = dataOf(channel(1000), [[0, 1100]]);
    const { hole } = data.take(run(2000, 2250), 0, 0);
    const filled = fill(data, hole);
    const late = series(1500, 1600);
    data.take(run(1500, 1600, { lo: late.lo.map(() => 7), hi: late.hi.map(() => 8) }), 0, 0);
    await filled;
    expect(hullWithin(data.rolling, 1500 * MS, 1599 * MS)).toMatchObject({ lo: 7, hi: 8 });
    expect(missingStretches(data.rolling, 0, 2250 * MS)[0]).toEqual({ x0: 1100 * MS, x1: 1500 * MS });
  });

  test("say what magnitude a channel has", () => {
    const data = dataOf(channel(1000), []);
    expect(data.bounds).toBeNull();
    data.take(run(1000, 1250), 0, 0);
    expect(data.bounds).toEqual({ lo: 1, hi: 2 });
  });
});

describe("coverage and error of time", () => {
  const sure = { coverage: 0.999, time_error: 1000 };
  const doubtful = { coverage: 0.9, time_error: 2e9 };
  const facts = { unit: "F", bursts: false };

  test("are those of the entries that are read, not of the latest block", () => {
    const data = dataOf(channel(1000), []);
    data.take(run(1000, 1001, doubtful), 0, 0);
    data.take(run(1001, 1250, sure), 0, 0);
    const read = (x: number): string => {
      const reading = readValue(data.rolling, new Timeline(ORIGIN), facts, { x, perPixel: MS / 2 });
      return reading!.text.lines.map(({ value }) => value).slice(1).join(", ");
    };
    expect(read(1000 * MS)).toBe("± 2 s, ≥ 90 %");
    expect(read(1100 * MS)).toBe("± 1 µs, ≥ 99.9 %");
  });

  test("a hull of n samples is as sure as the union bound says", () => {
    const data = dataOf(channel(1000), []);
    data.take(run(1000, 1250, sure), 0, 0);
    const read = (x: number, perPixel: number): string | undefined =>
      readValue(data.rolling, new Timeline(ORIGIN), facts, { x, perPixel })?.text.lines.at(-1)?.value;
    expect(read(1100 * MS, 10.5 * MS)).toBe("≥ 98 %");
    expect(read(1125 * MS, 10_000 * MS)).toBe("≥ 74 %");
    const thinned = dataOf(channel(1000), []);
    thinned.take(run(1000, 1250, { coverage: 0.99, time_error: 0 }), 0, 1000 * MS);
    expect(thinned.rolling.t.length).toBe(1);
    expect(readValue(thinned.rolling, new Timeline(ORIGIN), facts, { x: 1100 * MS, perPixel: MS })?.text.lines.at(-1)?.value).toBe("≥ 0 %");
  });

  test("the band is painted as wide in time as each entry's own error", () => {
    const data = dataOf(channel(1000), []);
    data.take(run(1000, 1001, { coverage: 1, time_error: 100 * MS }), 0, 0);
    data.take(run(1500, 1501, sure), 0, 0);
    const map = { width: 1000, height: 10, xMin: 800 * MS, xMax: 1800 * MS, yMin: 0, yMax: 3 };
    const { bottom } = reduceToColumns(data.rolling, map, { halfMark: 1, thickness: 1 });
    const painted = [...bottom.keys()].filter((column) => bottom[column]! > 0);
    expect([painted[0]! <= 100, painted.filter((column) => column > 310 && column < 690)]).toEqual([true, []]);
    expect(painted.filter((column) => column >= 690).length).toBeLessThan(5);
  });
});

describe("silence", () => {
  test("a true hole is marked as missing", async () => {
    const data = dataOf(channel(1000), [[0, 1000]]);
    data.take(run(1000, 1250), 0, 0);
    await fill(data, data.take(run(2000, 2250), 0, 0).hole);
    const at = data.rolling.t.indexOf(1250 * MS);
    expect(data.rolling.lo[at]).toBeNaN();
    expect(data.rolling.width[at]).toBe(750 * MS);
  });

  test("of a node is stated, and of a channel also while others of its node go on", () => {
    const edge = new LiveEdge();
    const data = dataOf(channel(1000), [], "sample", edge);
    expect(data.silentSince(0)).toBeNull();
    data.take(run(1000, 1250), 0, 0);
    expect([data.silentSince(3900), data.silentSince(4100)]).toEqual([null, 1249 * MS]);
    for (let at = 250; at <= 8000; at += 250) edge.observe((1250 + at) * MS, at);
    expect(edge.silence(8000)).toBe(0);
    expect(data.silentSince(8000)).toBe(1250 * MS);
    data.take(run(9000, 9250), 8000, 0);
    expect(data.silentSince(8100)).toBeNull();
  });

  test("the pauses of a channel that measures in bursts are asked for until their length is known", async () => {
    const data = dataOf(channel(1040), [[1000, 1040]]);
    for (const begin of [2000, 3000, 4000]) {
      const { hole } = data.take(run(begin, begin + 40), 0, 0);
      expect(hole).not.toBeNull();
      // Each hole is filled before the next samples come.
      // oxlint-disable-next-line no-await-in-loop
      await fill(data, hole);
    }
    expect(data.facts.bursts).toBe(true);
    expect(data.take(run(5000, 5040), 0, 0).hole).toBeNull();
    expect(data.take(run(9000, 9040), 0, 0).hole).not.toBeNull();
    expect(data.facts.bursts).toBe(false);
  });

  test("holes of any length are no bursts", () => {
    const data = dataOf(channel(1000), []);
    for (const begin of [2000, 2500, 4000, 4200]) data.take(run(begin, begin + 40), 0, 0);
    expect(data.facts.bursts).toBe(false);
  });
});

function event(ms: number, kind: "peak" | "gap" = "peak"): EventItem {
  const nothing = { height: null, prominence: null, count: null, unit: null, coverage: null, detail: null };
  const time = { lo: iso(ms), hi: iso(ms + 1) };
  const verdict = kind === "peak" ? "certain" : null;
  return { id: `${kind}${ms}`, node: "n", channel: "c", kind, verdict, time, boot: 1, ...nothing };
}

describe("history", () => {
  const WINDOW = { x0: 100 * MS, x1: 400 * MS };
  const within = { x0: 150 * MS, x1: 300 * MS };

  test("a window of which every sample was loaded is not asked for again", async () => {
    const data = dataOf(channel(1000), [[0, 1000]]);
    expect(data.holds(within)).toBe(false);
    await data.load(WINDOW, 500, SIGNAL);
    expect(data.holds(WINDOW)).toBe(true);
    expect(data.holds(within)).toBe(true);
    expect(data.holds({ x0: 150 * MS, x1: 401 * MS })).toBe(false);
    expect(data.holds({ x0: 99 * MS, x1: 300 * MS })).toBe(false);
  });

  test("what is not over yet is asked for again, and so is what a late block belongs to", async () => {
    const data = dataOf(channel(300), [[0, 300]]);
    await data.load(WINDOW, 500, SIGNAL);
    expect(data.holds(WINDOW)).toBe(false);
    expect(data.holds({ x0: 150 * MS, x1: 200 * MS })).toBe(true);
    data.take(run(160, 170), 0, null);
    expect(data.holds({ x0: 150 * MS, x1: 200 * MS })).toBe(false);
  });

  test("hulls do not hold what is finer", async () => {
    const data = dataOf(channel(1000), [[0, 1000]], "hull");
    await data.load(WINDOW, 500, SIGNAL);
    expect(data.holds(within)).toBe(false);
  });
});

describe("marks", () => {
  const WINDOW = { x0: 0, x1: 5000 * MS };

  test("what the stream sends does not push out the marks of a window of history", () => {
    const data = dataOf(channel(1000), []);
    for (let ms = 0; ms < 2000; ms += 1) data.takeEvent(event(ms), WINDOW);
    for (let ms = 6000; ms < 11_000; ms += 1) data.takeEvent(event(ms), WINDOW);
    for (const ms of [100, 6000]) data.takeEvent(event(ms, "gap"), WINDOW);
    expect(data.peaks.length).toBe(2000);
    expect(data.gaps.length).toBe(1);
  });

  test("marks that have left a live window are forgotten", () => {
    const data = dataOf(channel(1000), []);
    for (const ms of [0, 100, 200]) {
      data.takeEvent(event(ms), null);
      data.takeEvent(event(ms, "gap"), null);
    }
    data.evictBefore(150 * MS);
    expect(data.peaks.map(({ x0 }) => x0 / MS)).toEqual([200]);
    expect(data.gaps.map(({ x0 }) => x0 / MS)).toEqual([200]);
  });

  test("their number is bounded", () => {
    const data = dataOf(channel(1000), []);
    for (let ms = 0; ms < 5000; ms += 1) data.takeEvent(event(ms), null);
    expect(data.peaks.length).toBe(4000);
    expect(data.peaks.at(-1)!.x0).toBe(4999 * MS);
  });
});
