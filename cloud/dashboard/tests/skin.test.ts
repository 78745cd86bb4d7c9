import { describe, expect, test } from "vitest";
import type { ChannelItem, SeriesAnswer } from "../src/api/contract";
import { LiveEdge } from "../src/live/edge";
import { judge, levelOf, quantitiesOf } from "../src/skin/contact";
import { layOut, PITCH } from "../src/skin/layout";
import { hullOf, Present } from "../src/skin/present";
import { Timeline } from "../src/time/timeline";

function channel(id: string, bounds: ChannelItem["bounds"]): ChannelItem {
  const [taxel = "", quantity = ""] = id.split(".");
  return { id, taxel, quantity, unit: "F", coverage: 1, dt: 1, blocks: 1, samples: 1, bytes: 4, first: null, last: null, bounds };
}

test("contact is certain above a level, possible across it, and none below", () => {
  expect(judge({ lo: 1.1, hi: 2 }, 1)).toBe("certain");
  expect(judge({ lo: 1, hi: 2 }, 1)).toBe("possible");
  expect(judge({ lo: -Infinity, hi: Infinity }, 1)).toBe("possible");
  expect(judge({ lo: 0, hi: 1 }, 1)).toBe("none");
  expect(judge({ lo: Number.NaN, hi: Number.NaN }, 1)).toBe("unknown");
  expect(judge(null, 1)).toBe("unknown");
});

test("a block's hull takes in unbounded sides and leaves out what is missing", () => {
  expect(hullOf({ lo: [1, null, 3], hi: [2, null, 5] })).toEqual({ lo: 1, hi: 5 });
  expect(hullOf({ lo: [1, null], hi: [2, 4] })).toEqual({ lo: -Infinity, hi: 4 });
  expect(hullOf({ lo: [null], hi: [null] })).toBeNull();
});

test("pressure is offered first, and only what several taxels have", () => {
  const all = ["t01.capacitance", "t02.capacitance", "t01.pressure", "t02.pressure", "t01.temperature", "a01.humidity"];
  const channels = all.map((id) => channel(id, null));
  expect(quantitiesOf(channels, new Set(["t01", "t02"]))).toEqual(["pressure", "capacitance"]);
});

test("a level starts as a light touch, or in the middle of what was measured", () => {
  const channels = [channel("t01.capacitance", { lo: 1, hi: 3 }), channel("t02.capacitance", { lo: 2, hi: 9 })];
  expect(levelOf(channels, "capacitance")).toBe(5);
  expect(levelOf([channel("t01.pressure", null)], "pressure")).toBe(1000);
  expect(levelOf([channel("t01.capacitance", { lo: null, hi: 2 })], "capacitance")).toBe(0);
});

function close(value: number, wanted: number): void {
  expect(value).toBeCloseTo(wanted, 9);
}

test("a skin is drawn with y upwards and the nearest taxels a pitch apart", () => {
  const { spots, width, height } = layOut([
    { id: "t00", position_m: [0.01, 0] },
    { id: "t01", position_m: [0.03, 0] },
    { id: "t02", position_m: [0.01, 0.04] },
  ]);
  close(spots[1]!.x - spots[0]!.x, PITCH);
  close(spots[0]!.y - spots[2]!.y, 2 * PITCH);
  close(width, 2 * PITCH);
  close(height, 3 * PITCH);
  expect(layOut([{ id: "t00", position_m: [0.5, 0.5] }])).toEqual({ spots: [{ taxel: "t00", x: 10, y: 10 }], width: PITCH, height: PITCH });
});

describe("the present", () => {
  const START = Date.parse("2026-01-31T12:00:00Z");
  const touched = { lo: 5, hi: 6 };
  const idle = { lo: 1, hi: 2 };

  /** A block that ends so many ms after the start. */
  function block(end: number, { lo, hi }: { lo: number; hi: number }, name = "c"): SeriesAnswer {
    const t0 = new Date(START + end - 1).toISOString();
    return { node: "n", channel: name, unit: "F", coverage: 1, resolution: "sample", t0, t: [0, 1e6], lo: [lo, lo], hi: [hi, hi], dt: 1e6, time_error: 0 };
  }

  function presentOf(edge = new LiveEdge()): Present {
    return new Present(new Timeline(BigInt(START) * 1_000_000n), edge);
  }

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

  test("fits the pace of a node whose clock runs faster than ours", () => {
    const edge = new LiveEdge();
    const present = presentOf(edge);
    for (let at = 0; at <= 2_000; at += 250) edge.observe(10 * at * 1e6, at);
    present.take(block(10_000, touched), 2_000);
    expect(present.of("c", 2_000)).toEqual(touched);
  });

  test("is unknown while a node brings what waited", () => {
    const present = presentOf();
    present.take(block(1_000, touched), 0);
    present.takeLag({ lo_ns: 3600e9, hi_ns: 3601e9 });
    expect([present.of("c", 10), present.age]).toEqual([null, 3600e9]);
    present.takeLag({ lo_ns: 31e6, hi_ns: 35e6 });
    expect([present.of("c", 20), present.age]).toEqual([touched, null]);
  });
});
