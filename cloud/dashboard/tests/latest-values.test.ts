import { describe, expect, test } from "vitest";
import type { LiveBlock } from "../src/api/contract";
import { LiveEdge } from "../src/live/edge";
import { LatestValues } from "../src/skin/latest-values";
import { Timeline } from "../src/time/timeline";

const START = Date.parse("2026-01-31T12:00:00Z");
const touched = { lo: 5, hi: 6 };
const idle = { lo: 1, hi: 2 };

/** A block that ends so many ms after the start. */
function block(end: number, { lo, hi }: { lo: number; hi: number }, name = "c"): LiveBlock {
  const t0 = new Date(START + end - 1).toISOString();
  return { node: "n", channel: name, unit: "F", coverage: 1, resolution: "sample", t0, t: [0, 1e6], lo: [lo, lo], hi: [hi, hi], dt: 1e6, time_error: 0, stored: t0 };
}

/** The same, stored so many ms after the start by the cloud's clock. */
function stored(said: LiveBlock, at: number): LiveBlock {
  return { ...said, stored: new Date(START + at).toISOString() };
}

function presentOf(edge = new LiveEdge()): LatestValues {
  return new LatestValues(new Timeline(BigInt(START) * 1_000_000n), edge);
}

describe("the present", () => {
  test("is not what a block tells that comes late", () => {
    const present = presentOf();
    present.take(block(10_000, idle), 0);
    present.take(block(2_000, touched), 10);
    expect(present.of("c", 20)).toEqual(idle);
    present.take(block(10_250, touched), 250);
    expect(present.of("c", 260)).toEqual(touched);
    present.take({ ...block(10_500, idle), lo: [null, null], hi: [null, null] }, 500);
    present.take(block(10_400, touched), 510);
    expect(present.of("c", 520)).toBeNull();
  });

  test("is unknown where what came last is older than what the node measured since", () => {
    const edge = new LiveEdge();
    const present = presentOf(edge);
    edge.observe(10_000e6, 0);
    present.take(block(5_000, touched), 10);
    present.take(block(9_000, idle, "d"), 10);
    expect(present.of("c", 20)).toBeNull();
    expect(present.of("d", 20)).toEqual(idle);
    expect(present.of("d", 4_010)).toBeNull();
    expect(present.of("e", 20)).toBeNull();
  });

  test("is unknown where nothing is known of a block's last seconds", () => {
    const present = presentOf();
    const long = { t: [0, 1e9, 6e9], dt: 1e9 };
    present.take({ ...block(1, touched), ...long, lo: [5, 5, null], hi: [6, 6, null] }, 0);
    expect(present.of("c", 10)).toBeNull();
    present.take({ ...block(10_001, touched), ...long, lo: [5, 5, 5], hi: [6, 6, 6] }, 20);
    expect(present.of("c", 30)).toEqual({ lo: 5, hi: 6 });
  });

  test("fits the pace of a node whose clock runs faster than ours", () => {
    const edge = new LiveEdge();
    const present = presentOf(edge);
    for (let at = 0; at <= 2_000; at += 250) edge.observe(10 * at * 1e6, at);
    present.take(block(10_000, touched), 2_000);
    expect(present.of("c", 2_000)).toEqual(touched);
  });
});

describe("the present of a node that comes back", () => {
  test("is unknown while a node brings what waited, by the cloud's clock", () => {
    const present = presentOf();
    present.take(stored(block(1_000, touched), 3_601_000), 500_000);
    expect([present.of("c", 500_010), present.age]).toEqual([null, 3600e9]);
    present.take(stored(block(3_601_100, idle), 3_601_200), 500_200);
    expect([present.of("c", 500_210), present.age]).toEqual([idle, null]);
  });

  test("is unknown at once where a node falls silent and comes back with the past", () => {
    const present = presentOf();
    present.take(stored(block(1_000, idle), 1_031), 500_000);
    expect(present.of("c", 500_010)).toEqual(idle);
    present.take(stored(block(1_250, touched), 101_031), 600_000);
    expect([present.of("c", 600_010), present.age]).toEqual([null, 99_781e6]);
  });

  test("is unknown where a broken stream brings what was stored in time, but long ago", () => {
    const present = presentOf();
    present.take(stored(block(1_000, idle), 1_031), 500_000);
    present.take(stored(block(1_250, touched), 1_281), 600_000);
    // Less a thousandth of the time since then, by which clocks may drift apart.
    expect([present.of("c", 600_010), present.age]).toEqual([null, 99_681e6]);
    present.take(stored(block(101_200, touched), 101_231), 600_200);
    expect([present.of("c", 600_210), present.age]).toEqual([touched, null]);
  });

  test("is unknown however much a broken stream brings that was stored in time, but long ago", () => {
    const present = presentOf();
    for (const name of ["c", "d"]) present.take(stored(block(1_000, idle, name), 1_031), 500_000);
    for (let k = 1; k < 2_000; k += 1) {
      for (const name of ["c", "d"]) present.take(stored(block(1_000 + 50 * k, touched, name), 1_031 + 50 * k), 700_000 + k);
      expect([present.of("c", 700_000 + k), present.age !== null]).toEqual([null, true]);
    }
    present.take(stored(block(203_100, touched), 203_131), 702_100);
    expect([present.of("c", 702_110), present.of("d", 702_110), present.age]).toEqual([touched, null, null]);
  });

});

describe("the present, by doubtful times and clocks", () => {
  test("is unknown by hulls of long stretches, whose age is not known", () => {
    const present = presentOf();
    const long = { ...block(1, touched), resolution: "hull", t: [0], lo: [5], hi: [6], dt: 10e9 } as const;
    present.take(stored(long, 10_031), 500_000);
    expect([present.of("c", 500_010), present.age]).toEqual([null, null]);
    present.take(stored(long, 17_031), 507_000);
    expect([present.of("c", 507_010), present.age]).toEqual([null, null]);
    present.take(stored({ ...long, t0: new Date(START + 1).toISOString() }, 17_031), 507_000);
    expect(present.age).toBe(7_030e6);
  });

  test("is unknown where a block's times may be wrong by as much, and its age is not known", () => {
    const present = presentOf();
    present.take({ ...stored(block(6_000, touched), 6_031), time_error: 5e9 }, 500_000);
    expect([present.of("c", 500_010), present.age]).toEqual([null, null]);
    present.take({ ...stored(block(6_250, touched), 6_281), time_error: 3e9 }, 500_250);
    expect(present.of("c", 500_260)).toEqual(touched);
    present.take({ ...stored(block(6_500, touched), 16_281), time_error: 5e9 }, 510_250);
    expect([present.of("c", 510_260), present.age]).toEqual([null, 4_781e6]);
  });

  test("is unknown where a broken stream tells again what it told in one hull", () => {
    const present = presentOf();
    present.take(stored(block(0, idle), 31), 500_000);
    const long = { ...block(1, idle), resolution: "hull", t: [0], lo: [1], hi: [2], dt: 60e9 } as const;
    present.take(stored({ ...long, t0: new Date(START + 1).toISOString() }, 60_031), 560_000);
    for (let k = 1; k < 50; k += 1) {
      present.take(stored(block(1_000 * k, touched), 1_000 * k + 31), 560_000 + k);
      expect([k, present.of("c", 560_000 + k)]).toEqual([k, null]);
    }
  });

  test("is known again with the first block after the cloud's clock was set back", () => {
    const present = presentOf();
    present.take(stored(block(0, idle), 3_600_031), 500_000);
    expect(present.of("c", 500_050)).toBeNull();
    present.take(stored(block(50, idle), 81), 500_050);
    expect(present.of("c", 500_060)).toEqual(idle);
  });

  test("stays known beside a clock of the page that runs faster than the cloud's, day for day", () => {
    const present = presentOf();
    for (let second = 0; second < 200_000; second += 20) {
      const at = 1.0005 * second * 1_000;
      present.take(stored(block(second * 1_000, idle), second * 1_000 + 31), at);
      expect(present.of("c", at + 10)).toEqual(idle);
    }
  });
});
